//! Each invalid setting has its own error.
#![allow(clippy::unwrap_used)]

use lasergym_plan::{
    Bounds, CmaEs, CmaEsError, CmaEsOptions, MAX_POPULATION_VALUES, Restarts, Tolerances, minimise,
};
use std::ops::ControlFlow;

fn error(start: &[f64], sigma: f64, options: CmaEsOptions) -> CmaEsError {
    CmaEs::new(start, sigma, options).unwrap_err()
}

fn defaults() -> CmaEsOptions {
    CmaEsOptions::default()
}

#[test]
fn an_empty_start_is_refused() {
    assert_eq!(error(&[], 1.0, defaults()), CmaEsError::EmptyStart);
}

#[test]
fn a_start_that_is_not_finite_is_refused() {
    assert!(matches!(
        error(&[0.0, f64::NAN], 1.0, defaults()),
        CmaEsError::NonFiniteStart { index: 1, value } if value.is_nan()
    ));
}

#[test]
fn a_step_size_that_is_not_positive_is_refused() {
    assert_eq!(error(&[0.0], 0.0, defaults()), CmaEsError::BadSigma { sigma: 0.0 });
    assert_eq!(error(&[0.0], -1.0, defaults()), CmaEsError::BadSigma { sigma: -1.0 });
}

#[test]
fn a_step_size_that_is_not_finite_is_refused() {
    assert!(matches!(error(&[0.0], f64::NAN, defaults()), CmaEsError::BadSigma { .. }));
    assert!(matches!(error(&[0.0], f64::INFINITY, defaults()), CmaEsError::BadSigma { .. }));
}

#[test]
fn a_population_of_three_is_refused() {
    let options = CmaEsOptions { population_size: Some(3), ..defaults() };
    assert_eq!(
        error(&[0.0; 2], 1.0, options),
        CmaEsError::PopulationTooSmall { population_size: 3, minimum: 4 }
    );
}

#[test]
fn a_population_beyond_memory_is_refused() {
    let options = CmaEsOptions { population_size: Some(usize::MAX), ..defaults() };
    assert_eq!(
        error(&[0.0; 2], 1.0, options),
        CmaEsError::ProblemTooLarge {
            dimension: 2,
            population_size: usize::MAX,
            limit: MAX_POPULATION_VALUES
        }
    );
}

#[test]
fn a_covariance_beyond_memory_is_refused() {
    assert!(matches!(
        error(&vec![0.0; 20_000], 1.0, defaults()),
        CmaEsError::ProblemTooLarge { dimension: 20_000, .. }
    ));
}

#[test]
fn a_budget_below_one_generation_is_refused() {
    let options =
        CmaEsOptions { population_size: Some(10), max_evaluations: Some(9), ..defaults() };
    assert_eq!(
        error(&[0.0; 2], 1.0, options),
        CmaEsError::BudgetTooSmall { max_evaluations: 9, population_size: 10 }
    );
}

#[test]
fn a_limit_of_no_generations_is_refused() {
    let options = CmaEsOptions { max_generations: Some(0), ..defaults() };
    assert_eq!(error(&[0.0; 2], 1.0, options), CmaEsError::NoGenerations);
}

#[test]
fn a_nan_target_is_refused() {
    let options = CmaEsOptions { target_cost: Some(f64::NAN), ..defaults() };
    assert_eq!(error(&[0.0; 2], 1.0, options), CmaEsError::TargetNan);
}

#[test]
fn each_negative_tolerance_is_refused_by_name() {
    let tolerances = Tolerances::default();
    let bad = [
        ("tol_fun", Tolerances { tol_fun: -1.0, ..tolerances }),
        ("tol_fun_hist", Tolerances { tol_fun_hist: -1.0, ..tolerances }),
        ("tol_x", Tolerances { tol_x: -1.0, ..tolerances }),
        ("tol_x_up", Tolerances { tol_x_up: -1.0, ..tolerances }),
        ("condition", Tolerances { condition: -1.0, ..tolerances }),
    ];
    for (name, tolerances) in bad {
        assert_eq!(
            error(&[0.0; 2], 1.0, CmaEsOptions { tolerances, ..defaults() }),
            CmaEsError::BadTolerance { name, value: -1.0 }
        );
    }
}

#[test]
fn bounds_of_another_length_are_refused() {
    let options = CmaEsOptions { bounds: Bounds::cube(3, 0.0, 1.0).ok(), ..defaults() };
    assert_eq!(error(&[0.5; 2], 1.0, options), CmaEsError::BoundsLength { bounds: 3, expected: 2 });
}

#[test]
fn a_start_outside_the_bounds_is_refused() {
    let options = CmaEsOptions { bounds: Bounds::cube(2, 0.0, 1.0).ok(), ..defaults() };
    assert_eq!(
        error(&[0.5, 1.5], 1.0, options),
        CmaEsError::StartOutOfBounds { index: 1, value: 1.5, lower: 0.0, upper: 1.0 }
    );
}

#[test]
fn a_population_that_does_not_grow_is_refused() {
    for factor in [1.0, 0.5, f64::INFINITY] {
        let result = minimise(
            |x| x[0],
            &[0.0],
            1.0,
            &defaults(),
            Restarts::Ipop { factor },
            |_| ControlFlow::Continue(()),
        );
        assert_eq!(result, Err(CmaEsError::BadGrowthFactor { factor }));
    }
}

#[test]
fn the_driver_refuses_what_a_run_refuses() {
    let result =
        minimise(|_| 0.0, &[], 1.0, &defaults(), Restarts::None, |_| ControlFlow::Continue(()));
    assert_eq!(result, Err(CmaEsError::EmptyStart));
}
