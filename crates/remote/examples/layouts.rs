//! Cycle times of the joint choice and of the greedy ones on random layouts.
//!
//! `cargo run --release -p lasergym-remote --example layouts [LAYOUTS] [SUBTASKS] [SEED]`

use std::error::Error;

use lasergym_remote::{LineChoice, PlanOptions, RandomLayout, RemotePlan};

const CHOICES: [(&str, LineChoice); 4] = [
    ("initial path", LineChoice::Initial),
    ("greedy (paper), optimised", LineChoice::Greedy),
    ("greedy, any direction", LineChoice::GreedyAnyDirection),
    ("joint", LineChoice::Joint),
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| arguments.next().map_or(Ok(default), |text| text.parse());
    let (layouts, subtasks, seed) = (number(1000)?, number(30)?, number(0)?);
    let layout = RandomLayout { subtasks: subtasks as usize, ..RandomLayout::default() };
    let (mut cycle_s, mut lines) = ([0.0; CHOICES.len()], [0; CHOICES.len()]);
    let mut slower = 0;
    for index in 0..layouts {
        let task = layout.task(seed + index)?;
        let mut least_s = f64::INFINITY;
        for (k, (_, choice)) in CHOICES.iter().enumerate() {
            let options = PlanOptions { choice: *choice, ..PlanOptions::default() };
            let plan = RemotePlan::new(&task, &options)?;
            cycle_s[k] += plan.cycle_time_s;
            lines[k] += plan.lines.len();
            if *choice == LineChoice::Joint {
                slower += usize::from(plan.cycle_time_s > least_s + 1e-9);
            }
            least_s = least_s.min(plan.cycle_time_s);
        }
    }
    println!("{layouts} layouts of {subtasks} subtasks");
    println!("{:<28} {:>12} {:>8} {:>14}", "choice", "mean cycle s", "lines", "joint saves %");
    let joint_s = cycle_s[CHOICES.len() - 1];
    for (k, (name, _)) in CHOICES.iter().enumerate() {
        println!(
            "{name:<28} {:>12.3} {:>8.2} {:>14.2}",
            cycle_s[k] / layouts as f64,
            lines[k] as f64 / layouts as f64,
            100.0 * (1.0 - joint_s / cycle_s[k]),
        );
    }
    println!("layouts on which the joint choice is slower than another: {slower}");
    Ok(())
}
