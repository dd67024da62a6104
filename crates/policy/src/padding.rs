//! The input of a convolution with zeros around and between its values.

use crate::PolicyError;
use crate::shape::Shape;

/// How an activation is laid into a larger one of zeros.
#[derive(Debug, Clone)]
pub(crate) struct Padding {
    input: Shape,
    /// Step from one input row or column to the next.
    step: [usize; 2],
    /// Rows and columns before the first value; negative cuts values off.
    before: [isize; 2],
    padded: Shape,
}

impl Padding {
    /// Lays `input` into zeros for `layer`: `step` − 1 rows and columns between its values, `before`
    /// and `after` around them.
    pub(crate) fn new(
        layer: &str,
        input: Shape,
        step: [usize; 2],
        before: [isize; 2],
        after: [isize; 2],
    ) -> Result<Self, PolicyError> {
        let side = |axis: usize, length: usize| {
            let inner = (length - 1) * step[axis] + 1;
            let sum = inner.cast_signed() + before[axis] + after[axis];
            usize::try_from(sum).unwrap_or(0)
        };
        let padded = Shape::new(input.channels, side(0, input.height), side(1, input.width));
        padded.check(layer)?;
        Ok(Self { input, step, before, padded })
    }

    /// Shape with the zeros.
    pub(crate) fn padded(&self) -> Shape {
        self.padded
    }

    /// Whether the zeros change anything.
    pub(crate) fn is_needed(&self) -> bool {
        self.padded != self.input || self.before != [0, 0]
    }

    /// Writes the padded activation. Both lie pixel by pixel.
    pub(crate) fn fill(&self, input: &[f32], padded: &mut [f32]) {
        let channels = self.input.channels;
        padded.fill(0.0);
        let rows = input.chunks_exact(self.input.width * channels);
        for (row, values) in rows.enumerate() {
            let Some(row) = self.target(0, row, self.padded.height) else { continue };
            let width = self.padded.width * channels;
            let target = &mut padded[row * width..][..width];
            if self.step[1] == 1 && self.before[1] >= 0 && width >= values.len() {
                let start = self.before[1].unsigned_abs() * channels;
                let length = values.len().min(width - start);
                target[start..][..length].copy_from_slice(&values[..length]);
                continue;
            }
            for (column, pixel) in values.chunks_exact(channels).enumerate() {
                if let Some(column) = self.target(1, column, self.padded.width) {
                    target[column * channels..][..channels].copy_from_slice(pixel);
                }
            }
        }
    }

    /// Where row or column `index` goes, None where it is cut off.
    fn target(&self, axis: usize, index: usize, length: usize) -> Option<usize> {
        (index * self.step[axis])
            .checked_add_signed(self.before[axis])
            .filter(|&target| target < length)
    }
}
