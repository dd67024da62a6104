//! What a gradient costs, in forward runs, at about 10², 10³ and 10⁴ controls.

use std::error::Error;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lasergym_milling::{
    BeamPath, GradientMemory, Grid, MillingError, Objective, Profile, RasterLayout, Simulator,
};

/// A flat target under `passes` passes of `points` points.
fn case(
    profile: &Profile,
    passes: usize,
    points: usize,
) -> Result<(Simulator, BeamPath, Objective), MillingError> {
    let reach_um = profile.process.footprint.reach_um();
    let (cell_um, spacing_um) = (0.125 * reach_um, 0.125 * reach_um);
    let margin_um = reach_um + 4.0 * cell_um;
    let cells = |length_um: f64| ((length_um + 2.0 * margin_um) / cell_um).ceil() as usize;
    let rows = cells((passes - 1) as f64 * profile.pitch_um);
    let grid = Grid::new(rows, cells((points - 1) as f64 * spacing_um), cell_um)?;
    let layout = RasterLayout {
        first_x_um: margin_um,
        spacing_um,
        points,
        first_y_um: margin_um,
        pitch_um: profile.pitch_um,
        passes,
    };
    let (least, most) = profile.dwell_range_s_mm();
    let substeps = Simulator::stable_substeps(&profile.process, cell_um, spacing_um, most);
    let simulator = Simulator::new(grid, &profile.process, substeps)?;
    let path = BeamPath::raster(&layout, 2.0 * least)?;
    let target_um = vec![1.5 * profile.layer_depth_um(2.0 * least); grid.len()];
    let objective = Objective::new(grid, target_um, 0..grid.rows, 0..grid.columns)?;
    Ok((simulator, path, objective))
}

fn gradients(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    for name in Profile::shipped_names() {
        let profile = Profile::shipped(name)?;
        let mut group = criterion.benchmark_group(name);
        for (passes, points) in [(5, 10), (10, 50), (50, 100)] {
            let (simulator, path, objective) = case(&profile, passes, points)?;
            let start_um = vec![0.0; simulator.grid().len()];
            let controls = 2 * passes * points;
            group.throughput(Throughput::Elements(controls as u64));
            group.bench_function(format!("forward/{controls}"), |bench| {
                bench.iter(|| {
                    let mut depth_um = start_um.clone();
                    let done = simulator.mill(&path, &mut depth_um);
                    black_box((done, depth_um))
                });
            });
            group.bench_function(format!("gradient/{controls}"), |bench| {
                let mut memory = GradientMemory::default();
                bench.iter(|| {
                    black_box(simulator.gradient(&path, &start_um, &objective, &mut memory))
                });
            });
        }
        group.finish();
    }
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    if let Err(error) = gradients(criterion) {
        eprintln!("{error}");
    }
}

criterion_group!(all, benches);
criterion_main!(all);
