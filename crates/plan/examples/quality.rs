//! How good the planners are, and how long they take: the static star with 40 and 45 pulses, and
//! random shapes with ⌈area / 125⌉ pulses.
//!
//! With a policy file also its plans, alone and thinking for 20 ms about each pulse.
//!
//! `cargo run --release -p lasergym-plan --example quality -- [SHAPES] [SECONDS] [FIRST_SEED] [POLICY]`

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lasergym_ablation::{Stream, Workpiece, random_shape, star};
use lasergym_geom::Bitmap;
use lasergym_plan::{
    AgentPlanner, Anneal, AnnealBudget, AnnealOptions, ForesightPlanner, Greedy, Job, Plan,
    Planner, PolicyAgent, Thinking,
};

/// Seeds of the shapes that are kept for measurements.
const FIRST_SEED: u64 = 2_000_000_000;

/// Target pixels per pulse.
const AREA_PER_PULSE_PX: u32 = 125;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let shapes: u64 = arguments.first().map_or(Ok(20), |text| text.parse())?;
    let seconds: f64 = arguments.get(1).map_or(Ok(1.0), |text| text.parse())?;
    let first_seed: u64 = arguments.get(2).map_or(Ok(FIRST_SEED), |text| text.parse())?;

    let agent = arguments.get(3).map(PolicyAgent::load).transpose()?.map(Arc::new);

    println!("static star: pulses, planner, reward, seconds");
    for pulses in [40, 45] {
        let job = job(&star(0.0), pulses)?;
        report(&job, "greedy", &Greedy::default())?;
        for time_s in [0.1, 1.0, 10.0] {
            if time_s <= seconds.max(1.0) {
                report(&job, &format!("anneal {time_s} s"), &anneal(time_s))?;
            }
        }
    }
    let mut planners: Vec<(&str, Box<dyn Planner>)> = vec![
        ("greedy", Box::new(Greedy::default())),
        ("greedy with ring", Box::new(Greedy { ring_weight: 0.35, ..Greedy::default() })),
        ("anneal", Box::new(anneal(seconds))),
    ];
    if let Some(agent) = agent {
        let thinking = Thinking::Time(Duration::from_millis(20));
        planners.push(("policy", Box::new(AgentPlanner { agent: Arc::clone(&agent) })));
        planners.push((
            "agent-mpc",
            Box::new(ForesightPlanner { agent, thinking, seed: 0, pointing_error_px: 0.0 }),
        ));
    }
    let mut sums = vec![(0.0, 0.0); planners.len()];
    for k in 0..shapes {
        let target = random_shape(&mut Stream::from_seed(first_seed + k)).target;
        let area_px = target.area_px();
        let job = job(&target, area_px.div_ceil(AREA_PER_PULSE_PX) as usize)?;
        for ((reward, time_s), (_, planner)) in sums.iter_mut().zip(&planners) {
            let start = Instant::now();
            *reward += planner.plan_to_end(&job)?.score.reward / job.reward_limit();
            *time_s += start.elapsed().as_secs_f64();
        }
    }
    println!("{shapes} random shapes: mean reward / largest possible reward, seconds");
    for ((name, _), (reward, time_s)) in planners.iter().zip(sums) {
        println!("{name:>18} {:.4} {:.4}", reward / shapes as f64, time_s / shapes as f64);
    }
    Ok(())
}

fn job(target: &Bitmap, pulses: usize) -> Result<Job, Box<dyn Error>> {
    Ok(Job::new(Workpiece::new(target)?, 9.0, pulses)?)
}

fn anneal(time_s: f64) -> Anneal {
    let budget = AnnealBudget::Time(Duration::from_secs_f64(time_s));
    Anneal { options: AnnealOptions { budget, ..AnnealOptions::default() } }
}

fn report(job: &Job, name: &str, planner: &dyn Planner) -> Result<Plan, Box<dyn Error>> {
    let start = Instant::now();
    let plan = planner.plan_to_end(job)?;
    let time_s = start.elapsed().as_secs_f64();
    println!("{:>4} {name:>14} {:.4} {time_s:.4}", job.max_pulses(), plan.score.reward);
    Ok(plan)
}
