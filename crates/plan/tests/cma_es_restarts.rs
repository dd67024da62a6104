//! Restarted runs: multimodal functions, budgets, cancelling and thread counts.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use lasergym_plan::{
    Bounds, CmaEsError, CmaEsOptions, MAX_GROWTHS, Minimum, Progress, Restarts, Termination,
    minimise, minimise_population,
};

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|x| 10.0 + x * x - 10.0 * (2.0 * PI * x).cos()).sum()
}

fn on(_: &Progress<'_>) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn rastrigin_options(seed: u64) -> CmaEsOptions {
    CmaEsOptions {
        seed,
        bounds: Bounds::cube(5, -5.0, 5.0).ok(),
        target_cost: Some(1e-8),
        max_evaluations: Some(200_000),
        ..CmaEsOptions::default()
    }
}

#[test]
fn restarts_find_the_global_minimum_of_rastrigins_function() {
    for restarts in [Restarts::Ipop { factor: 2.0 }, Restarts::Bipop] {
        for seed in 0..3 {
            let minimum =
                minimise(rastrigin, &[3.0; 5], 2.0, &rastrigin_options(seed), restarts, on)
                    .unwrap();
            assert!(minimum.cost <= 1e-8, "{restarts:?} {seed} {minimum:?}");
            assert!(matches!(minimum.termination, Termination::TargetReached { .. }));
            assert!(minimum.runs > 1);
        }
    }
}

#[test]
fn without_restarts_there_is_one_run() {
    let minimum =
        minimise(rastrigin, &[3.0; 5], 0.1, &rastrigin_options(0), Restarts::None, on).unwrap();
    assert_eq!(minimum.runs, 1);
    assert!(minimum.evaluations < 200_000);
}

#[test]
fn ipop_doubles_the_population() {
    let mut populations = Vec::new();
    let options = CmaEsOptions { target_cost: None, ..rastrigin_options(1) };
    let record = |progress: &Progress<'_>| {
        if populations.len() == progress.run {
            populations.push(progress.population_size);
        }
        ControlFlow::Continue(())
    };
    let restarts = Restarts::Ipop { factor: 2.0 };
    let minimum = minimise(rastrigin, &[3.0; 5], 2.0, &options, restarts, record).unwrap();
    assert!(populations.len() > 3);
    assert_eq!(populations.len(), minimum.runs);
    assert!(populations.windows(2).all(|pair| pair[1] == 2 * pair[0]));
}

#[test]
fn bipop_shares_the_evaluations_between_its_regimes() {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    let options = CmaEsOptions { target_cost: None, ..rastrigin_options(1) };
    let record = |progress: &Progress<'_>| {
        runs.resize(progress.run + 1, (0, 0));
        runs[progress.run] =
            (progress.population_size, progress.generation * progress.population_size);
        ControlFlow::Continue(())
    };
    let minimum = minimise(rastrigin, &[3.0; 5], 2.0, &options, Restarts::Bipop, record).unwrap();
    assert_eq!(runs.iter().map(|run| run.1).sum::<usize>(), minimum.evaluations);
    let mut largest = 0;
    let (mut large, mut small) = (0, 0);
    for &(population, evaluations) in &runs[..runs.len() - 1] {
        if population > largest {
            assert!(small >= large || large == 0 || largest == 8);
            large += evaluations;
            largest = population;
        } else {
            assert!(population <= largest / 2 || largest <= 16);
            assert!(small < large);
            small += evaluations;
        }
    }
    assert!(largest >= 64 && small > 0);
}

#[test]
fn the_evaluation_limit_covers_all_runs() {
    for restarts in [Restarts::None, Restarts::Ipop { factor: 2.0 }, Restarts::Bipop] {
        let options =
            CmaEsOptions { target_cost: None, max_evaluations: Some(5000), ..rastrigin_options(4) };
        let minimum = minimise(rastrigin, &[3.0; 5], 2.0, &options, restarts, on).unwrap();
        assert!(minimum.evaluations <= 5000);
        if restarts != Restarts::None {
            assert_eq!(
                minimum.termination,
                Termination::MaxEvaluations { evaluations: minimum.evaluations }
            );
        }
    }
}

#[test]
fn without_a_limit_the_population_stops_growing() {
    for restarts in [Restarts::Ipop { factor: 1.5 }, Restarts::Bipop] {
        let mut largest = 0;
        let record = |progress: &Progress<'_>| {
            largest = largest.max(progress.population_size);
            ControlFlow::Continue(())
        };
        // A flat cost ends each run after a few generations.
        let minimum =
            minimise(|_| 0.0, &[0.5; 2], 0.1, &CmaEsOptions::default(), restarts, record).unwrap();
        assert!(minimum.runs > MAX_GROWTHS as usize);
        assert!(matches!(minimum.termination, Termination::EqualFunctionValues { .. }));
        let factor: f64 = if restarts == Restarts::Bipop { 2.0 } else { 1.5 };
        assert_eq!(largest, (6.0 * factor.powf(f64::from(MAX_GROWTHS))).round() as usize);
    }
}

#[test]
fn cancelling_keeps_the_best_so_far() {
    let mut seen = f64::INFINITY;
    let minimum =
        minimise(rastrigin, &[3.0; 5], 2.0, &rastrigin_options(0), Restarts::Bipop, |progress| {
            seen = progress.best_cost;
            if progress.evaluations >= 80 { ControlFlow::Break(()) } else { on(progress) }
        })
        .unwrap();
    assert_eq!(minimum.termination, Termination::Cancelled);
    assert_eq!(minimum.evaluations, 80);
    assert_eq!(minimum.cost.to_bits(), seen.to_bits());
    assert_eq!(rastrigin(&minimum.x).to_bits(), minimum.cost.to_bits());
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let with_threads = |threads| -> Minimum {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = CmaEsOptions { max_evaluations: Some(10_000), ..rastrigin_options(9) };
        pool.install(|| minimise(rastrigin, &[3.0; 5], 2.0, &options, Restarts::Bipop, on)).unwrap()
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn a_population_objective_gives_the_same_bits() {
    let options = CmaEsOptions { max_evaluations: Some(10_000), ..rastrigin_options(9) };
    let score = |population: &[f64], costs: &mut [f64]| {
        for (cost, x) in costs.iter_mut().zip(population.chunks_exact(5)) {
            *cost = rastrigin(x);
        }
    };
    let restarts = Restarts::Ipop { factor: 2.0 };
    assert_eq!(
        minimise_population(score, &[3.0; 5], 2.0, &options, restarts, on),
        minimise(rastrigin, &[3.0; 5], 2.0, &options, restarts, on)
    );
}

#[test]
fn an_objective_of_nan_is_an_error() {
    assert_eq!(
        minimise(|_| f64::NAN, &[0.0; 2], 1.0, &CmaEsOptions::default(), Restarts::Bipop, on),
        Err(CmaEsError::AllCostsNan { generation: 0 })
    );
}
