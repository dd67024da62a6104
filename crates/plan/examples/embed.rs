//! The inner loop of a machine controller: a trained policy decides, the laser fires, the camera
//! says what was machined. Here the camera sees exactly what was commanded.
//!
//! `cargo run --release -p lasergym-plan --example embed -- POLICY.safetensors`

use std::error::Error;
use std::time::Instant;

use lasergym_ablation::{Workpiece, star};
use lasergym_plan::{Job, PolicyAgent};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("give the path of a policy file")?;
    let agent = PolicyAgent::load(path)?;
    let mut memory = agent.memory();
    let mut seen = Workpiece::new(&star(0.0))?;
    let mut gain_px = 0;
    for pulses_left in (1..=40).rev() {
        // What the camera sees is the job that is left.
        let state = agent.start(&Job::new(seen.clone(), 9.0, pulses_left)?);
        if state.is_finished() {
            break;
        }
        let started = Instant::now();
        let position = agent.decide(&state, &mut memory)?;
        let time_us = started.elapsed().as_secs_f64() * 1e6;
        gain_px += seen.pulse(&state.job().footprint(position)).gain_px();
        println!("({:6.3}, {:6.3}) px, decided in {time_us:.0} µs", position.x, position.y);
    }
    println!("reward {:.4}", f64::from(gain_px) / 1e4);
    Ok(())
}
