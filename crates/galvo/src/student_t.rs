//! Quantiles of Student's t distribution.

/// The factor t for which a value lies within ± t standard errors with a probability of 95 %, for
/// `freedom` ≥ 1 degrees of freedom (Abramowitz and Stegun 26.7.3, 26.7.4, solved by bisection).
pub(crate) fn two_sided_95(freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, 64.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if probability_within(middle, freedom) < 0.95 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Probability that |t| stays below `t`.
fn probability_within(t: f64, freedom: usize) -> f64 {
    let angle = (t / (freedom as f64).sqrt()).atan();
    let (sin, cos) = angle.sin_cos();
    let odd = freedom % 2 == 1;
    // Terms cosᵏ with the factors (2·4·…)/(3·5·…) or (1·3·…)/(2·4·…).
    let mut term = if odd { cos } else { 1.0 };
    let mut sum = 0.0;
    let mut k = usize::from(odd);
    while k + 2 <= freedom {
        sum += term;
        k += 2;
        term *= cos * cos * (k - 1) as f64 / k as f64;
    }
    if odd { 2.0 / std::f64::consts::PI * (angle + sin * sum) } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantiles_are_those_of_the_tables() {
        for (freedom, quantile) in
            [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (5, 2.571), (30, 2.042), (101, 1.984)]
        {
            let found = two_sided_95(freedom);
            assert!((found - quantile).abs() < 6e-4, "{freedom}: {found}");
        }
    }
}
