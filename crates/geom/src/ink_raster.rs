//! Pictures as amounts of ink, averaged onto the workpiece.

use crate::{
    Bitmap, DrawingError, DrawingOptions, Fit, Ink, WORKPIECE_SIZE_PX,
    placement::{Bounds, Placement},
};

/// Slack for rounding when a mean amount of ink is compared with the threshold.
const ROUNDING: f64 = 1e-9;

/// A rule that gives the ink of a pixel, [`Ink`] decided for one picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InkRule {
    /// Dark is ink.
    Dark,
    /// Painted and not white is ink.
    Painted,
    /// Opaque is ink.
    Opaque,
}

impl InkRule {
    /// Decides `ink` for a picture, RGBA bytes.
    pub(crate) fn decide(ink: Ink, rgba: &[u8]) -> Self {
        match ink {
            Ink::Alpha => Self::Opaque,
            Ink::Auto if rgba.chunks_exact(4).any(|pixel| pixel[3] < 128) => Self::Painted,
            Ink::Auto | Ink::Luminance => Self::Dark,
        }
    }

    /// The amount of ink of a pixel, 0…255.
    fn amount(self, pixel: &[u8]) -> u8 {
        let [red, green, blue, alpha] = [0, 1, 2, 3].map(|k| u32::from(pixel[k]));
        let strength = match self {
            Self::Dark => 255 - (2126 * red + 7152 * green + 722 * blue + 5000) / 10_000,
            Self::Painted => (10 * (255 - red.min(green).min(blue))).min(255),
            Self::Opaque => 255,
        };
        // At most 255 × 255 / 255.
        ((alpha * strength + 127) / 255) as u8
    }
}

/// Amounts of ink, 0…255, shape (height, width).
#[derive(Debug, Clone)]
pub(crate) struct InkRaster {
    width: usize,
    height: usize,
    amounts: Vec<u8>,
}

impl InkRaster {
    /// The ink of a picture `width` samples wide, RGBA bytes.
    pub(crate) fn from_rgba(rgba: &[u8], width: usize, rule: InkRule, invert: bool) -> Self {
        let inverse = if invert { 255 } else { 0 };
        let amounts: Vec<u8> =
            rgba.chunks_exact(4).map(|pixel| rule.amount(pixel) ^ inverse).collect();
        let height = amounts.len().checked_div(width).unwrap_or(0);
        Self { width, height, amounts }
    }

    /// The bounding box of the samples with at least `threshold` of ink, in samples.
    pub(crate) fn ink_bounds(&self, threshold: f64) -> Option<Bounds> {
        let least = (threshold - ROUNDING) * 255.0;
        let mut corners = Vec::with_capacity(2 * self.height);
        for (j, row) in self.amounts.chunks_exact(self.width.max(1)).enumerate() {
            let inked = |&amount: &u8| f64::from(amount) >= least;
            if let (Some(first), Some(last)) =
                (row.iter().position(inked), row.iter().rposition(inked))
            {
                corners.push([first as f64, j as f64]);
                corners.push([last as f64 + 1.0, j as f64 + 1.0]);
            }
        }
        Bounds::of(corners)
    }

    /// The target: workpiece pixels whose mean amount of ink is at least the threshold.
    pub(crate) fn target(&self, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
        let placement = match options.fit {
            Fit::Exact => {
                let size = [self.width as f64, self.height as f64];
                let workpiece = WORKPIECE_SIZE_PX as f64;
                Placement { scale: workpiece / size[0].max(size[1]), ..Placement::EXACT }
            }
            Fit::Scale => self
                .ink_bounds(options.threshold)
                .and_then(|bounds| Placement::centred(&bounds, options.margin_px))
                .ok_or(DrawingError::EmptyTarget)?,
        };
        let columns: Vec<Vec<(usize, f64)>> =
            (0..WORKPIECE_SIZE_PX).map(|i| shares(placement, 0, i, self.width)).collect();
        let mut bitmap = Bitmap::EMPTY;
        for (j, target_row) in bitmap.rows_mut().iter_mut().enumerate() {
            let rows = shares(placement, 1, j, self.height);
            for (i, columns) in columns.iter().enumerate() {
                let mut mean = 0.0;
                for &(row, row_share) in &rows {
                    let samples = &self.amounts[row * self.width..][..self.width];
                    let row_mean: f64 = columns
                        .iter()
                        .map(|&(column, share)| share * f64::from(samples[column]))
                        .sum();
                    mean += row_share * row_mean;
                }
                *target_row |= u128::from(mean / 255.0 >= options.threshold - ROUNDING) << i;
            }
        }
        Ok(bitmap)
    }
}

/// The samples along `axis` under workpiece pixel `pixel`, with the share of the pixel that each
/// covers. Shares sum to 1, less where the pixel reaches beyond the samples.
fn shares(placement: Placement, axis: usize, pixel: usize, samples: usize) -> Vec<(usize, f64)> {
    let [start, end] = placement.interval(axis, pixel as f64, pixel as f64 + 1.0);
    let limit = samples as f64;
    let first = start.clamp(0.0, limit).floor() as usize;
    let last = end.clamp(0.0, limit).ceil() as usize;
    (first..last)
        .map(|k| {
            let overlap = end.min(k as f64 + 1.0) - start.max(k as f64);
            (k, overlap * placement.scale)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shares_of_a_pixel_sum_to_its_part_on_the_picture(
            scale in 0.01..50.0, offset in -20.0..50.0, pixel in 0_usize..100
        ) {
            let placement = Placement { scale, offset: [offset, 0.0] };
            let shares: f64 = shares(placement, 0, pixel, 64).iter().map(|share| share.1).sum();
            let (left, right) = (offset, offset + 64.0 * scale);
            let covered = right.min(pixel as f64 + 1.0) - left.max(pixel as f64);
            prop_assert!((shares - covered.max(0.0)).abs() < 1e-9, "{shares} {covered}");
        }
    }

    #[test]
    fn ink_of_a_pixel_follows_its_rule() {
        let amount = |rule: InkRule, pixel: [u8; 4]| rule.amount(&pixel);
        for (pixel, dark, painted, opaque) in [
            ([0, 0, 0, 255], 255, 255, 255),
            ([255, 255, 255, 255], 0, 0, 255),
            ([255, 255, 0, 255], 18, 255, 255),
            ([0, 0, 0, 0], 0, 0, 0),
            ([0, 0, 0, 51], 51, 51, 51),
        ] {
            assert_eq!(amount(InkRule::Dark, pixel), dark);
            assert_eq!(amount(InkRule::Painted, pixel), painted);
            assert_eq!(amount(InkRule::Opaque, pixel), opaque);
        }
    }
}
