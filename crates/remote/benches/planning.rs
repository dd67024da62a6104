//! How long planning takes: the eight holes of the paper, and random layouts.

use std::error::Error;
use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use lasergym_remote::{PlanOptions, RandomLayout, RemotePlan, RemoteTask};

const HOLES: &str = include_str!("../../../tests/assets/heat_exchanger.toml");

fn planning(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let mut group = criterion.benchmark_group("plan");
    let mut tasks = vec![("eight holes".to_owned(), RemoteTask::from_toml(HOLES, None)?)];
    for subtasks in [30, 1000, 10_000] {
        let layout = RandomLayout { subtasks, ..RandomLayout::default() };
        tasks.push((format!("{subtasks} subtasks"), layout.task(0)?));
    }
    for (name, task) in &tasks {
        group.sample_size(if task.subtasks.len() > 100 { 10 } else { 50 });
        group.bench_function(name, |bench| {
            bench.iter_batched(
                || task,
                |task| black_box(RemotePlan::new(task, &PlanOptions::default())),
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    if let Err(error) = planning(criterion) {
        eprintln!("{error}");
    }
}

criterion_group!(all, benches);
criterion_main!(all);
