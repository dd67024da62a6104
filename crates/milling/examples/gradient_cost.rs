//! What a gradient costs in forward runs, by processor time: unlike `cargo bench` it may be run beside
//! other work, on Linux.
//!
//! `cargo run --release -p lasergym-milling --example gradient_cost`

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use lasergym_milling::{DepthMap, GradientMemory, JobOptions, MillingJob, Profile};

/// Time for each of the two, s: the system counts processor time in steps of some milliseconds.
const ENOUGH_S: f64 = 1.0;

/// Runs of one kind between two looks at the clock take about so long, s.
const TURN_S: f64 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    println!("process          controls  passes  forward ms  gradient ms  gradient/forward");
    for name in Profile::shipped_names() {
        for side in [0.5, 3.0, 10.0, 20.0] {
            report(name, side)?;
        }
    }
    Ok(())
}

/// A wavy target whose side is `side` times the reach of the footprint.
fn report(name: &str, side: f64) -> Result<(), Box<dyn Error>> {
    let profile = Profile::shipped(name)?;
    let pixel_um = 0.125 * profile.process.footprint.reach_um();
    let pixels = (8.0 * side).ceil() as usize;
    let (least, _) = profile.dwell_range_s_mm();
    let least_um = profile.layer_depth_um(least);
    let depths = (0..pixels * pixels)
        .map(|k| least_um * (1.6 + 0.3 * (0.2 * (k % pixels) as f64).sin()))
        .collect();
    let target = DepthMap::new(pixels, pixels, pixel_um, depths)?;
    let job = MillingJob::new(&target, profile, JobOptions::default())?;
    let path = job.pixel_by_pixel(job.start_um(), job.layers())?;
    let mut memory = GradientMemory::default();
    let forward = || {
        let mut depth_um = job.start_um().to_vec();
        black_box(job.simulator().mill(&path, &mut depth_um))
    };
    let mut gradient = || {
        let start_um = job.start_um();
        let found = job.simulator().gradient(&path, start_um, job.objective(), &mut memory);
        black_box(found).map(drop)
    };
    let started = Instant::now();
    forward()?;
    gradient()?;
    let runs = (TURN_S / started.elapsed().as_secs_f64()).ceil() as usize;
    let (mut forward_s, mut gradient_s, mut turns) = (0.0, 0.0, 0);
    // Turn by turn, so that other work slows both alike.
    while forward_s < ENOUGH_S {
        let started = Clock::now();
        (0..runs).try_for_each(|_| forward())?;
        forward_s += started.elapsed_s();
        let started = Clock::now();
        (0..runs).try_for_each(|_| gradient())?;
        gradient_s += started.elapsed_s();
        turns += 1;
    }
    let all = (turns * runs) as f64;
    println!(
        "{name:<16} {:>8} {:>7} {:>11.3} {:>12.3} {:>17.2}",
        2 * path.y_um.len(),
        path.passes(),
        1e3 * forward_s / all,
        1e3 * gradient_s / all,
        gradient_s / forward_s
    );
    Ok(())
}

/// Processor time of this thread where the system tells it, else time on the wall.
struct Clock {
    processor_s: Option<f64>,
    wall: Instant,
}

impl Clock {
    fn now() -> Self {
        Self { processor_s: processor_s(), wall: Instant::now() }
    }

    fn elapsed_s(&self) -> f64 {
        match (self.processor_s, processor_s()) {
            (Some(before), Some(after)) => after - before,
            _ => self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// Time that this thread has run, s (Linux).
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(1e-9 * nanoseconds)
}
