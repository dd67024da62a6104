//! Laws of a single CMA-ES run and convergence on standard functions.
#![allow(clippy::unwrap_used)]

use lasergym_plan::{
    Bounds, CmaEs, CmaEsError, CmaEsOptions, CovarianceUpdate, Termination, Tolerances,
};
use proptest::prelude::*;

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)).sum()
}

/// An ellipsoid of condition 1e6 whose axes are turned by 45° in each pair of coordinates
/// (i, n − 1 − i).
fn rotated_ellipsoid(x: &[f64]) -> f64 {
    let n = x.len();
    (0..n)
        .map(|i| {
            let sign = if i < n / 2 { 1.0 } else { -1.0 };
            let y = (x[i] + sign * x[n - 1 - i]) * std::f64::consts::FRAC_1_SQRT_2;
            1e6_f64.powf(i as f64 / (n - 1) as f64) * y * y
        })
        .sum()
}

fn costs_of(population: &[f64], n: usize, objective: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    population.chunks_exact(n).map(objective).collect()
}

/// Runs to the end.
fn run(
    start: &[f64],
    sigma: f64,
    options: CmaEsOptions,
    objective: impl Fn(&[f64]) -> f64,
) -> CmaEs {
    let mut optimiser = CmaEs::new(start, sigma, options).unwrap();
    while optimiser.termination().is_none() {
        let costs = costs_of(optimiser.ask(), start.len(), &objective);
        optimiser.tell(&costs).unwrap();
    }
    optimiser
}

fn best_cost(optimiser: &CmaEs) -> f64 {
    optimiser.best().unwrap().cost
}

fn seeded(seed: u64) -> CmaEsOptions {
    CmaEsOptions { seed, max_evaluations: Some(40_000), ..CmaEsOptions::default() }
}

#[test]
fn the_sphere_is_minimised() {
    for seed in 0..5 {
        assert!(best_cost(&run(&[3.0; 10], 2.0, seeded(seed), sphere)) < 1e-9);
    }
}

#[test]
fn the_rotated_ellipsoid_is_minimised() {
    for seed in 0..5 {
        assert!(best_cost(&run(&[3.0; 10], 2.0, seeded(seed), rotated_ellipsoid)) < 1e-9);
    }
}

#[test]
fn rosenbrocks_valley_is_followed() {
    for seed in 0..5 {
        let options = CmaEsOptions { population_size: Some(16), ..seeded(seed) };
        assert!(best_cost(&run(&[0.0; 8], 0.5, options, rosenbrock)) < 1e-9, "seed {seed}");
    }
}

#[test]
fn one_variable_is_enough() {
    let optimiser = run(&[4.0], 1.0, seeded(0), |x| (x[0] - 1.0).powi(2));
    assert!((optimiser.best().unwrap().x[0] - 1.0).abs() < 1e-5);
}

#[test]
fn the_covariance_learns_the_inverse_hessian() {
    // On a quadratic cost C becomes proportional to the inverse Hessian, so that the ellipsoid
    // ends up as easy as the sphere: evaluations from then on are alike.
    let target = |target_cost| CmaEsOptions { target_cost: Some(target_cost), ..seeded(3) };
    let evaluations = |objective: fn(&[f64]) -> f64| {
        let early = run(&[3.0; 10], 2.0, target(1e-2), objective).evaluations();
        run(&[3.0; 10], 2.0, target(1e-9), objective).evaluations() - early
    };
    let ratio = evaluations(rotated_ellipsoid) as f64 / evaluations(sphere) as f64;
    assert!(ratio < 2.0, "{ratio}");
}

#[test]
fn both_covariance_updates_converge() {
    for covariance_update in [CovarianceUpdate::Active, CovarianceUpdate::PositiveOnly] {
        let options = CmaEsOptions { covariance_update, ..seeded(1) };
        assert!(best_cost(&run(&[3.0; 6], 2.0, options, rotated_ellipsoid)) < 1e-9);
    }
}

#[test]
fn an_optimum_on_the_boundary_is_reached() {
    // Unconstrained optimum at −1 in every coordinate: the constrained one is the corner 0.
    let cost = |x: &[f64]| x.iter().map(|x| (x + 1.0).powi(2)).sum();
    for seed in 0..5 {
        let options = CmaEsOptions { bounds: Bounds::cube(5, 0.0, 10.0).ok(), ..seeded(seed) };
        let optimiser = run(&[7.0; 5], 2.0, options, cost);
        let best = optimiser.best().unwrap();
        assert!((best.cost - 5.0).abs() < 1e-6, "{}", best.cost);
        assert!(best.x.iter().all(|&x| (0.0..1e-6).contains(&x)));
    }
}

