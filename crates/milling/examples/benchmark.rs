//! How well pixel-by-pixel, straight and free passes mill the benchmark's targets, and what the free
//! ones do when the same model takes much finer steps.
//!
//! `cargo run --release -p lasergym-milling --example benchmark [laser|waterjet] [TARGET…]`

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Instant;

use lasergym_milling::{DepthMap, JobOptions, MillingJob, Profile, Simulator, SolveOptions};

/// A target: its name and its depth, from 0 to 1, at (x, y) in [0, 1]².
type Target = (&'static str, fn(f64, f64) -> f64);

const TARGETS: [Target; 4] =
    [("pockets", pockets), ("simple", simple), ("coin", coin), ("portrait", portrait)];

/// Steps of the check, over those that the passes were found with.
const FINER: usize = 8;

/// Rises from 0 to 1 between two places.
fn ramp(value: f64, from: f64, to: f64) -> f64 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}

/// Four pockets of different depth; opposite sides have different slopes (Fig. 15).
fn pockets(x: f64, y: f64) -> f64 {
    let pocket = |left: f64, top: f64, depth: f64, steep: f64| {
        let (u, v) = (x - left, y - top);
        let across = ramp(u, 0.0, steep).min(ramp(0.36 - u, 0.0, 2.0 * steep));
        let along = ramp(v, 0.0, 1.5 * steep).min(ramp(0.36 - v, 0.0, steep));
        depth * across.min(along)
    };
    pocket(0.10, 0.10, 1.0, 0.06)
        .max(pocket(0.55, 0.10, 0.8, 0.07))
        .max(pocket(0.10, 0.55, 0.65, 0.08))
        .max(pocket(0.55, 0.55, 0.5, 0.05))
}

/// A plateau between ramps of different slope, deeper in one half (Fig. 8).
fn simple(x: f64, y: f64) -> f64 {
    let profile = ramp(y, 0.1, 0.3).min(ramp(0.9 - y, 0.0, 0.35));
    profile * (0.6 + 0.4 * ramp(x, 0.35, 0.65))
}

/// A rim, a raised disc and bars with steps, as on a coin.
fn coin(x: f64, y: f64) -> f64 {
    let radius = (x - 0.5).hypot(y - 0.5);
    let step = |edge: f64, at: f64| ramp(edge - at, -0.01, 0.01);
    let rim = step(0.46, radius) * step(radius, 0.40);
    let head = step(0.22, (x - 0.5).hypot((y - 0.45) / 1.25));
    let nose = step(0.05, (x - 0.30).hypot(y - 0.45));
    let bars: f64 = (0..5)
        .map(|k| {
            let centre = 0.26 + 0.12 * f64::from(k);
            step(0.02, (x - centre).abs()) * step(0.035, (y - 0.80).abs())
        })
        .sum();
    1.0 - 0.8 * rim.max(head).max(nose).max(bars.min(1.0))
}

/// Smooth hills and hollows, as in the relief of a portrait.
fn portrait(x: f64, y: f64) -> f64 {
    let hill = |height: f64, u: f64, v: f64, width: f64, length: f64| {
        height * (-((x - u) / width).powi(2) - ((y - v) / length).powi(2)).exp()
    };
    let face = hill(0.9, 0.5, 0.42, 0.20, 0.28)
        - hill(0.35, 0.43, 0.36, 0.045, 0.025)
        - hill(0.35, 0.57, 0.36, 0.045, 0.025)
        + hill(0.25, 0.5, 0.46, 0.03, 0.08)
        - hill(0.3, 0.5, 0.56, 0.08, 0.02);
    let body = hill(0.7, 0.5, 1.0, 0.38, 0.25);
    let ground = 0.12 * (9.0 * x + 2.0).sin() * (7.0 * y).cos();
    (0.85 - face - body + ground).clamp(0.0, 1.0)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let asked = |name: &str, names: &[&str]| {
        arguments.iter().all(|a| !names.contains(&a.as_str()))
            || arguments.iter().any(|a| a == name)
    };
    let names: Vec<&str> = TARGETS.iter().map(|target| target.0).collect();
    println!(
        "process          target     layers  controls  pixel %  straight %  free %  free/straight  time s  free, fine steps %"
    );
    for (process, kind, size, pixel_um, base_um, depth_um) in [
        ("laser-graphite", "laser", 300, 5.0, 8.0, 32.0),
        ("waterjet-garnet", "waterjet", 160, 50.0, 60.0, 160.0),
    ] {
        if !asked(kind, &["laser", "waterjet"]) {
            continue;
        }
        for (name, target) in TARGETS {
            if !asked(name, &names) {
                continue;
            }
            // The laser can be switched off beside the pockets.
            let base_um = if kind == "laser" && name == "pockets" { 0.0 } else { base_um };
            let place = |k: usize| (k as f64 + 0.5) / size as f64;
            let depths = (0..size * size)
                .map(|k| base_um + depth_um * target(place(k % size), place(k / size)))
                .collect();
            let map = DepthMap::new(size, size, pixel_um, depths)?;
            report(process, name, &map)?;
        }
    }
    Ok(())
}

/// Solves with straight and with free passes, both with the same number of iterations.
fn report(process: &str, name: &str, map: &DepthMap) -> Result<(), Box<dyn Error>> {
    let job = MillingJob::new(map, Profile::shipped(process)?, JobOptions::default())?;
    let options = SolveOptions::default();
    let straight_options = SolveOptions {
        iterations: options.iterations + options.free_iterations,
        free_iterations: 0,
        ..options
    };
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    let started = Instant::now();
    let free = job.solve(&options, go_on)?;
    let elapsed_s = started.elapsed().as_secs_f64();
    let straight = job.solve(&straight_options, go_on)?;
    let fine =
        Simulator::new(*job.grid(), &job.profile().process, FINER * job.simulator().substeps())?;
    let mut depth_um = job.start_um().to_vec();
    fine.mill(&free.path, &mut depth_um)?;
    println!(
        "{process:<16} {name:<10} {:>6} {:>9} {:>8.2} {:>11.3} {:>7.3} {:>14.3} {elapsed_s:>7.1} {:>19.3}",
        job.layers(),
        2 * free.path.y_um.len(),
        free.pixel_by_pixel.percent,
        straight.error.percent,
        free.error.percent,
        free.error.percent / straight.error.percent,
        job.objective().tracking_error(&depth_um)?.percent,
    );
    Ok(())
}
