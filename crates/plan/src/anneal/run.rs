//! One restart from its start to the end of its budget.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::{GainMap, Job};

use super::cover::Cover;
use super::lattice::{Lattice, Place};
use super::metropolis::{BestPlaces, MoveOdds, NormalQuantiles, Walk};
use super::options::{AnnealBudget, AnnealOptions, MOVES_PER_REPLACEMENT};
use super::replacement::{GumbelNoise, replace_pulses};
use super::schedule::Schedule;
use super::window::Window;

/// Metropolis moves between two looks at the clock, at one temperature.
const MOVES_AT_ONCE: u64 = 2048;

/// Re-placements between two looks at the clock, at one temperature.
const REPLACEMENTS_AT_ONCE: u64 = 32;

/// Time between two reports.
const REPORT_EVERY: Duration = Duration::from_millis(20);

/// What a restart tells while it runs: part of its budget spent and its best so far.
pub(super) type Report<'a> = dyn FnMut(f64, &BestPlaces) -> ControlFlow<()> + 'a;

/// Runs one restart from `start` within `budget`. Stops early when `report` says so.
pub(super) fn run<W: Window>(
    job: &Job,
    lattice: &Lattice,
    options: &AnnealOptions,
    budget: AnnealBudget,
    start: &[Place],
    restart: usize,
    report: &mut Report<'_>,
) -> BestPlaces {
    // Streams of different restarts are far apart in the generator's sequence.
    let mut rng = Pcg64Mcg::seed_from_u64(options.seed.wrapping_add((restart as u64) << 40));
    let mut gains = GainMap::new(job.workpiece(), job.pulse_radius_px());
    let mut walk = Walk {
        cover: Cover::<W>::new(job.workpiece(), lattice, start.len()),
        places: start.to_vec(),
        gain_px: 0,
    };
    for &place in start {
        walk.gain_px +=
            walk.cover.fire(place, |row, hits, misses| gains.machined(row, hits, misses));
    }
    let mut best = BestPlaces { gain_px: walk.gain_px, places: start.to_vec() };
    let mut last_report = Instant::now();
    if report(0.0, &best).is_break() {
        return best;
    }
    let share = options.replacement_share;
    let mut schedule = Schedule::new(budget, share, MOVES_PER_REPLACEMENT);
    while let ControlFlow::Continue(count) = schedule.next(REPLACEMENTS_AT_ONCE) {
        let fraction = schedule.fraction();
        let noise = GumbelNoise::new(options.replacement_temperature_px.at(fraction));
        replace_pulses(&mut walk, &mut gains, count, &noise, &mut rng, &mut best);
        if last_report.elapsed() >= REPORT_EVERY {
            last_report = Instant::now();
            if report(share * fraction, &best).is_break() {
                return best;
            }
        }
    }
    let normal = NormalQuantiles::new();
    let mut schedule = Schedule::new(budget, 1.0 - share, 1);
    while let ControlFlow::Continue(count) = schedule.next(MOVES_AT_ONCE) {
        let fraction = schedule.fraction();
        let odds = MoveOdds::new(
            &normal,
            options.temperature_px.at(fraction),
            options.step_px.at(fraction),
            options.jump_share,
        );
        walk.metropolis(count, start.len(), &odds, &mut rng, &mut best);
        if last_report.elapsed() >= REPORT_EVERY {
            last_report = Instant::now();
            if report(share + (1.0 - share) * fraction, &best).is_break() {
                return best;
            }
        }
    }
    best
}
