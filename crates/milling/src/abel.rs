//! The Abel pair between a trench and the footprint that cut it.

use crate::error::check_option;
use crate::{FootprintTable, MillingError};

/// Parts of the integral of the inversion.
const PARTS: usize = 400;

/// The footprint of a shallow straight trench (equation 3.1):
/// E(r) = −(V/π) ∫ d'(y)/√(y² − r²) dy from r to the beam radius.
///
/// `depths_um[k]` is the depth at y = k `spacing_um` from the centre line, one side of the trench
/// only, ending where the trench ends. With y = √(r² + q²) the integrand has no singularity.
/// Rates that come out negative, as noise makes them near the end, are raised to 0.
///
/// # Errors
/// [`MillingError::InvalidOption`] for a spacing or speed that is not above 0,
/// [`MillingError::WrongLength`] for fewer than 4 depths, [`MillingError::FootprintTable`] for
/// depths that are not finite or leave no rate in the centre.
pub fn abel_inversion(
    spacing_um: f64,
    depths_um: &[f64],
    speed_mm_s: f64,
) -> Result<FootprintTable, MillingError> {
    let positive = |value: f64| value > 0.0 && value <= 1e9;
    check_option("spacing_um", spacing_um, positive(spacing_um), "above 0 and at most 1e9 µm")?;
    check_option("speed_mm_s", speed_mm_s, positive(speed_mm_s), "above 0 and at most 1e9 mm/s")?;
    if depths_um.len() < 4 {
        let actual = depths_um.len();
        return Err(MillingError::WrongLength { name: "depths_um", actual, expected: 4 });
    }
    if let Some(index) = depths_um.iter().position(|depth| !depth.is_finite()) {
        return Err(MillingError::FootprintTable { index, value: depths_um[index] });
    }
    let last = depths_um.len();
    let depth = |k: usize| depths_um.get(k).copied().unwrap_or(0.0);
    // d'(y)/y at the knots: central differences; at 0 its limit d''(0), since d is even.
    let ratio: Vec<f64> = (0..=last)
        .map(|k| {
            if k == 0 {
                2.0 * (depth(1) - depth(0)) / (spacing_um * spacing_um)
            } else {
                let slope = (depth(k + 1) - depth(k - 1)) / (2.0 * spacing_um);
                slope / (k as f64 * spacing_um)
            }
        })
        .collect();
    let ratio_at = |y_um: f64| {
        let place = y_um / spacing_um;
        let index = (place as usize).min(last - 1);
        ratio[index] + (ratio[index + 1] - ratio[index]) * (place - index as f64)
    };
    let end_um = last as f64 * spacing_um;
    let speed_um_s = speed_mm_s * 1e3;
    let rates: Vec<f64> = (0..last)
        .map(|k| {
            let r = k as f64 * spacing_um;
            let width = (end_um * end_um - r * r).sqrt() / PARTS as f64;
            let sum: f64 = (0..PARTS)
                .map(|part| {
                    let q = (part as f64 + 0.5) * width;
                    ratio_at((r * r + q * q).sqrt())
                })
                .sum();
            (-speed_um_s / std::f64::consts::PI * sum * width).max(0.0)
        })
        .collect();
    FootprintTable::new(spacing_um, &rates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Footprint;

    /// Depth of a trench by numerical integration along the path, µm.
    fn trench_um(footprint: &Footprint, y_um: f64, speed_mm_s: f64) -> f64 {
        let reach = footprint.reach_um();
        let width = 2.0 * reach / 4000.0;
        let sum: f64 = (0..4000)
            .map(|k| {
                let x = -reach + (f64::from(k) + 0.5) * width;
                footprint.rate_um_s(x.hypot(y_um))
            })
            .sum();
        sum * width / (speed_mm_s * 1e3)
    }

    #[test]
    fn a_trench_gives_back_the_footprint_that_cut_it() {
        for footprint in
            [Footprint::compact(4e4, 250.0).unwrap(), Footprint::gaussian(7e4, 22.5).unwrap()]
        {
            let spacing = footprint.reach_um() / 100.0;
            let depths: Vec<f64> =
                (0..100).map(|k| trench_um(&footprint, f64::from(k) * spacing, 60.0)).collect();
            let found = Footprint::Table(abel_inversion(spacing, &depths, 60.0).unwrap());
            for k in 0..100 {
                let r = f64::from(k) * spacing;
                let error = found.rate_um_s(r) - footprint.rate_um_s(r);
                assert!(error.abs() < 0.005 * footprint.peak_um_s(), "{error} at {r}");
            }
        }
    }

    #[test]
    fn unusable_trenches_are_refused() {
        assert!(abel_inversion(0.0, &[1.0; 5], 1.0).is_err());
        assert!(abel_inversion(1.0, &[1.0; 5], f64::NAN).is_err());
        assert!(matches!(
            abel_inversion(1.0, &[1.0; 3], 1.0),
            Err(MillingError::WrongLength { actual: 3, .. })
        ));
        assert!(matches!(
            abel_inversion(1.0, &[1.0, f64::NAN, 0.5, 0.2], 1.0),
            Err(MillingError::FootprintTable { index: 1, .. })
        ));
        // Depths that grow outwards leave no rate in the centre.
        assert!(abel_inversion(1.0, &[0.0, 1.0, 2.0, 3.0], 1.0).is_err());
    }
}
