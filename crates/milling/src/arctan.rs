//! An arctangent without branches, so that loops over cells become vector instructions.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// tan(3π/8): above it arctan x = π/2 − arctan(1/x) is used.
const STEEP: f64 = 2.414_213_562_373_095;

/// Above it, and up to [`STEEP`], arctan x = π/4 + arctan((x − 1)/(x + 1)) is used.
const MIDDLE: f64 = 0.66;

/// arctan(x) for x ≥ 0, rad, to within 3·10⁻¹⁶.
///
/// Source: the rational approximation of the Cephes library (S. Moshier), function `atan`.
#[inline(always)]
pub(crate) fn arctan(x: f64) -> f64 {
    let steep = x > STEEP;
    let middle = x > MIDDLE;
    let offset = if steep {
        FRAC_PI_2
    } else if middle {
        FRAC_PI_4
    } else {
        0.0
    };
    let numerator = if steep {
        -1.0
    } else if middle {
        x - 1.0
    } else {
        x
    };
    let denominator = if steep {
        x
    } else if middle {
        x + 1.0
    } else {
        1.0
    };
    let t = numerator / denominator;
    let z = t * t;
    let p = (((-8.750_608_600_031_904e-1 * z - 1.615_753_718_733_365e1) * z
        - 7.500_855_792_314_705e1)
        * z
        - 1.228_866_684_490_136_2e2)
        * z
        - 6.485_021_904_942_025e1;
    let q = ((((z + 2.485_846_490_142_306_3e1) * z + 1.650_270_098_316_988_5e2) * z
        + 4.328_810_604_912_903e2)
        * z
        + 4.853_903_996_359_137e2)
        * z
        + 1.945_506_571_482_614e2;
    offset + (t + t * z * (p / q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_arctangent(exponent in -12.0..6.0_f64) {
            let x = 10.0_f64.powf(exponent);
            prop_assert!((arctan(x) - x.atan()).abs() <= 3e-16 * (1.0 + x.atan()));
        }
    }

    #[test]
    fn zero_stays_zero() {
        assert!(arctan(0.0).abs() < f64::MIN_POSITIVE);
    }
}
