//! Times runs of a policy file on one thread: `cargo run --release --example time_forward FILE`.
//!
//! Prints the size of the network and the time of one run, median and 99th percentile in µs.

use std::error::Error;
use std::time::Instant;

use lasergym_policy::Network;

/// Runs before the clock starts, and runs that are timed.
const WARM_UP: usize = 50;
const RUNS: usize = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("give the path of a policy file")?;
    let network = Network::load(&path)?;
    let mut scratch = network.scratch();
    let observation: Vec<f32> =
        (0..network.input().values()).map(|index| (index % 256) as f32).collect();
    for _ in 0..WARM_UP {
        network.run(&observation, &mut scratch)?;
    }
    let mut times_us = Vec::with_capacity(RUNS);
    for _ in 0..RUNS {
        let start = Instant::now();
        network.run(&observation, &mut scratch)?;
        times_us.push(start.elapsed().as_secs_f64() * 1e6);
    }
    times_us.sort_by(f64::total_cmp);
    println!(
        "{} -> {}, {} parameters, {:.2} million multiplications",
        network.input(),
        network.output(),
        network.parameters(),
        network.multiplications() as f64 * 1e-6
    );
    println!("p50 {:.1} us, p99 {:.1} us", times_us[RUNS / 2], times_us[RUNS * 99 / 100]);
    Ok(())
}
