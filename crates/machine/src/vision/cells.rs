//! Pictures whose pixels are averages over square cells of a frame.

use crate::Frame;

/// Rows of cells are padded to a multiple of this, so that loops over them need no rest.
pub(super) const LANES: usize = 8;

/// How frames are divided into cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Grid {
    /// Side of a cell, frame px.
    pub(super) cell: usize,
    /// Cells in a row.
    pub(super) width: usize,
    /// Rows of cells.
    pub(super) height: usize,
}

/// Rows and columns of cells that lie in the frame wholly, from the first to before the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Inside {
    pub(super) rows: (usize, usize),
    pub(super) columns: (usize, usize),
}

impl Inside {
    /// What lies inside both, less `border` on each side.
    pub(super) fn and(self, other: Self, border: usize) -> Self {
        let both = |a: (usize, usize), b: (usize, usize)| {
            let first = a.0.max(b.0) + border;
            (first, a.1.min(b.1).saturating_sub(border).max(first))
        };
        Self { rows: both(self.rows, other.rows), columns: both(self.columns, other.columns) }
    }
}

impl Grid {
    /// Cells of `cell` px in frames of `width_px` × `height_px`; what is left at the right and the
    /// lower edge belongs to no cell.
    pub(super) fn new(cell: usize, width_px: usize, height_px: usize) -> Self {
        Self { cell, width: width_px / cell, height: height_px / cell }
    }

    /// Length of a padded row.
    pub(super) fn stride(self) -> usize {
        self.width.next_multiple_of(LANES)
    }

    /// Length of a picture.
    pub(super) fn len(self) -> usize {
        self.stride() * self.height
    }

    /// A picture of zeros.
    pub(super) fn picture(self) -> Vec<f32> {
        vec![0.0; self.len()]
    }

    /// Which cells lie in the frame when the grid is moved by `offset` frame px.
    pub(super) fn inside(self, offset: [isize; 2], width_px: usize, height_px: usize) -> Inside {
        let range = |offset: isize, count: usize, length: usize| {
            let cell = self.cell.cast_signed();
            let first = (-offset + cell - 1).div_euclid(cell).clamp(0, count.cast_signed());
            let end =
                (length.cast_signed() - offset).div_euclid(cell).clamp(first, count.cast_signed());
            (first as usize, end as usize)
        };
        Inside {
            rows: range(offset[1], self.height, height_px),
            columns: range(offset[0], self.width, width_px),
        }
    }

    /// Mean grey level of every cell of `frame` when the grid is moved by `offset` frame px. Beyond
    /// the frame its nearest pixels count.
    pub(super) fn average(self, frame: &Frame, offset: [isize; 2], means: &mut [f32]) {
        match self.cell {
            2 => self.average_cells::<2>(frame, offset, means),
            3 => self.average_cells::<3>(frame, offset, means),
            4 => self.average_cells::<4>(frame, offset, means),
            5 => self.average_cells::<5>(frame, offset, means),
            6 => self.average_cells::<6>(frame, offset, means),
            8 => self.average_cells::<8>(frame, offset, means),
            _ => self.average_cells::<0>(frame, offset, means),
        }
    }

    /// As [`average`](Self::average); `CELL` is the side of a cell, or 0 where it is not known
    /// beforehand.
    fn average_cells<const CELL: usize>(
        self,
        frame: &Frame,
        offset: [isize; 2],
        means: &mut [f32],
    ) {
        let cell = if CELL == 0 { self.cell } else { CELL };
        let (width, height) = (frame.width_px(), frame.height_px());
        let share = ((cell * cell) as f32).recip();
        // The sums of `cell` rows, with what the offset needs at both ends.
        let before = (-offset[0]).max(0) as usize;
        let skip = offset[0].max(0) as usize;
        let mut sums = vec![0_u16; before + width.max(skip + self.width * cell)];
        for (j, means) in means.chunks_exact_mut(self.stride()).enumerate() {
            let middle = &mut sums[before..before + width];
            middle.fill(0);
            for k in 0..cell {
                let row = (j * cell + k).cast_signed() + offset[1];
                let row = row.clamp(0, height.cast_signed() - 1) as usize * width;
                for (sum, &gray) in middle.iter_mut().zip(&frame.gray()[row..row + width]) {
                    *sum += u16::from(gray);
                }
            }
            let (first, last) = (sums[before], sums[before + width - 1]);
            sums[..before].fill(first);
            sums[before + width..].fill(last);
            for (mean, sums) in
                means.iter_mut().zip(sums[skip..].chunks_exact(cell)).take(self.width)
            {
                let sum: u32 = sums.iter().map(|&sum| u32::from(sum)).sum();
                *mean = sum as f32 * share;
            }
        }
    }
}

/// Smooths with the weights 1 2 1 along rows and columns. The outermost cells stay.
pub(super) fn smooth(grid: Grid, from: &[f32], along_rows: &mut [f32], into: &mut [f32]) {
    let stride = grid.stride();
    let length = from.len();
    into.copy_from_slice(from);
    along_rows.copy_from_slice(from);
    for ((value, two), one) in
        along_rows[1..length - 1].iter_mut().zip(from.windows(2)).zip(&from[2..])
    {
        *value = 0.25 * (two[0] + one) + 0.5 * two[1];
    }
    if grid.height < 3 {
        return;
    }
    let rows = into[stride..length - stride].iter_mut();
    for ((value, above), (here, below)) in rows
        .zip(&along_rows[..length - 2 * stride])
        .zip(along_rows[stride..].iter().zip(&along_rows[2 * stride..]))
    {
        *value = 0.25 * (above + below) + 0.5 * here;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::time::Instant;

    proptest! {
        #[test]
        fn cells_are_means_of_their_pixels(
            cell in 1_usize..10,
            (width, height) in (20_usize..70, 20_usize..50),
            offset in [-30_isize..30, -30_isize..30],
            seed in 0_u32..1000,
        ) {
            let gray: Vec<u8> = (0..width * height)
                .map(|k| ((k as u32 ^ seed).wrapping_mul(2_654_435_761) >> 24) as u8)
                .collect();
            let frame = Frame::new(width, height, gray.clone(), Instant::now()).unwrap();
            let grid = Grid::new(cell, width, height);
            let mut means = grid.picture();
            grid.average(&frame, offset, &mut means);
            let inside = grid.inside(offset, width, height);
            for j in 0..grid.height {
                for i in 0..grid.width {
                    let mut sum = 0.0;
                    let mut whole = true;
                    for y in j * cell..(j + 1) * cell {
                        for x in i * cell..(i + 1) * cell {
                            let (x, y) = (x.cast_signed() + offset[0], y.cast_signed() + offset[1]);
                            let in_x = x.clamp(0, width.cast_signed() - 1);
                            let in_y = y.clamp(0, height.cast_signed() - 1);
                            whole &= in_x == x && in_y == y;
                            sum += f32::from(gray[in_y as usize * width + in_x as usize]);
                        }
                    }
                    let mean = means[j * grid.stride() + i];
                    prop_assert!((mean - sum / (cell * cell) as f32).abs() < 1e-3);
                    let said = (inside.rows.0..inside.rows.1).contains(&j)
                        && (inside.columns.0..inside.columns.1).contains(&i);
                    prop_assert_eq!(said, whole);
                }
            }
        }
    }
}
