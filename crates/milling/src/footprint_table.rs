//! Footprints given by a table.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use crate::MillingError;
use crate::error::check_option;
use crate::footprint::Radial;

/// Most entries of a table.
const MAX_ENTRIES: usize = 100_000;

/// Intervals of the table that the loops read.
const INTERVALS: usize = 256;

/// A footprint of measured rates, see [`crate::Footprint::Table`].
///
/// The rates are resampled at equal steps of s = r² and joined by cubics in s, so that the footprint
/// is smooth in the centre and once continuously differentiable everywhere; rate and slope are 0 at
/// the end.
#[derive(Debug, Clone, PartialEq)]
pub struct FootprintTable {
    reach_um: f64,
    /// Rates at r = k/(n − 1) reach, as given.
    rates_um_s: Vec<f64>,
    /// Rates at s = k/[`INTERVALS`] reach².
    nodes: Vec<f64>,
    /// dE/ds there, times the interval.
    slopes: Vec<f64>,
}

impl FootprintTable {
    /// The footprint with `rates_um_s[k]` at r = k `spacing_um`, joined by cubics; it ends
    /// one spacing after its last entry.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for a spacing that is not above 0,
    /// [`MillingError::WrongLength`] for fewer than 3 or more than 100 000 entries,
    /// [`MillingError::FootprintTable`] for a rate that is negative or not finite.
    pub fn new(spacing_um: f64, rates_um_s: &[f64]) -> Result<Self, MillingError> {
        let ok = spacing_um > 0.0 && spacing_um <= 1e9;
        check_option("spacing_um", spacing_um, ok, "above 0 and at most 1e9 µm")?;
        if !(3..=MAX_ENTRIES).contains(&rates_um_s.len()) {
            let actual = rates_um_s.len();
            return Err(MillingError::WrongLength { name: "rates_um_s", actual, expected: 3 });
        }
        for (index, &value) in rates_um_s.iter().enumerate() {
            let least = if index == 0 { f64::MIN_POSITIVE } else { 0.0 };
            if !(value.is_finite() && value >= least) {
                return Err(MillingError::FootprintTable { index, value });
            }
        }
        let reach_um = spacing_um * rates_um_s.len() as f64;
        Ok(Self::resampled(reach_um, rates_um_s.to_vec()))
    }

    /// Distance from the centre at which the rate is 0, µm.
    #[must_use]
    pub fn reach_um(&self) -> f64 {
        self.reach_um
    }

    /// The rates at equal distances from 0 on, µm/s.
    #[must_use]
    pub fn rates_um_s(&self) -> &[f64] {
        &self.rates_um_s
    }

    pub(crate) fn scaled(&self, radius: f64, rate: f64) -> Result<Self, MillingError> {
        let rates: Vec<f64> = self.rates_um_s.iter().map(|value| value * rate).collect();
        Self::new(self.reach_um * radius / rates.len() as f64, &rates)
    }

    fn resampled(reach_um: f64, rates_um_s: Vec<f64>) -> Self {
        let entries = rates_um_s.len() as f64;
        let entry = |index: i64| {
            let index = index.unsigned_abs() as usize;
            rates_um_s.get(index).copied().unwrap_or(0.0)
        };
        let at = |part: f64| {
            let place = part * entries;
            let index = place as i64;
            let t = place - index as f64;
            let (a, b) = (entry(index), entry(index + 1));
            let da = (b - entry(index - 1)) / 2.0;
            let db = (entry(index + 2) - a) / 2.0;
            let (c, d) = (3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db);
            (a + t * (da + t * (c + t * d))).max(0.0)
        };
        let nodes: Vec<f64> =
            (0..=INTERVALS).map(|k| at((k as f64 / INTERVALS as f64).sqrt())).collect();
        let slopes = (0..=INTERVALS)
            .map(|k| match k {
                0 => nodes[1] - nodes[0],
                INTERVALS => 0.0,
                _ => (nodes[k + 1] - nodes[k - 1]) / 2.0,
            })
            .collect();
        Self { reach_um, rates_um_s, nodes, slopes }
    }
}

impl Radial for &FootprintTable {
    #[inline(always)]
    fn axis(&self, _distance_um: f64) -> f64 {
        0.0
    }

    #[inline(always)]
    fn rate(&self, square_um2: f64, axis_x: f64, axis_y: f64) -> f64 {
        self.rate_and_slope(square_um2, axis_x, axis_y).0
    }

    #[inline(always)]
    fn rate_and_slope(&self, square_um2: f64, _axis_x: f64, _axis_y: f64) -> (f64, f64) {
        let per_um2 = INTERVALS as f64 / (self.reach_um * self.reach_um);
        let place = square_um2 * per_um2;
        let index = place as usize;
        if index >= INTERVALS {
            return (0.0, 0.0);
        }
        let t = place - index as f64;
        let (a, b) = (self.nodes[index], self.nodes[index + 1]);
        let (da, db) = (self.slopes[index], self.slopes[index + 1]);
        // Cubic Hermite interpolation: a + da t + c t² + d t³.
        let c = 3.0 * (b - a) - 2.0 * da - db;
        let d = 2.0 * (a - b) + da + db;
        let rate = a + t * (da + t * (c + t * d));
        let slope = da + t * (2.0 * c + 3.0 * t * d);
        (rate, slope * per_um2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Footprint;

    #[test]
    fn a_table_of_a_compact_footprint_is_that_footprint() {
        let compact = Footprint::compact(3.0, 10.0).unwrap();
        let rates: Vec<f64> = (0..200).map(|k| compact.rate_um_s(f64::from(k) * 0.05)).collect();
        let table = Footprint::Table(FootprintTable::new(0.05, &rates).unwrap());
        for k in 0..120 {
            let r = f64::from(k) * 0.0917;
            assert!((table.rate_um_s(r) - compact.rate_um_s(r)).abs() < 2e-3, "at {r}");
        }
        let ratio = table.volume_rate_um3_s() / compact.volume_rate_um3_s();
        assert!((ratio - 1.0).abs() < 1e-3);
    }

    #[test]
    fn rate_and_slope_have_no_jump() {
        let table = FootprintTable::new(1.0, &[5.0, 4.0, 1.0, 3.0, 0.5]).unwrap();
        let last = 25.0;
        for k in 1..INTERVALS {
            let s = last * k as f64 / INTERVALS as f64;
            let (below, above) =
                ((&table).rate_and_slope(s - 1e-9, 0.0, 0.0), (&table).rate_and_slope(s, 0.0, 0.0));
            assert!((below.0 - above.0).abs() < 1e-6 && (below.1 - above.1).abs() < 1e-5, "{s}");
        }
    }

    #[test]
    fn bad_tables_are_refused() {
        assert!(matches!(
            FootprintTable::new(1.0, &[1.0, 1.0]),
            Err(MillingError::WrongLength { actual: 2, .. })
        ));
        for rates in [[0.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, f64::NAN]] {
            assert!(matches!(
                FootprintTable::new(1.0, &rates),
                Err(MillingError::FootprintTable { .. })
            ));
        }
        assert!(matches!(
            FootprintTable::new(0.0, &[1.0; 3]),
            Err(MillingError::InvalidOption { name: "spacing_um", .. })
        ));
    }
}
