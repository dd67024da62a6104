//! Time to find the mark in one pair of 640 × 480 frames, and to draw such a frame.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use lasergym_geom::Point;
use lasergym_machine::simulator::{IMAGING_POSITION_UM, Preset, Rig};
use lasergym_machine::vision::{Vision, VisionOptions};
use lasergym_machine::{Camera, Frame, Laser, Observer, Stage};

/// Frames of a job whose pulses overlap: the first before any pulse.
fn frames(rig: &Rig) -> Option<(Vec<Frame>, Vec<Point>)> {
    let (mut stage, mut laser, mut camera) = (rig.stage(), rig.laser(), rig.camera());
    laser.arm().ok()?;
    let mut frames = vec![camera.frame().ok()?];
    let mut positions = Vec::new();
    for k in 0..24 {
        let position = Point::new(20.0 + 11.0 * f64::from(k % 6), 25.0 + 13.0 * f64::from(k / 6));
        stage.move_to(position).ok()?;
        laser.fire().ok()?;
        stage.move_to(IMAGING_POSITION_UM).ok()?;
        frames.push(camera.frame().ok()?);
        positions.push(position);
    }
    Some((frames, positions))
}

fn pair(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("vision");
    for preset in [Preset::Lab, Preset::Harsh] {
        let Ok(rig) = Rig::new(preset.options(), 1) else { return };
        let Some((frames, positions)) = frames(&rig) else { return };
        let options = VisionOptions::default();
        let Ok(mut vision) = Vision::new(rig.true_calibration(), &frames[0], options) else {
            return;
        };
        // As in a job: the frame after a pulse is the one before the next.
        let mut k = 0;
        group.bench_function(format!("{}_next_pulse", preset.name()), |bencher| {
            bencher.iter(|| {
                k = (k + 1) % positions.len();
                black_box(vision.observe(&frames[k], &frames[k + 1], positions[k])).is_ok()
            });
        });
        // Neither frame has been seen before.
        group.bench_function(format!("{}_new_pair", preset.name()), |bencher| {
            bencher.iter(|| {
                k = (k + 7) % positions.len();
                black_box(vision.observe(&frames[k], &frames[k + 1], positions[k])).is_ok()
            });
        });
        let mut camera = rig.camera();
        group.bench_function(format!("{}_simulated_frame", preset.name()), |bencher| {
            bencher.iter(|| black_box(camera.frame()).is_ok());
        });
    }
    group.finish();
}

criterion_group!(benches, pair);
criterion_main!(benches);
