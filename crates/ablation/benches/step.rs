//! Steps of a batch of environments with random actions, resets included, and random shapes.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lasergym_ablation::{
    Action, Autoreset, Batch, BatchOptions, Environment, Footprint, ObservationMode, Options,
    Pulse, Stream, Task, Workpiece, random_shape, star,
};
use lasergym_geom::Point;

/// Actions uniform on the workpiece, the same in every run.
fn random_actions(count: usize) -> Vec<Action> {
    let mut stream = Stream::from_seed(1);
    let mut component = || (2.0 * stream.uniform() - 1.0) as f32;
    (0..count).map(|_| [component(), component()]).collect()
}

fn batches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step of one environment");
    for (name, task) in [("star", Task::Star), ("random shape", Task::RandomShape)] {
        for environments in [1, 64, 1024, 16_384] {
            let options = BatchOptions {
                environments,
                autoreset: Autoreset::NextStep,
                observation: ObservationMode::Remaining,
                max_episode_steps: None,
                threads: 1,
            };
            let environment = Environment::new(task.clone(), Options::default());
            let Ok(mut batch) = environment.and_then(|one| Batch::new(one, options)) else {
                continue;
            };
            let mut observations = vec![0; environments * options.observation.len()];
            let seeds: Vec<_> = (0..environments as u64).map(Some).collect();
            if batch.reset(&seeds, None, &mut observations).is_err() {
                continue;
            }
            let actions = random_actions(64 * environments);
            let mut rounds = actions.chunks_exact(environments).cycle();
            group.throughput(Throughput::Elements(environments as u64));
            group.bench_function(format!("{name}, {environments}"), |bencher| {
                bencher.iter(|| {
                    let actions = rounds.next().unwrap_or_default();
                    batch.step(actions, &mut observations, &mut [])
                });
            });
        }
    }
    group.finish();
}

fn parts(criterion: &mut Criterion) {
    let mut stream = Stream::from_seed(2);
    criterion.bench_function("kept random shape", |bencher| {
        bencher.iter(|| random_shape(&mut stream));
    });
    let mut position = move || Point::new(100.0 * stream.uniform(), 100.0 * stream.uniform());
    criterion.bench_function("footprint", |bencher| {
        bencher.iter(|| Footprint::of(Pulse { position: position(), radius_px: 9.0 }));
    });
    let workpiece = Workpiece::partly_machined(&star(0.0), &star(0.0).complement());
    criterion.bench_function("preview of a pulse", |bencher| {
        bencher.iter(|| {
            workpiece.preview(&Footprint::of(Pulse { position: position(), radius_px: 9.0 }))
        });
    });
}

criterion_group!(benches, batches, parts);
criterion_main!(benches);
