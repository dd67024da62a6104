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

/// Columns `first..end` of one row; `first <= end`.
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

/// Row numbers within a footprint.
static ROW_NUMBERS: [f32; WORKPIECE_SIZE_PX] = {
    let mut numbers = [0.0; WORKPIECE_SIZE_PX];
    let mut k = 0;
    while k < WORKPIECE_SIZE_PX {
        numbers[k] = k as f32;
        k += 1;
    }
    numbers
};

/// Rows are placed in groups of this many, one instruction for all of them.
const LANES: usize = 4;

/// Adding it to an `f32` below 2²² rounds it to an integer, which its low mantissa bits then hold.
const ROUNDER: f32 = 12_582_912.0;

/// Rows that miss the disc by less are looked at, since rounding may let them belong to it, px.
const SLACK_PX: f64 = 1e-9;

/// A squared half width below this loses too many digits in `f32`, px².
const THIN_PX2: f32 = 0.1;

/// The pixels of the workpiece that a pulse covers, one [`Span`] a row: those whose centre
/// (i + 0.5, j + 0.5) has (i + 0.5 − x)² + (j + 0.5 − y)² ≤ r², evaluated in `f64` in this order.
#[derive(Debug, Clone)]
pub struct Footprint {
    first_row: usize,
    len: usize,
    columns: Span,
    spans: [Span; WORKPIECE_SIZE_PX],
}

impl Footprint {
    /// The footprint that covers nothing.
    pub(crate) const EMPTY: Self = Self {
        first_row: 0,
        len: 0,
        columns: Span { first: 0, end: 0 },
        spans: [Span { first: 0, end: 0 }; WORKPIECE_SIZE_PX],
    };

    /// The footprint of `pulse`. A pulse that lands beside the workpiece, or whose position or
    /// radius is not finite, covers nothing.
    #[must_use]
    #[inline]
    pub fn of(pulse: Pulse) -> Self {
        let mut footprint = Self::EMPTY;
        footprint.set(pulse);
        footprint
    }

    /// Turns this footprint into that of `pulse`, as [`of`](Self::of) makes it.
    #[inline]
    pub(crate) fn set(&mut self, pulse: Pulse) {
        let Point { x, y } = pulse.position;
        let radius = if pulse.radius_px > MAX_PULSE_RADIUS_PX {
            MAX_PULSE_RADIUS_PX
        } else {
            pulse.radius_px
        };
        let size = WORKPIECE_SIZE_PX as f64;
        let reaches =
            x + radius >= 0.0 && x - radius <= size && y + radius >= 0.0 && y - radius <= size;
        if !(reaches && radius > 0.0) {
            (self.first_row, self.len, self.columns) = (0, 0, Span::default());
            return;
        }
        let first_row = (y - radius - 0.5 - SLACK_PX).ceil().clamp(0.0, size) as u8;
        let end_row = ((y + radius - 0.5 + SLACK_PX).floor() + 1.0).clamp(0.0, size) as u8;
        self.first_row = usize::from(first_row);
        self.len = usize::from(end_row.saturating_sub(first_row));
        self.columns = Span {
            first: (x - radius).floor().clamp(0.0, size) as u8,
            end: (x + radius).ceil().clamp(0.0, size) as u8,
        };
        self.place_spans(pulse.position, radius * radius);
    }

    /// Places the spans of all rows for a disc about `center`.
    ///
    /// The square root in `f32` says where a span ends: at the pixel edge nearest to it. Where it
    /// is too near a pixel centre to tell, the pixel-centre rule itself decides about the two
    /// pixels there, so that no rounding can show.
    #[inline]
    fn place_spans(&mut self, center: Point, radius_squared: f64) {
        let column = center.x.floor();
        let disc = Disc {
            column: column as i32,
            offset: (center.x - column) as f32,
            first_dy: (self.first_row as f64 + 0.5 - center.y) as f32,
            squared: radius_squared as f32,
            // The arithmetic below is off by less than half of this where the disc is not thin.
            doubtful: 0.5 - (radius_squared as f32 * 4e-7 + 1e-5),
        };
        // Whole groups: the rows beyond `len` are never looked at.
        let rows = self.len.next_multiple_of(LANES);
        let mut doubts = 0;
        for (span, number) in self.spans[..rows].iter_mut().zip(&ROW_NUMBERS[..rows]) {
            let (placed, doubt) = disc.span(*number);
            *span = placed;
            doubts |= u32::from(doubt);
        }
        if doubts != 0 {
            self.decide_doubts(center, radius_squared, disc);
        }
    }

    /// Decides every span that is in doubt by the pixel-centre rule.
    #[cold]
    fn decide_doubts(&mut self, center: Point, radius_squared: f64, disc: Disc) {
        let first_row = self.first_row;
        let rows = self.spans[..self.len].iter_mut().zip(&ROW_NUMBERS);
        for (k, (span, number)) in rows.enumerate() {
            if disc.span(*number).1 {
                let dy = (first_row + k) as f64 + 0.5 - center.y;
                *span = exact_span(center.x, dy, radius_squared);
            }
        }
    }

