//! Judging anyone's pulses.

use crate::{AblationError, Footprint, Options, Pulse, Workpiece};
use lasergym_geom::{Bitmap, Point};

/// How well a set of pulses machines a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// (target machined − off-target machined) / workpiece area.
    pub reward: f64,
    /// Machined fraction of the target, in [0, 1].
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
    /// Number of pulses.
    pub pulses: usize,
}

/// Fires `positions` at a pristine workpiece with pulses of `pulse_radius_px`.
///
/// # Errors
/// A target that is empty or full, a radius outside (0, 50] px, a position that is not finite.
pub fn score(
    target: &Bitmap,
    positions: &[Point],
    pulse_radius_px: f64,
) -> Result<Score, AblationError> {
    Options { pulse_radius_px, ..Options::default() }.validate()?;
    let mut workpiece = Workpiece::new(target)?;
    let (mut hit_px, mut miss_px) = (0_u32, 0_u32);
    for (index, &position) in positions.iter().enumerate() {
        let Point { x, y } = position;
        if !(x.is_finite() && y.is_finite()) {
            return Err(AblationError::PositionNotFinite { index, x, y });
        }
        let outcome =
            workpiece.pulse(&Footprint::of(Pulse { position, radius_px: pulse_radius_px }));
        hit_px += outcome.hit_px;
        miss_px += outcome.miss_px;
    }
    let area_px = f64::from(target.area_px());
    Ok(Score {
        reward: crate::PulseOutcome { hit_px, miss_px }.reward(),
        machined_fraction: f64::from(hit_px) / area_px,
        off_target_fraction: f64::from(miss_px) / area_px,
        pulses: positions.len(),
    })
}
