//! What pulses earn that do not land where they are aimed: closed loops, which see every mark,
//! beside plans made once.
//!
//! Random shapes with ⌈area / 125⌉ pulses; every pulse is displaced by a Gaussian error of known
//! standard deviation, the same displacements for every decider. Prints the mean of reward · 10⁴ /
//! area as CSV, and its standard error.
//!
//! `cargo run --release -p lasergym-plan --features pretrained --example pointing_error -- [SHAPES]`

use std::error::Error;
use std::sync::Arc;

use lasergym_ablation::{Stream, Workpiece, random_shape};
use lasergym_plan::{
    Anneal, AnnealBudget, AnnealOptions, CmaEsBudget, CmaEsPlanner, Decider, FixedPlan, Foresight,
    Job, Planner, PolicyDecider, Pretrained, Replanning, ReplanningOptions, Thinking,
};

/// Seeds of the shapes that are kept for measurements.
const FIRST_SEED: u64 = 2_000_000_000;

/// Standard deviations, px.
const ERRORS_PX: [f64; 7] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0];

const DECIDERS: [&str; 6] = [
    "policy",
    "agent-mpc",
    "agent-mpc expecting errors",
    "anneal again",
    "anneal open loop",
    "cma-es open loop",
];

fn main() -> Result<(), Box<dyn Error>> {
    let shapes: u64 = std::env::args().nth(1).map_or(Ok(20), |text| text.parse())?;
    let agent = Arc::new(Pretrained::RandomShape.load()?);
    let jobs = (0..shapes)
        .map(|k| {
            let target = random_shape(&mut Stream::from_seed(FIRST_SEED + k)).target;
            Ok(Job::new(Workpiece::new(&target)?, 9.0, target.area_px().div_ceil(125) as usize)?)
        })
        .collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    let budget = AnnealBudget::Iterations(700_000);
    let anneal = Anneal { options: AnnealOptions { budget, ..AnnealOptions::default() } };
    let budget = CmaEsBudget::Evaluations(400_000);
    let cma_es = CmaEsPlanner { budget, ..CmaEsPlanner::default() };
    let plans = jobs
        .iter()
        .map(|job| Ok([anneal.plan_to_end(job)?.positions, cma_es.plan_to_end(job)?.positions]))
        .collect::<Result<Vec<_>, Box<dyn Error>>>()?;

    println!("pointing error / px,decider,reward / area,standard error");
    for error_px in ERRORS_PX {
        for (index, name) in DECIDERS.into_iter().enumerate() {
            let mut gains = Vec::new();
            for (k, (job, plans)) in jobs.iter().zip(&plans).enumerate() {
                let thinking = Thinking::Moves(5000);
                let mut decider: Box<dyn Decider> = match index {
                    0 => Box::new(PolicyDecider::new(Arc::clone(&agent))),
                    1 => Box::new(Foresight::new(Arc::clone(&agent), thinking, 0)),
                    2 => {
                        let foresight = Foresight::new(Arc::clone(&agent), thinking, 0);
                        Box::new(foresight.expecting(error_px)?)
                    }
                    3 => Box::new(Replanning::new(ReplanningOptions::default())?),
                    open => Box::new(FixedPlan::new(plans[open - 4].clone())?),
                };
                gains.push(gain(job, decider.as_mut(), error_px, k as u64)?);
            }
            let count = gains.len() as f64;
            let mean = gains.iter().sum::<f64>() / count;
            let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / count;
            println!("{error_px},{name},{mean:.4},{:.4}", (variance / count).sqrt());
        }
    }
    Ok(())
}

/// What a job gains over the area of its target.
fn gain(
    job: &Job,
    decider: &mut dyn Decider,
    error_px: f64,
    seed: u64,
) -> Result<f64, Box<dyn Error>> {
    let mut stream = Stream::from_seed(seed);
    let mut state = decider.start(job);
    let mut gain_px = 0;
    while state.pulses_left() > 0 {
        let Some(aimed) = decider.decide(&state)? else { break };
        gain_px += state.pulse(aimed + stream.displacement(error_px)).gain_px();
    }
    Ok(f64::from(gain_px) / f64::from(job.target().area_px()))
}
