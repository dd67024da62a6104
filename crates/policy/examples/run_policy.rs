//! Runs a policy file on an observation of zeros and prints the action:
//! `cargo run --example run_policy FILE`.

use std::error::Error;

use lasergym_policy::Network;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("give the path of a policy file")?;
    let network = Network::load(&path)?;
    let mut scratch = network.scratch();
    let observation = vec![0.0; network.input().values()];
    let action = network.act(&observation, &mut scratch)?;
    println!("{} -> {}", network.input(), network.output());
    println!("decision {}", network.manifest().decision);
    println!("action {action:?}");
    Ok(())
}