#[test]
fn one_sided_bounds_hold() {
    let bounds = Bounds::new(vec![2.0, f64::NEG_INFINITY], vec![f64::INFINITY, 3.0]).unwrap();
    let options = CmaEsOptions { bounds: Some(bounds), ..seeded(2) };
    let optimiser = run(&[4.0, 0.0], 1.0, options, |x| x[0].powi(2) + (x[1] - 9.0).powi(2));
    assert!((best_cost(&optimiser) - 40.0).abs() < 1e-6);
}

#[test]
fn a_start_on_the_boundary_is_accepted() {
    let options = CmaEsOptions { bounds: Bounds::cube(3, 0.0, 1.0).ok(), ..seeded(2) };
    let optimiser = run(&[0.0, 1.0, 0.5], 0.3, options, |x| sphere(x) - x[2]);
    assert!((best_cost(&optimiser) + 0.25).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn candidates_stay_in_the_bounds(
        seed in any::<u64>(),
        sigma in 0.01..100.0_f64,
    ) {
        let bounds = Bounds::new(vec![-1.0, 0.0, f64::NEG_INFINITY], vec![1.0, f64::INFINITY, 5.0])
            .unwrap();
        let options = CmaEsOptions { bounds: Some(bounds.clone()), seed, ..CmaEsOptions::default() };
        let mut optimiser = CmaEs::new(&[0.5, 1.0, 2.0], sigma, options).unwrap();
        for _ in 0..30 {
            let population = optimiser.ask().to_vec();
            prop_assert!(population.chunks_exact(3).all(|x| bounds.contains(x)));
            optimiser.tell(&costs_of(&population, 3, |x| x[0] + x[1] - x[2])).unwrap();
            prop_assert!(bounds.contains(optimiser.mean()));
        }
    }

    #[test]
    fn only_the_order_of_the_costs_matters(seed in any::<u64>(), scale in 0.1..10.0_f64) {
        let options = || CmaEsOptions { seed, ..CmaEsOptions::default() };
        let mut plain = CmaEs::new(&[1.0; 6], 0.7, options()).unwrap();
        let mut scaled = CmaEs::new(&[1.0; 6], 0.7, options()).unwrap();
        for _ in 0..40 {
            let population = plain.ask().to_vec();
            prop_assert_eq!(&population[..], scaled.ask());
            let costs = costs_of(&population, 6, rosenbrock);
            plain.tell(&costs).unwrap();
            let transformed: Vec<f64> = costs.iter().map(|f| (scale * f).ln_1p() - 7.0).collect();
            scaled.tell(&transformed).unwrap();
        }
    }

    #[test]
    fn moving_the_problem_moves_the_run(seed in any::<u64>(), shift in -64_i32..64) {
        // Whole shifts of candidates near 1 lose a few last digits only.
        let shift = f64::from(shift);
        let options = || CmaEsOptions { seed, ..CmaEsOptions::default() };
        let mut here = CmaEs::new(&[1.0; 4], 0.5, options()).unwrap();
        let mut there = CmaEs::new(&[1.0 + shift; 4], 0.5, options()).unwrap();
        for _ in 0..15 {
            let population = here.ask().to_vec();
            for (x, moved) in population.iter().zip(there.ask()) {
                prop_assert!((x + shift - moved).abs() < 1e-10);
            }
            let costs = costs_of(&population, 4, sphere);
            here.tell(&costs).unwrap();
            there.tell(&costs).unwrap();
        }
    }

    #[test]
    fn scaling_the_problem_scales_the_run(seed in any::<u64>(), exponent in -20_i32..20) {
        // Powers of two scale without rounding.
        let scale = 2.0_f64.powi(exponent);
        let options = || CmaEsOptions { seed, ..CmaEsOptions::default() };
        let mut small = CmaEs::new(&[1.0; 4], 0.5, options()).unwrap();
        let mut large = CmaEs::new(&[scale; 4], 0.5 * scale, options()).unwrap();
        for _ in 0..15 {
            let population = small.ask().to_vec();
            let scaled: Vec<f64> = population.iter().map(|x| x * scale).collect();
            prop_assert_eq!(&scaled[..], large.ask());
            let costs = costs_of(&population, 4, sphere);
            small.tell(&costs).unwrap();
            large.tell(&costs).unwrap();
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_a_different_one() {
    let bits = |seed| -> Vec<u64> {
        let optimiser = run(&[1.0; 5], 0.5, seeded(seed), rosenbrock);
        optimiser.best().unwrap().x.iter().map(|x| x.to_bits()).collect()
    };
    assert_eq!(bits(7), bits(7));
    assert_ne!(bits(7), bits(8));
}

#[test]
fn asking_twice_gives_the_same_population() {
    let mut optimiser = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    let first = optimiser.ask().to_vec();
    assert_eq!(first, optimiser.ask());
    assert_eq!(first.len(), 3 * optimiser.population_size());
}

#[test]
fn nan_costs_rank_last() {
    let mut with_nan = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    let mut with_infinity = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    for _ in 0..10 {
        let mut costs = costs_of(with_nan.ask(), 3, sphere);
        costs[2] = f64::NAN;
        with_nan.tell(&costs).unwrap();
        with_infinity.ask();
        costs[2] = f64::INFINITY;
        with_infinity.tell(&costs).unwrap();
    }
    assert_eq!(with_nan.ask(), with_infinity.ask());
    assert!(best_cost(&with_nan).is_finite());
}

#[test]
fn evaluations_and_generations_are_counted() {
    let options = CmaEsOptions { population_size: Some(9), ..CmaEsOptions::default() };
    let mut optimiser = CmaEs::new(&[1.0; 4], 1.0, options).unwrap();
    assert!(optimiser.best().is_none());
    for generation in 1..=5 {
        let costs = costs_of(optimiser.ask(), 4, sphere);
        optimiser.tell(&costs).unwrap();
        assert_eq!(optimiser.generation(), generation);
        assert_eq!(optimiser.evaluations(), 9 * generation);
        assert!(costs.iter().all(|&cost| cost >= optimiser.generation_best_cost()));
        assert!(costs.contains(&optimiser.generation_best_cost()));
    }
}

// Misuse of ask and tell.

#[test]
fn telling_before_asking_is_an_error() {
    let mut optimiser = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    assert_eq!(optimiser.tell(&[0.0; 7]), Err(CmaEsError::TellBeforeAsk));
    optimiser.ask();
    optimiser.tell(&[0.0; 7]).unwrap();
    assert_eq!(optimiser.tell(&[0.0; 7]), Err(CmaEsError::TellBeforeAsk));
}

#[test]
fn telling_the_wrong_number_of_costs_changes_nothing() {
    let mut optimiser = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    let population = optimiser.ask().to_vec();
    assert_eq!(
        optimiser.tell(&[0.0; 6]),
        Err(CmaEsError::CostsLength { costs: 6, population_size: 7 })
    );
    assert_eq!(optimiser.ask(), population);
}

#[test]
fn telling_only_nan_is_an_error() {
    let mut optimiser = CmaEs::new(&[0.0; 3], 1.0, CmaEsOptions::default()).unwrap();
    optimiser.ask();
    assert_eq!(optimiser.tell(&[f64::NAN; 7]), Err(CmaEsError::AllCostsNan { generation: 0 }));
    optimiser.tell(&[0.0; 7]).unwrap();
}

// Stopping criteria.

/// Options in which only the budget ends a run.
fn untiring() -> CmaEsOptions {
    CmaEsOptions {
        tolerances: Tolerances {
            tol_fun: 0.0,
            tol_fun_hist: 0.0,
            tol_x: 0.0,
            tol_x_up: 0.0,
            condition: 0.0,
            stagnation_generations: 0,
        },
        max_generations: Some(20_000),
        ..CmaEsOptions::default()
    }
}

fn reason(
    start: &[f64],
    sigma: f64,
    options: CmaEsOptions,
    objective: fn(&[f64]) -> f64,
) -> Termination {
    run(start, sigma, options, objective).termination().unwrap()
}

#[test]
fn the_target_ends_a_run() {
    let options = CmaEsOptions { target_cost: Some(1e-3), ..untiring() };
    let Termination::TargetReached { cost } = reason(&[1.0; 3], 1.0, options, sphere) else {
        panic!()
    };
    assert!(cost <= 1e-3);
}

#[test]
fn the_evaluation_limit_is_never_exceeded() {
    let options = CmaEsOptions { max_evaluations: Some(100), ..untiring() };
    assert_eq!(
        reason(&[1.0; 3], 1.0, options, sphere),
        Termination::MaxEvaluations { evaluations: 98 }
    );
}

#[test]
fn the_generation_limit_ends_a_run() {
    let options = CmaEsOptions { max_generations: Some(6), ..untiring() };
    assert_eq!(
        reason(&[1.0; 3], 1.0, options, sphere),
        Termination::MaxGenerations { generations: 6 }
    );
}

#[test]
fn a_small_range_of_costs_ends_a_run() {
    let mut options = untiring();
    options.tolerances.tol_fun = 1e-6;
    assert!(matches!(
        reason(&[1.0; 3], 1.0, options, sphere),
        Termination::TolFun { range } if range < 1e-6
    ));
}

#[test]
fn a_small_range_of_best_costs_ends_a_run() {
    let mut options = untiring();
    options.tolerances.tol_fun_hist = 1e-6;
    assert!(matches!(
        reason(&[1.0; 3], 1.0, options, sphere),
        Termination::TolFunHist { range } if range < 1e-6
    ));
}

#[test]
fn a_narrow_distribution_ends_a_run() {
    let mut options = untiring();
    options.tolerances.tol_x = 1e-5;
    assert!(matches!(
        reason(&[1.0; 3], 2.0, options, sphere),
        Termination::TolX { deviation } if deviation < 2e-5
    ));
}

#[test]
fn an_unbounded_cost_ends_a_run() {
    let mut options = untiring();
    options.tolerances.tol_x_up = 1e3;
    assert!(matches!(
        reason(&[1.0; 3], 0.1, options, |x| x[0]),
        Termination::TolXUp { growth } if growth > 1e3
    ));
}

#[test]
fn an_ill_conditioned_covariance_ends_a_run() {
    let mut options = untiring();
    options.tolerances.condition = 1e6;
    assert!(matches!(
        reason(&[1.0; 2], 1.0, options, |x| x[0].powi(2) + 1e12 * x[1].powi(2)),
        Termination::ConditionNumber { condition } if condition > 1e6
    ));
}

#[test]
fn a_flat_cost_ends_a_run() {
    assert_eq!(
        reason(&[1.0; 3], 1.0, untiring(), |_| 4.0),
        Termination::EqualFunctionValues { generations: 10 + 13 }
    );
}

#[test]
fn steps_lost_to_rounding_end_a_run() {
    // The optimum is at 1, where doubles are 2.2e-16 apart, and the cost resolves the last digit.
    let ended = reason(&[2.0; 3], 1.0, untiring(), |x| x.iter().map(|x| (x - 1.0).abs()).sum());
    assert!(
        matches!(
            ended,
            Termination::NoEffectAxis { .. }
                | Termination::NoEffectCoordinate { .. }
                | Termination::EqualFunctionValues { .. }
        ),
        "{ended}"
    );
}

#[test]
fn a_coordinate_lost_to_rounding_ends_a_run() {
    // Doubles near 1e17 are 16 apart.
    assert_eq!(
        reason(&[1e17, 0.0, 0.0], 1.0, untiring(), |x| x[1].powi(2) + x[2].powi(2)),
        Termination::NoEffectCoordinate { coordinate: 0 }
    );
}

#[test]
fn an_axis_lost_to_rounding_ends_a_run() {
    assert!(matches!(
        reason(&[1e17; 3], 1.0, untiring(), sphere),
        Termination::NoEffectAxis { .. }
    ));
}

#[test]
fn a_run_without_progress_stagnates() {
    // Costs that only depend on the candidate in its digits look like noise.
    let mut options = CmaEsOptions { seed: 3, ..untiring() };
    options.tolerances.stagnation_generations = 120;
    assert!(matches!(
        reason(&[1.0; 3], 1.0, options, |x| (x[0] * 1e9).sin()),
        Termination::Stagnation { generations } if generations >= 120
    ));
}

#[test]
fn each_reason_has_its_own_name_and_text() {
    let reasons = [
        Termination::TargetReached { cost: 0.0 },
        Termination::MaxEvaluations { evaluations: 1 },
        Termination::MaxGenerations { generations: 1 },
        Termination::NotFinite,
        Termination::ConditionNumber { condition: 1e15 },
        Termination::TolXUp { growth: 1e5 },
        Termination::NoEffectAxis { axis: 0 },
        Termination::NoEffectCoordinate { coordinate: 0 },
        Termination::EqualFunctionValues { generations: 1 },
        Termination::TolFun { range: 0.0 },
        Termination::TolFunHist { range: 0.0 },
        Termination::TolX { deviation: 0.0 },
        Termination::Stagnation { generations: 1 },
        Termination::Cancelled,
    ];
    let names: std::collections::HashSet<_> = reasons.iter().map(|r| r.name()).collect();
    let texts: std::collections::HashSet<_> = reasons.iter().map(ToString::to_string).collect();
    assert_eq!((names.len(), texts.len()), (reasons.len(), reasons.len()));
}
