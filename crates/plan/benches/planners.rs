//! The parts of the planners and the quick planners as a whole, on the static star.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lasergym_ablation::{Stream, Workpiece, star};
use lasergym_geom::Point;
use lasergym_plan::{
    Anneal, AnnealBudget, AnnealOptions, GainMap, Greedy, Job, MOVES_PER_REPLACEMENT, Planner,
    PolishOptions, Raster, polish,
};

/// Iterations of an annealing that is timed.
const ITERATIONS: u64 = 200_000;

fn job() -> Option<Job> {
    Job::new(Workpiece::new(&star(0.0)).ok()?, 9.0, 45).ok()
}

fn quick_planners(criterion: &mut Criterion) {
    let Some(job) = job() else { return };
    criterion.bench_function("raster", |b| b.iter(|| Raster::default().plan_to_end(&job)));
    criterion.bench_function("greedy", |b| b.iter(|| Greedy::default().plan_to_end(&job)));
    let ring = Greedy { ring_weight: 0.35, ..Greedy::default() };
    criterion.bench_function("greedy with ring", |b| b.iter(|| ring.plan_to_end(&job)));
}

fn parts(criterion: &mut Criterion) {
    let Some(job) = job() else { return };
    let mut stream = Stream::from_seed(1);
    let mut position = move || Point::new(100.0 * stream.uniform(), 100.0 * stream.uniform());
    let mut map = GainMap::new(job.workpiece(), job.pulse_radius_px());
    let mut workpiece = job.workpiece().clone();
    let mut changes = Vec::new();
    criterion.bench_function("gain map, pulse and un-pulse", |b| {
        b.iter(|| {
            workpiece.clone_from(job.workpiece());
            workpiece.pulse_with(&job.footprint(position()), |row, hits, misses| {
                map.machined(row, hits, misses);
                changes.push((row, hits, misses));
            });
            for (row, hits, misses) in changes.drain(..) {
                map.restored(row, hits, misses);
            }
        });
    });
    criterion.bench_function("best of the gain map", |b| b.iter(|| black_box(&map).best()));
    criterion.bench_function("polish", |b| {
        let start = Point::new(50.5, 30.5);
        let gain_px = |position| job.workpiece().preview(&job.footprint(position)).gain_px();
        b.iter(|| polish(start, PolishOptions::default(), gain_px));
    });
}

/// Time of one annealing iteration, from plans that only re-place and only move.
fn anneal(criterion: &mut Criterion) {
    let Some(job) = job() else { return };
    let mut group = criterion.benchmark_group("anneal");
    group.sample_size(20);
    for (name, replacement_share, iterations) in [
        ("Metropolis move", 0.0, ITERATIONS),
        ("re-placement", 1.0, ITERATIONS / MOVES_PER_REPLACEMENT),
    ] {
        let budget = AnnealBudget::Iterations(ITERATIONS);
        let options = AnnealOptions { budget, replacement_share, ..AnnealOptions::default() };
        let anneal = Anneal { options };
        group.throughput(Throughput::Elements(iterations));
        group.bench_function(name, |b| b.iter(|| anneal.plan_to_end(&job)));
    }
    group.finish();
}

criterion_group!(benches, quick_planners, parts, anneal);
criterion_main!(benches);
