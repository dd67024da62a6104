//! Strategy parameters of CMA-ES: Table 1 of the tutorial.

use super::options::CovarianceUpdate;

/// The strategy parameters of a run, all functions of the number of variables n and the
/// population size λ. Names and equation numbers are those of the tutorial.
#[derive(Debug, Clone, PartialEq)]
pub struct StrategyParameters {
    /// Number of variables n.
    pub dimension: usize,
    /// Candidates per generation λ.
    pub population_size: usize,
    /// Number of parents μ: the candidates with a positive weight.
    pub parents: usize,
    /// Recombination weights w, best candidate first, length λ; the first μ sum to 1, the others
    /// are ≤ 0 (eq. (53)).
    pub weights: Vec<f64>,
    /// Variance effective selection mass `μ_eff` of the parents, 1 … μ.
    pub mu_eff: f64,
    /// Learning rate of the mean `c_m` (eq. (54)).
    pub c_m: f64,
    /// Rate of the step-size path `c_σ` (eq. (55)).
    pub c_sigma: f64,
    /// Damping of the step size `d_σ` (eq. (55)).
    pub d_sigma: f64,
    /// Rate of the covariance path `c_c` (eq. (56)).
    pub c_c: f64,
    /// Learning rate of the rank-one update `c_1` (eq. (57)).
    pub c_1: f64,
    /// Learning rate of the rank-μ update `c_μ` (eq. (58)).
    pub c_mu: f64,
    /// Expected length of a standard normal vector, E‖N(0, I)‖.
    pub expected_norm: f64,
}

impl StrategyParameters {
    /// Table 1 for `dimension` ≥ 1 variables and `population_size` ≥ 4.
    #[must_use]
    pub fn new(dimension: usize, population_size: usize, update: CovarianceUpdate) -> Self {
        let n = dimension as f64;
        let lambda = population_size as f64;
        // Eq. (49).
        let raw: Vec<f64> = (1..=population_size)
            .map(|i| f64::midpoint(lambda, 1.0).ln() - (i as f64).ln())
            .collect();
        let parents = raw.iter().take_while(|&&w| w > 0.0).count();
        let mu_eff = effective_mass(&raw[..parents]);
        let mu_eff_negative = effective_mass(&raw[parents..]);

        // Eqs. (57), (58) with α_cov = 2.
        let c_1 = 2.0 / ((n + 1.3).powi(2) + mu_eff);
        let c_mu = (2.0 * (0.25 + mu_eff + mu_eff.recip() - 2.0) / ((n + 2.0).powi(2) + mu_eff))
            .min(1.0 - c_1);
        // Eq. (55).
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let d_sigma = 1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;

        let negative_sum = match update {
            // Eqs. (50), (51), (52).
            CovarianceUpdate::Active => (1.0 + c_1 / c_mu)
                .min(1.0 + 2.0 * mu_eff_negative / (mu_eff + 2.0))
                .min((1.0 - c_1 - c_mu) / (n * c_mu)),
            CovarianceUpdate::PositiveOnly => 0.0,
        };
        Self {
            dimension,
            population_size,
            parents,
            weights: normalised(&raw, parents, negative_sum),
            mu_eff,
            c_m: 1.0,
            c_sigma,
            d_sigma,
            // Eq. (56).
            c_c: (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n),
            c_1,
            c_mu,
            expected_norm: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }

    /// Generations between two eigendecompositions, so that their cost stays below that of the
    /// rest for large n: max(1, ⌊1/(n (`c_1` + `c_μ`))⌋), ten times what Appendix B.2 proposes. In
    /// between the matrix changes by about 1/n of itself.
    #[must_use]
    pub fn eigen_interval(&self) -> usize {
        let interval = 1.0 / (self.dimension as f64 * (self.c_1 + self.c_mu));
        (interval as usize).max(1)
    }
}

/// (Σ w)² / Σ w²; 0 for no weights.
fn effective_mass(weights: &[f64]) -> f64 {
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    if squares > 0.0 { weights.iter().sum::<f64>().powi(2) / squares } else { 0.0 }
}

/// Eq. (53): the positive weights scaled to sum 1, the others to sum −`negative_sum`.
fn normalised(raw: &[f64], parents: usize, negative_sum: f64) -> Vec<f64> {
    let (positive, negative) = raw.split_at(parents);
    let scale = |weights: &[f64], sum: f64| {
        let total: f64 = weights.iter().map(|w| w.abs()).sum();
        if total > 0.0 { sum / total } else { 0.0 }
    };
    let (up, down) = (scale(positive, 1.0), scale(negative, negative_sum));
    positive.iter().map(|w| w * up).chain(negative.iter().map(|w| w * down)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_fall_and_keep_the_covariance_positive(n in 1_usize..200, lambda in 4_usize..300) {
            let p = StrategyParameters::new(n, lambda, CovarianceUpdate::Active);
            prop_assert_eq!(p.weights.len(), lambda);
            prop_assert!((p.weights[..p.parents].iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(p.weights.windows(2).all(|pair| pair[0] >= pair[1]));
            prop_assert!(p.mu_eff >= 1.0 && p.mu_eff <= p.parents as f64);
            prop_assert!(p.c_1 + p.c_mu <= 1.0 + 1e-12);
            // Worst case of eq. (47): every bad candidate along one axis, which loses n c_μ Σ|w⁻|
            // and keeps 1 − c_1 − c_μ Σw.
            let negative: f64 = p.weights[p.parents..].iter().sum();
            let kept = 1.0 - p.c_1 - p.c_mu * (1.0 + negative);
            prop_assert!(kept + n as f64 * p.c_mu * negative >= -1e-12);
        }

        #[test]
        fn positive_only_ignores_the_worse_half(n in 1_usize..50, lambda in 4_usize..50) {
            let p = StrategyParameters::new(n, lambda, CovarianceUpdate::PositiveOnly);
            prop_assert!(p.weights[p.parents..].iter().all(|&w| w == 0.0));
        }
    }

    #[test]
    fn table_1_for_ten_variables() {
        // Values of the tutorial's formulas evaluated by hand for n = 10, λ = 10.
        let p = StrategyParameters::new(10, 10, CovarianceUpdate::Active);
        assert_eq!(p.parents, 5);
        approx::assert_relative_eq!(p.mu_eff, 3.167_299_3, max_relative = 1e-6);
        approx::assert_relative_eq!(p.c_sigma, 5.167_299_3 / 18.167_299_3, max_relative = 1e-6);
        approx::assert_relative_eq!(p.c_1, 2.0 / (127.69 + 3.167_299_3), max_relative = 1e-6);
        approx::assert_relative_eq!(p.expected_norm, 3.084_726_5, max_relative = 1e-6);
    }
}