    /// Index of the first row, and one span for it and each row below it.
    #[must_use]
    #[inline]
    pub fn rows(&self) -> (usize, &[Span]) {
        (self.first_row, &self.spans[..self.len])
    }

    /// The part of the footprint in the columns `first..end`.
    pub(crate) fn clipped(&self, first: u8, end: u8) -> Self {
        let clip = |span: Span| Span {
            first: span.first.clamp(first, end),
            end: span.end.clamp(first, end),
        };
        Self { columns: clip(self.columns), spans: self.spans.map(clip), ..*self }
    }

    /// Columns between which all spans lie.
    #[inline]
    pub(crate) fn columns(&self) -> std::ops::Range<usize> {
        usize::from(self.columns.first)..usize::from(self.columns.end)
    }

    /// Number of pixels covered.
    #[must_use]
    pub fn area_px(&self) -> u32 {
        self.rows().1.iter().map(|span| span.len_px()).sum()
    }
}

/// A disc in `f32`, relative to the left edge of the column and to the first row that it covers.
#[derive(Debug, Clone, Copy)]
struct Disc {
    column: i32,
    offset: f32,
    first_dy: f32,
    squared: f32,
    doubtful: f32,
}

impl Disc {
    /// The span of a row, and whether it is in doubt.
    #[inline]
    fn span(&self, row: f32) -> (Span, bool) {
        let dy = self.first_dy + row;
        let half_squared = self.squared - dy * dy;
        let half = if half_squared > 0.0 { half_squared } else { 0.0 }.sqrt();
        let (left, right) = (self.offset - half, self.offset + half);
        let (first, end) = (left + ROUNDER, right + ROUNDER);
        let column = |rounded: f32| {
            let relative = rounded.to_bits().wrapping_sub(ROUNDER.to_bits()).cast_signed();
            relative.wrapping_add(self.column).clamp(0, i32::from(WORKPIECE_SIZE_PX as u8)) as u8
        };
        // Half a pixel from the nearest edge is a pixel centre.
        let doubt = ((left - (first - ROUNDER)).abs() > self.doubtful)
            | ((right - (end - ROUNDER)).abs() > self.doubtful)
            | (half_squared.abs() < THIN_PX2);
        (Span { first: column(first), end: column(end) }, doubt)
    }
}

/// The columns whose centre is within the disc about x, in the row `dy` from its centre.
///
/// The square root says where the span ends to within one pixel, and the pixel-centre rule itself
/// decides about the two pixels there.
#[cold]
fn exact_span(x: f64, dy: f64, radius_squared: f64) -> Span {
    let inside = |column: f64| {
        let dx = column + 0.5 - x;
        dx * dx + dy * dy <= radius_squared
    };
    let half_width = (radius_squared - dy * dy).max(0.0).sqrt();
    let decide = |near: f64, outward: f64| {
        if inside(near + outward) {
            near + outward
        } else if inside(near) {
            near
        } else {
            near - outward
        }
    };
    let first = decide((x - half_width - 0.5).ceil(), -1.0);
    let last = decide((x + half_width - 0.5).floor(), 1.0);
    let clip = |column: f64| column.clamp(0.0, WORKPIECE_SIZE_PX as f64) as u8;
    Span { first: clip(first), end: clip(last + 1.0).max(clip(first)) }
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

    /// Displacements of all magnitudes down to nothing.
    fn beside() -> impl Strategy<Value = f64> {
        (-60_i32..-5, -1_i32..2).prop_map(|(power, sign)| f64::from(sign) * f64::from(power).exp2())
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

        /// A hair beside the positions where pixel centres lie on the rim.
        #[test]
        fn rounding_at_the_rim_follows_the_pixel_centre_rule(
            (x, y) in (0_i32..400, 0_i32..400),
            (beside_x, beside_y) in (beside(), beside()),
            radius_px in (1_u32..200).prop_map(|k| f64::from(k) / 4.0),
        ) {
            let position = Point::new(f64::from(x) / 4.0 + beside_x, f64::from(y) / 4.0 + beside_y);
            let pulse = Pulse { position, radius_px };
            prop_assert_eq!(bitmap(&Footprint::of(pulse)), pixel_centre_rule(pulse));
        }

        #[test]
        fn all_spans_lie_between_the_columns(
            x in coordinate(),
            y in coordinate(),
            radius_px in prop_oneof![Just(9.0), 0.01..50.0],
        ) {
            let footprint = Footprint::of(Pulse { position: Point::new(x, y), radius_px });
            let columns = footprint.columns();
            for span in footprint.rows().1.iter().filter(|span| span.len_px() > 0) {
                prop_assert!(columns.start <= usize::from(span.first));
                prop_assert!(usize::from(span.end) <= columns.end);
            }
        }
    }

    #[test]
    fn a_single_pixel_on_the_rim_is_covered() {
        // (46.5 − x)² vanishes beside 81 when they are added.
        let position = Point::new(46.5 - 1.5e-8, 37.5);
        let pulse = Pulse { position, radius_px: 9.0 };
        let covered = bitmap(&Footprint::of(pulse));
        assert!(covered.contains(28, 46) && covered.contains(46, 46));
        assert_eq!(covered, pixel_centre_rule(pulse));
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
