//! Which pixels a pulse covers.

use lasergym_geom::{Point, Row, WORKPIECE_SIZE_PX, row_mask};

/// Largest pulse radius that is accepted, px.
pub const MAX_PULSE_RADIUS_PX: f64 = 50.0;

/// A laser pulse: where it lands and how far its mark reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Centre of the mark, px.
    pub position: Point,
    /// Radius of the mark, px, at most [`MAX_PULSE_RADIUS_PX`].
    pub radius_px: f64,
}

/// Columns `first..end` of one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Span {
    /// First column.
    pub first: u8,
    /// Column after the last.
    pub end: u8,
}

impl Span {
    /// The columns as a row of bits.
    #[must_use]
    #[inline]
    pub fn mask(self) -> Row {
        row_mask(usize::from(self.first), usize::from(self.end))
    }

    /// Number of columns, px.
    #[must_use]
    #[inline]
    pub fn len_px(self) -> u32 {
        u32::from(self.end.saturating_sub(self.first))
    }
}

/// The pixels of the workpiece that a pulse covers, one [`Span`] a row: those whose centre
/// (i + 0.5, j + 0.5) has (i + 0.5 − x)² + (j + 0.5 − y)² ≤ r², evaluated in `f64` in this order.
#[derive(Debug, Clone)]
pub struct Footprint {
    first_row: usize,
    len: usize,
    spans: [Span; WORKPIECE_SIZE_PX],
}

impl Footprint {
    /// The footprint of `pulse`. A pulse that lands beside the workpiece, or whose position or
    /// radius is not finite, covers nothing.
    #[must_use]
    #[inline]
    pub fn of(pulse: Pulse) -> Self {
        let Point { x, y } = pulse.position;
        let radius = if pulse.radius_px > MAX_PULSE_RADIUS_PX {
            MAX_PULSE_RADIUS_PX
        } else {
            pulse.radius_px
        };
        let size = WORKPIECE_SIZE_PX as f64;
        let mut footprint =
            Self { first_row: 0, len: 0, spans: [Span::default(); WORKPIECE_SIZE_PX] };
        let reaches =
            x + radius >= 0.0 && x - radius <= size && y + radius >= 0.0 && y - radius <= size;
        if !(reaches && radius > 0.0) {
            return footprint;
        }
        footprint.first_row = (y - radius - 0.5).ceil().clamp(0.0, size) as usize;
        let end_row = ((y + radius - 0.5).floor() + 1.0).clamp(0.0, size) as usize;
        footprint.len = end_row.saturating_sub(footprint.first_row);
        let first_row = footprint.first_row;
        for (k, span) in footprint.spans.iter_mut().take(footprint.len).enumerate() {
            *span = row_span(x, (first_row + k) as f64 + 0.5 - y, radius * radius);
        }
        footprint
    }

    /// Index of the first row, and one span for it and each row below it.
    #[must_use]
    #[inline]
    pub fn rows(&self) -> (usize, &[Span]) {
        (self.first_row, &self.spans[..self.len])
    }

    /// Number of pixels covered.
    #[must_use]
    pub fn area_px(&self) -> u32 {
        self.rows().1.iter().map(|span| span.len_px()).sum()
    }
}

/// The columns whose centre is within the disc about x, in the row `dy` from its centre.
///
/// The square root says where the span ends to within one pixel, and the pixel-centre rule itself
/// decides about the two pixels there, so that no rounding of the root can show.
#[inline]
fn row_span(x: f64, dy: f64, radius_squared: f64) -> Span {
    let inside = |column: f64| {
        let dx = column + 0.5 - x;
        dx * dx + dy * dy <= radius_squared
    };
    let half_width = (radius_squared - dy * dy).max(0.0).sqrt();
    let first = (x - half_width - 0.5).ceil();
    let first =
        first - f64::from(u8::from(inside(first - 1.0))) + f64::from(u8::from(!inside(first)));
    let last = (x + half_width - 0.5).floor();
    let last = last + f64::from(u8::from(inside(last + 1.0))) - f64::from(u8::from(!inside(last)));
    let size = WORKPIECE_SIZE_PX as f64;
    Span { first: first.clamp(0.0, size) as u8, end: (last + 1.0).clamp(0.0, size) as u8 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_geom::Bitmap;
    use proptest::prelude::*;

    fn bitmap(footprint: &Footprint) -> Bitmap {
        let mut covered = Bitmap::EMPTY;
        let (first_row, spans) = footprint.rows();
        for (row, span) in covered.rows_mut()[first_row..].iter_mut().zip(spans) {
            *row = span.mask();
        }
        covered
    }

    /// The pixel-centre rule, pixel by pixel.
    fn pixel_centre_rule(pulse: Pulse) -> Bitmap {
        Bitmap::from_fn(|j, i| {
            let dx = i as f64 + 0.5 - pulse.position.x;
            let dy = j as f64 + 0.5 - pulse.position.y;
            dx * dx + dy * dy <= pulse.radius_px * pulse.radius_px
        })
    }

    /// Positions on and off the workpiece; quarters of a pixel hit centres exactly at the rim.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![-20.0..120.0, (-80_i32..480).prop_map(|k| f64::from(k) / 4.0)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn spans_are_the_pixel_centre_rule(
            x in coordinate(),
            y in coordinate(),
            radius_px in prop_oneof![Just(9.0), 0.01..50.0, (1_u32..200).prop_map(|k| f64::from(k) / 4.0)],
        ) {
            let pulse = Pulse { position: Point::new(x, y), radius_px };
            let footprint = Footprint::of(pulse);
            prop_assert_eq!(bitmap(&footprint), pixel_centre_rule(pulse));
            prop_assert_eq!(footprint.area_px(), pixel_centre_rule(pulse).area_px());
        }
    }

    #[test]
    fn a_pulse_that_is_nowhere_covers_nothing() {
        for x in [f64::NAN, f64::INFINITY, -1e300, 1e300] {
            let pulse = Pulse { position: Point::new(x, 50.0), radius_px: 9.0 };
            assert_eq!(Footprint::of(pulse).area_px(), 0);
        }
        let pulse = Pulse { position: Point::new(50.0, 50.0), radius_px: f64::NAN };
        assert_eq!(Footprint::of(pulse).area_px(), 0);
    }
}
