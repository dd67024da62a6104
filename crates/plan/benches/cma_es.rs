//! Time of one generation without the objective, for 45 pulses of two coordinates and smaller.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use lasergym_plan::{Bounds, CmaEs, CmaEsOptions};

/// A cheap rugged cost, so that the run goes on adapting.
fn cost(x: &[f64]) -> f64 {
    x.iter().enumerate().map(|(i, x)| (1.0 + i as f64) * (x - 30.0).powi(2)).sum()
}

fn generation(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cma_es_generation");
    for (n, lambda) in [(10, 10), (40, 15), (90, 17), (90, 40), (90, 160)] {
        let options = CmaEsOptions {
            population_size: Some(lambda),
            bounds: Bounds::cube(n, 0.0, 100.0).ok(),
            ..CmaEsOptions::default()
        };
        let Ok(mut optimiser) = CmaEs::new(&vec![50.0; n], 20.0, options) else { return };
        let mut costs = vec![0.0; lambda];
        group.bench_function(BenchmarkId::from_parameter(format!("n={n},lambda={lambda}")), |b| {
            b.iter(|| {
                for (cost_k, x) in costs.iter_mut().zip(optimiser.ask().chunks_exact(n)) {
                    *cost_k = cost(x);
                }
                black_box(optimiser.tell(&costs))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, generation);
criterion_main!(benches);
