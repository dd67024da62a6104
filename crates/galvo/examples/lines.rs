//! The 2 mm lines of Penchev et al. on each head that comes with the crate: without compensation,
//! with delays only, and postprocessed with a calibration from 4 noisy lines, without and with
//! their acceleration times, and with a model.
//!
//! `cargo run --release -p lasergym-galvo --example lines`

use std::error::Error;

use lasergym_galvo::{
    AccelerationEnd, Calibration, HeadKnowledge, Method, PostOptions, Postprocessor, ProgramStep,
    ScanHead, StrokeMeasure, TestLine, measure_line, simulate_steps,
};
use lasergym_geom::Point;
use lasergym_toolpath::VectorStep;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

const SPEEDS_M_S: [f64; 4] = [0.5, 1.0, 1.5, 2.0];
const LENGTH_UM: f64 = 2000.0;
const BEAM_UM: f64 = 40.0;
const PITCH_UM: f64 = 40.0;
const TOLERANCE: f64 = 0.02;
const REPEATS: u32 = 10;

/// Standard deviation of measured lengths, µm.
const NOISE_UM: f64 = 1.5;

/// Four lines, one at each speed, measured with noise; with their acceleration times when `timed`.
fn noisy_calibration(
    head: &ScanHead,
    timed: bool,
    generator: &mut Pcg64,
) -> Result<Calibration, Box<dyn Error>> {
    let noise = Normal::new(0.0, NOISE_UM)?;
    let mut lines: Vec<TestLine> = Vec::new();
    for speed in SPEEDS_M_S {
        let end = AccelerationEnd::StaysWithin(TOLERANCE);
        let mut line = measure_line(head, speed, 4000.0, 0.0, end)?;
        line.measured_um += noise.sample(generator);
        line.acceleration_um += noise.sample(generator);
        if !timed {
            line.acceleration_time_us = None;
        }
        lines.push(line);
    }
    Ok(Calibration::fit(&lines)?)
}

/// Every line of the table: `REPEATS` lines at each speed in evenly turned directions.
fn lines(
    head: &ScanHead,
    knowledge: &HeadKnowledge,
    method: Method,
    speed_m_s: f64,
) -> Result<Vec<StrokeMeasure>, Box<dyn Error>> {
    let options = PostOptions {
        method,
        speed_m_s: Some(speed_m_s),
        beam_um: BEAM_UM,
        pitch_um: Some(PITCH_UM),
        tolerance: TOLERANCE,
        ..PostOptions::default()
    };
    let mut steps: Vec<ProgramStep> = Vec::new();
    let mut post = Postprocessor::new(head, knowledge, options, |step: &ProgramStep| {
        steps.push(*step);
        Ok(())
    })?;
    for k in 0..REPEATS {
        let angle = f64::from(k) * std::f64::consts::TAU / f64::from(REPEATS);
        let arm = Point::new(angle.cos(), angle.sin()) * (0.5 * LENGTH_UM);
        let center = Point::new(0.0, 500.0 * f64::from(k));
        post.step(&VectorStep::Jump { to_um: center - arm })?;
        post.step(&VectorStep::Mark { to_um: center + arm, speed_m_s: None })?;
    }
    post.finish()?;
    let mut measures = Vec::new();
    simulate_steps(head, &steps, |measure| measures.push(*measure))?;
    Ok(measures)
}

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "head               knowledge  method    V m/s  length error µm (min … max)  spread  edges µm  pitch"
    );
    let mut generator = Pcg64::seed_from_u64(1);
    for (name, _) in ScanHead::shipped_texts() {
        let head = ScanHead::shipped(name)?;
        let lines_known = HeadKnowledge::lines(noisy_calibration(&head, false, &mut generator)?);
        let timed_known = HeadKnowledge::lines(noisy_calibration(&head, true, &mut generator)?);
        let model_known = HeadKnowledge::model(head.x.clone());
        for (knows, knowledge, method, called) in [
            ("lines", &lines_known, Method::None, "none"),
            ("lines", &lines_known, Method::DelaysOnly, "delays"),
            ("lines", &lines_known, Method::Adaptive, "adaptive"),
            ("timed", &timed_known, Method::Adaptive, "adaptive"),
            ("model", &model_known, Method::Adaptive, "adaptive"),
        ] {
            for speed in SPEEDS_M_S {
                let measures = lines(&head, knowledge, method, speed)?;
                let range = |value: fn(&StrokeMeasure) -> f64| {
                    let values = measures.iter().map(value);
                    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                        (low.min(v), high.max(v))
                    })
                };
                let (short, long) = range(|m| m.length_error_um);
                let edges = range(|m| m.start_error_um.abs().max(m.end_error_um.abs())).1;
                let (low, high) = (range(|m| m.pitch_min).0, range(|m| m.pitch_max).1);
                println!(
                    "{name:<18} {knows:<10} {called:<9} {speed:>5}  {short:>12.2} … {long:<12.2}  {:>6.2}  {edges:>8.2}  {low:.3}–{high:.3}",
                    long - short
                );
            }
        }
    }
    Ok(())
}
