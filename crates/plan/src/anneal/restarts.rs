//! Independent restarts, on one or several threads.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use crate::{Job, PlanError};

use super::lattice::{Lattice, Place};
use super::metropolis::BestPlaces;
use super::options::{AnnealBudget, AnnealOptions};
use super::run::{Report, run};
use super::window::Window;

/// The best of all restarts, and whether `report` stopped them.
pub(super) struct Outcome {
    pub(super) best: BestPlaces,
    pub(super) stopped: bool,
}

/// Runs all restarts from `start`. Of equal results that of the first restart counts, so that an
/// iteration budget gives the same plan for any number of threads.
pub(super) fn run_restarts<W: Window>(
    job: &Job,
    lattice: &Lattice,
    options: &AnnealOptions,
    start: &[Place],
    report: &mut Report<'_>,
) -> Result<Outcome, PlanError> {
    let threads = options.threads.min(options.restarts);
    let budget = match options.budget {
        AnnealBudget::Time(time) => {
            AnnealBudget::Time(time / options.restarts.div_ceil(threads) as u32)
        }
        iterations @ AnnealBudget::Iterations(_) => iterations,
    };
    let run_one = |restart: usize, report: &mut Report<'_>| {
        run::<W>(job, lattice, options, budget, start, restart, report)
    };
    if threads == 1 {
        return Ok(one_after_another(options.restarts, run_one, report));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| PlanError::Threads { threads, reason: error.to_string() })?;
    Ok(side_by_side(&pool, options.restarts, run_one, report))
}

/// All restarts on this thread.
fn one_after_another(
    restarts: usize,
    run_one: impl Fn(usize, &mut Report<'_>) -> BestPlaces,
    report: &mut Report<'_>,
) -> Outcome {
    let mut best: Option<BestPlaces> = None;
    let mut stopped = false;
    for restart in 0..restarts {
        let found = run_one(restart, &mut |fraction, found| {
            let best_yet = best.as_ref().filter(|best| best.gain_px >= found.gain_px);
            let flow =
                report((restart as f64 + fraction) / restarts as f64, best_yet.unwrap_or(found));
            stopped = flow.is_break();
            flow
        });
        if best.as_ref().is_none_or(|best| found.gain_px > best.gain_px) {
            best = Some(found);
        }
        if stopped {
            break;
        }
    }
    Outcome { best: best.unwrap_or_default(), stopped }
}

/// What a worker tells the thread that reports.
struct Message {
    restart: usize,
    fraction: f64,
    /// The best of the restart, when it is better than what this restart told before.
    better: Option<BestPlaces>,
}

/// The restarts on the threads of `pool`; this thread collects and reports.
fn side_by_side(
    pool: &rayon::ThreadPool,
    restarts: usize,
    run_one: impl Fn(usize, &mut Report<'_>) -> BestPlaces + Sync,
    report: &mut Report<'_>,
) -> Outcome {
    let stop = AtomicBool::new(false);
    let (sender, receiver) = mpsc::channel::<Message>();
    let mut best: Vec<Option<BestPlaces>> = vec![None; restarts];
    let mut fractions = vec![0.0; restarts];
    let (stop, run_one) = (&stop, &run_one);
    pool.in_place_scope_fifo(|scope| {
        for restart in 0..restarts {
            let sender = sender.clone();
            scope.spawn_fifo(move |_| {
                if restart > 0 && stop.load(Ordering::Relaxed) {
                    return;
                }
                let mut told_px = None;
                let found = run_one(restart, &mut |fraction, best| {
                    let better = told_px.is_none_or(|told_px| best.gain_px > told_px);
                    told_px = Some(best.gain_px);
                    let better = better.then(|| best.clone());
                    // The receiver outlives the workers: sending cannot fail.
                    let _ = sender.send(Message { restart, fraction, better });
                    if stop.load(Ordering::Relaxed) {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                });
                let _ = sender.send(Message { restart, fraction: 1.0, better: Some(found) });
            });
        }
        drop(sender);
        for message in receiver {
            fractions[message.restart] = message.fraction;
            if message.better.is_some() {
                best[message.restart] = message.better;
            }
            let fraction = fractions.iter().sum::<f64>() / restarts as f64;
            if let Some(best) = best_of(&best)
                && !stop.load(Ordering::Relaxed)
                && report(fraction, best).is_break()
            {
                stop.store(true, Ordering::Relaxed);
            }
        }
    });
    Outcome {
        best: best_of(&best).cloned().unwrap_or_default(),
        stopped: stop.load(Ordering::Relaxed),
    }
}

/// The best of all, the first of several.
fn best_of(found: &[Option<BestPlaces>]) -> Option<&BestPlaces> {
    found
        .iter()
        .flatten()
        .reduce(|best, other| if other.gain_px > best.gain_px { other } else { best })
}
