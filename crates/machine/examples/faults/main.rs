//! A campaign of faults: every driver call failing, hanging or lying, the disk too, and the process
//! dying anywhere. Nothing may be lost, doubled or fired where it must not.
//!
//! `cargo run --release -p lasergym-machine --example faults [FAULTS [SEED]]`

mod campaign;
mod disk;
#[allow(dead_code, reason = "shared with the tests of the closed loop")]
mod world;

use std::collections::BTreeMap;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let faults: u64 = arguments.next().map_or(Ok(10_000), |text| text.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let began = Instant::now();
    let tally = campaign::run_campaign(faults, seed, |tally| {
        if tally.jobs % 50 == 0 {
            eprintln!("{} faults in {} jobs", tally.faults(), tally.jobs);
        }
    });
    let mut by_call: BTreeMap<&str, u64> = BTreeMap::new();
    let mut by_kind: BTreeMap<String, u64> = BTreeMap::new();
    for (&(call, kind), &number) in &tally.injected {
        *by_call.entry(call).or_default() += number;
        *by_kind.entry(format!("{kind:?}")).or_default() += number;
    }
    println!("seed {seed}, {:.1} s", began.elapsed().as_secs_f64());
    println!("by call: {by_call:?}");
    println!("by kind: {by_kind:?}");
    println!(
        "{} faults in {} jobs and {} processes ({} died, {} found a damaged journal), {} marks",
        tally.faults(),
        tally.jobs,
        tally.processes,
        tally.deaths,
        tally.decays,
        tally.marks
    );
    for violation in &tally.violations {
        println!("VIOLATION {violation}");
    }
    println!("{} violations", tally.violations.len());
    if tally.violations.is_empty() { Ok(()) } else { Err("the machine broke its promises".into()) }
}
