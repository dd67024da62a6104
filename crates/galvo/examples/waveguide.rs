//! The waveguide filter of Penchev et al.: vectors across a channel at 2 m/s, 15 layers, with delays
//! only, postprocessed, and at a reduced speed.
//!
//! `cargo run --release -p lasergym-galvo --example waveguide`
//!
//! Vectors of 80 µm, and in a second channel a quarter of 40 µm; hatch 5 µm, back and forth, the
//! layers one after another. The depth at a place is the sum of Gaussian pulses on it, since the
//! paper's ablation rate is not known; edges are the outermost 10 µm that a spot covers fully (of the
//! first channel; the second has no single edge). Vectors are not shortened by the beam in any trial.

use std::error::Error;

use lasergym_galvo::{
    HeadKnowledge, Method, Observer, PostOptions, Postprocessor, ProgramRun, ProgramStep,
    PulseLanding, ScanHead, StrokeEnd,
};
use lasergym_geom::Point;
use lasergym_toolpath::VectorStep;

const SPEED_M_S: f64 = 2.0;
const LAYERS: u32 = 15;
const HATCH_UM: f64 = 5.0;
const LENGTH_UM: f64 = 2000.0;
const SPOT_UM: f64 = 20.0;
const PITCH_UM: f64 = 4.0;

/// Error of length that is allowed where the speed is reduced, µm: the ±10 µm of the paper.
const ALLOWED_UM: f64 = 10.0;

/// Dose across the channel, on a grid of 1 µm, and edge errors.
struct Dose {
    across: Vec<f64>,
    pulses: u64,
}

const HALF_WINDOW_UM: f64 = 150.0;

impl Observer for Dose {
    fn stroke_begins(&mut self, _start: &StrokeEnd) {}

    fn pulse(&mut self, pulse: &PulseLanding) {
        self.pulses += 1;
        // The hatch is fine beside the spot, so that the dose depends on the way across only.
        for (k, dose) in self.across.iter_mut().enumerate() {
            let y = k as f64 - HALF_WINDOW_UM;
            let r = (y - pulse.position_um.y) / (0.5 * SPOT_UM);
            *dose += (-2.0 * r * r).exp();
        }
    }
}

/// What a trial gives.
struct Trial {
    edge_over_centre: f64,
    width_um: f64,
    time_s: f64,
}

/// Half the width of the channel at `x`, µm.
fn half_width_um(x: f64, irises: bool) -> f64 {
    let in_iris = irises && x.rem_euclid(500.0) < 125.0;
    if in_iris { 20.0 } else { 40.0 }
}

fn trial(head: &ScanHead, options: PostOptions, irises: bool) -> Result<Trial, Box<dyn Error>> {
    let knowledge = HeadKnowledge::of_head(head);
    let dose = Dose { across: vec![0.0; 2 * HALF_WINDOW_UM as usize + 1], pulses: 0 };
    let mut run = ProgramRun::new(head, dose);
    let mut post =
        Postprocessor::new(head, &knowledge, options, |step: &ProgramStep| run.step(step))?;
    let mut side = 1.0;
    for _ in 0..LAYERS {
        let mut x = 0.0;
        while x <= LENGTH_UM {
            let half_um = half_width_um(x, irises);
            post.step(&VectorStep::Jump { to_um: Point::new(x, -side * half_um) })?;
            post.step(&VectorStep::Mark { to_um: Point::new(x, side * half_um), speed_m_s: None })?;
            side = -side;
            x += HATCH_UM;
        }
    }
    post.finish()?;
    let (dose, split, _) = run.finish()?;
    let at = |y: f64| dose.across[(y + HALF_WINDOW_UM) as usize];
    let mean = |from: i32, to: i32| {
        (from..=to).map(|y| at(f64::from(y))).sum::<f64>() / f64::from(to - from + 1)
    };
    // The spot covers places fully from its radius inside the edge on.
    let (inner, outer) = (20, 30);
    let edges = [mean(-outer, -inner), mean(inner, outer)];
    let centre = mean(-5, 5);
    let half = 0.5 * centre;
    let width_um = dose.across.iter().filter(|&&value| value >= half).count() as f64;
    Ok(Trial {
        edge_over_centre: edges.iter().map(|edge| edge / centre).fold(1.0, |worst, ratio: f64| {
            if (ratio - 1.0).abs() > (worst - 1.0_f64).abs() { ratio } else { worst }
        }),
        width_um,
        time_s: split.total_s(),
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut head = ScanHead::default();
    head.laser.spot_um = SPOT_UM;
    let lag_us = head.x.lag_us();
    let fast = PostOptions {
        speed_m_s: Some(SPEED_M_S),
        beam_um: 0.0,
        pitch_um: Some(PITCH_UM),
        tolerance: 0.05,
        ..PostOptions::default()
    };
    // Jumps between vectors are a hatch apart or shorter than a run-in: no wait after them.
    let hatch = PostOptions { jump_delay_us: Some(0.0), mark_delay_us: Some(0.0), ..fast };
    let slow = PostOptions {
        method: Method::None,
        speed_m_s: Some(ALLOWED_UM / lag_us),
        jump_delay_us: Some(0.0),
        mark_delay_us: Some(0.0),
        ..fast
    };
    println!("channel  trial                            edge/centre  width µm   time s  slow/this");
    for (channel, irises) in [("80 µm", false), ("irises", true)] {
        let reduced = trial(&head, slow, irises)?;
        for (name, options) in [
            ("2 delays only", PostOptions { method: Method::DelaysOnly, ..fast }),
            ("3 postprocessed, usual delays", fast),
            ("3 postprocessed, no waits", hatch),
            ("3 postprocessed, no waits, 2 %", PostOptions { tolerance: 0.02, ..hatch }),
            ("4 reduced speed", slow),
        ] {
            let found = trial(&head, options, irises)?;
            println!(
                "{channel:<8} {name:<32} {:>11.3} {:>9.1} {:>8.3} {:>10.2}",
                found.edge_over_centre,
                found.width_um,
                found.time_s,
                reduced.time_s / found.time_s
            );
        }
    }
    Ok(())
}
