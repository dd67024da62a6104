//! Where the workpiece is in a frame, compared with the reference frame.

use super::VisionOptions;
use super::cells::{Grid, Inside, LANES, smooth};
use super::lamp::Lamp;
use crate::{Frame, ObserverError};

/// Most times that a frame is cut into cells anew.
const ROUNDS: usize = 12;

/// A shift that is known to less than this needs no new cells, frame px.
const NEAR_FRAME_PX: f32 = 0.75;

/// Frames whose texture agrees less than this with that of the reference are looked for afresh.
const TRUSTED_AGREEMENT: f32 = 0.8;

/// Frames whose texture agrees less are refused.
const LEAST_AGREEMENT: f32 = 0.2;

/// The part of the frame that must be comparable.
const LEAST_COMPARABLE: f32 = 0.1;

/// A frame in the coordinates of the reference frame.
#[derive(Debug, Clone)]
pub(super) struct Registered {
    /// How far the workpiece has moved in the view, frame px.
    pub(super) shift: [f32; 2],
    /// Brightness of each cell over that of pristine ground.
    pub(super) brightness: Vec<f32>,
    /// Cells that lie in the frame.
    pub(super) inside: Inside,
}

/// The frame that others are registered against.
#[derive(Debug)]
pub(super) struct Reference {
    grid: Grid,
    size_px: (usize, usize),
    lamp: Lamp,
    /// Brightness over that of pristine ground.
    brightness: Vec<f32>,
    /// Its texture, smoothed: less the mean.
    texture: Vec<f32>,
    slope_x: Vec<f32>,
    slope_y: Vec<f32>,
    /// Largest difference of ground that has not been machined.
    tolerance: f32,
    max_shift: f32,
    /// The shift that was found last, where the next search begins.
    last_shift: [f32; 2],
    workspace: Workspace,
}

/// Pictures that are needed for a moment.
#[derive(Debug, Default)]
struct Workspace {
    difference: Vec<f32>,
    weight: Vec<f32>,
    kept: Vec<f32>,
    rows: Vec<f32>,
    smooth: Vec<f32>,
}

/// A frame cut into cells at one offset, and how it differs from the reference.
struct Cut {
    offset: [isize; 2],
    brightness: Vec<f32>,
    inside: Inside,
    /// How far the cells are from the reference's, cells.
    rest: [f32; 2],
    /// How well the textures agree, in [−1, 1].
    agreement: f32,
    /// Brightness less 1 of the whole frame: at its middle, and its slope to the right and down.
    plane: [f32; 3],
}

impl Reference {
    /// A reference for frames that are divided into `grid`.
    pub(super) fn new(
        frame: &Frame,
        grid: Grid,
        scale_frame_px_per_px: f64,
        options: &VisionOptions,
    ) -> Result<Self, ObserverError> {
        let size_px = (frame.width_px(), frame.height_px());
        let mut brightness = grid.picture();
        grid.average(frame, [0, 0], &mut brightness);
        let least_contrast = options.least_contrast as f32;
        let lamp = Lamp::fit(grid, &brightness, least_contrast, size_px)
            .ok_or_else(|| refuse("the reference frame is dark or too uneven"))?;
        lamp.divide(grid, [0, 0], grid.inside([0, 0], size_px.0, size_px.1), &mut brightness);
        let mut texture = grid.picture();
        let mut rows = grid.picture();
        smooth(grid, &brightness, &mut rows, &mut texture);
        let (slope_x, slope_y) = slopes(grid, &texture);
        for value in &mut texture {
            *value -= 1.0;
        }
        let workspace = Workspace {
            difference: grid.picture(),
            weight: grid.picture(),
            kept: grid.picture(),
            smooth: grid.picture(),
            rows,
        };
        Ok(Self {
            grid,
            size_px,
            lamp,
            brightness,
            texture,
            slope_x,
            slope_y,
            tolerance: 0.5 * least_contrast,
            max_shift: (options.max_shift_px * scale_frame_px_per_px) as f32,
            last_shift: [0.0; 2],
            workspace,
        })
    }

    /// Finds the workpiece in `frame`.
    pub(super) fn register(&mut self, frame: &Frame) -> Result<Registered, ObserverError> {
        let mut cut = self.follow(frame, self.last_shift)?;
        if cut.agreement < TRUSTED_AGREEMENT {
            let start = self.search(frame, cut.plane)?;
            let other = self.follow(frame, start)?;
            if other.agreement > cut.agreement {
                cut = other;
            }
        }
        if cut.agreement.is_nan() || cut.agreement < LEAST_AGREEMENT {
            return Err(refuse("the ground does not look like that of the reference frame"));
        }
        let cell = self.grid.cell as f32;
        let shift = [0, 1].map(|axis| cut.offset[axis] as f32 - cell * cut.rest[axis]);
        if shift.iter().any(|shift| shift.abs() > self.max_shift) {
            return Err(refuse("the workpiece has moved too far in the view"));
        }
        self.last_shift = shift;
        let brightness = self.aligned(&cut);
        Ok(Registered { shift, brightness, inside: cut.inside })
    }

    /// Follows the slopes of the texture from `shift` to where the frame fits.
    fn follow(&mut self, frame: &Frame, shift: [f32; 2]) -> Result<Cut, ObserverError> {
        let cell = self.grid.cell as f32;
        let limit = self.max_shift + cell;
        let mut offset = shift.map(|shift| shift.clamp(-limit, limit).round() as isize);
        let mut rounds = 0;
        loop {
            let mut cut = self.compare(frame, offset)?;
            rounds += 1;
            // To and fro over the same pixel is near enough.
            let near = if rounds > ROUNDS / 2 { 2.0 * NEAR_FRAME_PX } else { NEAR_FRAME_PX };
            if cut.rest.iter().all(|rest| (rest * cell).abs() <= near) {
                return Ok(cut);
            }
            if rounds == ROUNDS {
                // The slopes lead nowhere.
                cut.agreement = -1.0;
                return Ok(cut);
            }
            for (offset, rest) in offset.iter_mut().zip(cut.rest) {
                // The slopes say nothing about more than a cell or two.
                let step = (rest * cell).clamp(-2.0 * cell, 2.0 * cell);
                *offset = (*offset as f32 - step).clamp(-limit, limit).round() as isize;
            }
        }
    }

    /// Cuts `frame` at `offset` and compares it with the reference (Lucas and Kanade 1981), leaving
    /// out what has changed.
    fn compare(&mut self, frame: &Frame, offset: [isize; 2]) -> Result<Cut, ObserverError> {
        let grid = self.grid;
        let mut brightness = grid.picture();
        grid.average(frame, offset, &mut brightness);
        let inside = grid.inside(offset, self.size_px.0, self.size_px.1);
        self.lamp.divide(grid, offset, inside, &mut brightness);
        let Workspace { difference, weight, kept, rows, smooth: smoothed } = &mut self.workspace;
        for ((difference, here), there) in
            difference.iter_mut().zip(&brightness).zip(&self.brightness)
        {
            *difference = here - there;
        }
        // The lamp's gain first, then its plane, each time nearer.
        let mut plane = [commonest(grid, inside, difference), 0.0, 0.0];
        let mut tolerance = self.tolerance;
        let border = inside.and(inside, 2);
        for _ in 0..2 {
            let fit = Plane::fit(grid, border, difference, plane, tolerance);
            if fit.count * (PLANE_ROWS as f32)
                < LEAST_COMPARABLE * (grid.width * grid.height) as f32
            {
                return Err(refuse("too little of the ground is as it was"));
            }
            plane = fit.solve().unwrap_or(plane);
            tolerance = (4.0 * fit.deviation(plane)).clamp(0.004, self.tolerance);
        }
        keep(grid, border, difference, plane, tolerance, weight, rows, kept);
        smooth(grid, difference, rows, smoothed);
        let flow = self.flow(plane);
        let mut cut = Cut { offset, brightness, inside, rest: [0.0; 2], agreement: -1.0, plane };
        if let Some(rest) = flow.solve() {
            cut.rest = rest;
            cut.agreement = flow.agreement(rest);
        }
        Ok(cut)
    }

    /// Sums for the shift between the smoothed difference and the slopes.
    fn flow(&self, plane: [f32; 3]) -> Flow {
        let grid = self.grid;
        let stride = grid.stride();
        let mut sums = [[0.0_f32; LANES]; 8];
        for j in 0..grid.height {
            let row = j * stride..(j + 1) * stride;
            let lamp = LampRow::new(grid, plane, j);
            let pictures = self.workspace.smooth[row.clone()]
                .chunks_exact(LANES)
                .zip(self.workspace.kept[row.clone()].chunks_exact(LANES))
                .zip(self.slope_x[row.clone()].chunks_exact(LANES))
                .zip(self.slope_y[row.clone()].chunks_exact(LANES))
                .zip(self.texture[row].chunks_exact(LANES));
            for (block, ((((e, w), gx), gy), t)) in pictures.enumerate() {
                for k in 0..LANES {
                    let error = e[k] - lamp.at(block * LANES + k);
                    let (wx, wy, wt) = (w[k] * gx[k], w[k] * gy[k], w[k] * t[k]);
                    sums[0][k] += wx * gx[k];
                    sums[1][k] += wx * gy[k];
                    sums[2][k] += wy * gy[k];
                    sums[3][k] += wx * error;
                    sums[4][k] += wy * error;
                    sums[5][k] += w[k] * error * error;
                    sums[6][k] += wt * t[k];
                    sums[7][k] += wt * error;
                }
            }
        }
        Flow { sums: sums.map(|lanes| lanes.iter().sum()) }
    }

    /// Brightness of a cut in the reference's cells, with the lamp as it was.
    fn aligned(&self, cut: &Cut) -> Vec<f32> {
        let grid = self.grid;
        let stride = grid.stride();
        let mut aligned = cut.brightness.clone();
        let [rest_x, rest_y] = cut.rest;
        let from = &cut.brightness;
        let last = grid.height.saturating_sub(1);
        for j in 1..last {
            let row = j * stride;
            let lamp = LampRow::new(grid, cut.plane, j);
            let into = &mut aligned[row + 1..row + grid.width - 1];
            let (above, below) = (&from[row + 1 - stride..], &from[row + 1 + stride..]);
            let here = from[row..row + grid.width].windows(3);
            for (i, (((value, here), above), below)) in
                into.iter_mut().zip(here).zip(above).zip(below).enumerate()
            {
                let moved = 0.5 * (rest_x * (here[2] - here[0]) + rest_y * (below - above));
                *value = (here[1] - moved) / (1.0 + lamp.at(i + 1));
            }
        }
        aligned
    }

    /// A whole number of double cells about which the frame fits best once the lamp's `plane` is
    /// taken out, frame px.
    fn search(&mut self, frame: &Frame, plane: [f32; 3]) -> Result<[f32; 2], ObserverError> {
        let grid = self.grid;
        let mut brightness = grid.picture();
        grid.average(frame, [0, 0], &mut brightness);
        let inside = grid.inside([0, 0], self.size_px.0, self.size_px.1);
        self.lamp.divide(grid, [0, 0], inside, &mut brightness);
        for (j, row) in brightness.chunks_exact_mut(grid.stride()).enumerate() {
            let lamp = LampRow::new(grid, plane, j);
            for (i, value) in row.iter_mut().enumerate() {
                *value -= lamp.at(i);
            }
        }
        let (here, width) = halved(grid, &brightness);
        let (there, _) = halved(grid, &self.brightness);
        let height = here.len() / width;
        let reach = (0.5 * self.max_shift / grid.cell as f32).ceil() as usize + 1;
        if width <= 2 * reach + 8 || height <= 2 * reach + 8 {
            return Err(refuse("the frame is too small for such shifts"));
        }
        let mut best = (f32::INFINITY, [0.0; 2]);
        for dy in 0..=2 * reach {
            for dx in 0..=2 * reach {
                let mut cost = 0.0;
                for j in reach..height - reach {
                    let here = &here[(j + dy - reach) * width + dx..][..width - 2 * reach];
                    let there = &there[j * width + reach..][..width - 2 * reach];
                    cost += here
                        .iter()
                        .zip(there)
                        .map(|(here, there)| (here - there).abs().min(self.tolerance))
                        .sum::<f32>();
                }
                if cost < best.0 {
                    let step = 2.0 * grid.cell as f32;
                    let shift = [dx, dy].map(|d| (d as f32 - reach as f32) * step);
                    best = (cost, shift);
                }
            }
        }
        Ok(best.1)
    }
}

fn refuse(reason: &str) -> ObserverError {
    ObserverError::Registration { reason: reason.to_owned() }
}

/// Half the difference of the neighbours to the right and left, and below and above.
fn slopes(grid: Grid, picture: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let (mut slope_x, mut slope_y) = (grid.picture(), grid.picture());
    let stride = grid.stride();
    for j in 1..grid.height.saturating_sub(1) {
        for i in 1..grid.width.saturating_sub(1) {
            let at = j * stride + i;
            slope_x[at] = 0.5 * (picture[at + 1] - picture[at - 1]);
            slope_y[at] = 0.5 * (picture[at + stride] - picture[at - stride]);
        }
    }
    (slope_x, slope_y)
}

/// Means of 2 × 2 cells, and how many there are in a row.
fn halved(grid: Grid, picture: &[f32]) -> (Vec<f32>, usize) {
    let (width, stride) = (grid.width / 2, grid.stride());
    let mut means = Vec::with_capacity(width * (grid.height / 2));
    for rows in picture.chunks_exact(2 * stride) {
        let (upper, lower) = rows.split_at(stride);
        for (upper, lower) in upper.chunks_exact(2).zip(lower.chunks_exact(2)).take(width) {
            means.push(0.25 * (upper[0] + upper[1] + lower[0] + lower[1]));
        }
    }
    (means, width)
}

/// The commonest difference: that of ground which has not changed. Of two that are nearly as
/// common the brighter, since machining darkens.
fn commonest(grid: Grid, inside: Inside, difference: &[f32]) -> f32 {
    const BINS: usize = 200;
    const BIN: f32 = 0.01;
    let mut counts = [0_u32; BINS + 2];
    for j in (inside.rows.0..inside.rows.1).step_by(3) {
        let row = j * grid.stride();
        for value in difference[row + inside.columns.0..row + inside.columns.1].iter().step_by(3) {
            let bin = ((value / BIN) + 0.5 * BINS as f32).clamp(0.0, BINS as f32 - 1.0);
            counts[bin as usize + 1] += 1;
        }
    }
    let around: Vec<u32> = counts.windows(3).map(|three| three.iter().sum()).collect();
    let most = around.iter().copied().max().unwrap_or(0);
    let peak = |k: usize| {
        let next = around.get(k + 1).copied().unwrap_or(0);
        2 * around[k] > most && around[k] >= next && (k == 0 || around[k] >= around[k - 1])
    };
    let bin = (0..around.len()).rev().find(|&k| peak(k)).unwrap_or(BINS / 2);
    (bin as f32 + 0.5 - 0.5 * BINS as f32) * BIN
}

/// The plane of the lamp in one row of cells.
#[derive(Clone, Copy)]
struct LampRow {
    left: f32,
    step: f32,
}

impl LampRow {
    fn new(grid: Grid, plane: [f32; 3], j: usize) -> Self {
        let step = 2.0 / grid.width as f32;
        let y = 2.0 * (j as f32 + 0.5) / grid.height as f32 - 1.0;
        let left = plane[0] + plane[2] * y + plane[1] * (0.5 * step - 1.0);
        Self { left, step: plane[1] * step }
    }

    fn at(self, i: usize) -> f32 {
        self.left + self.step * i as f32
    }
}

/// Weight 1 where the difference and those of all eight neighbours are within `tolerance` of the
/// plane, 0 elsewhere and outside of `inside`.
#[expect(clippy::too_many_arguments, reason = "pictures that are reused")]
fn keep(
    grid: Grid,
    inside: Inside,
    difference: &[f32],
    plane: [f32; 3],
    tolerance: f32,
    weight: &mut [f32],
    rows: &mut [f32],
    kept: &mut [f32],
) {
    let stride = grid.stride();
    for j in 0..grid.height {
        let row = j * stride..(j + 1) * stride;
        let lamp = LampRow::new(grid, plane, j);
        let values = weight[row.clone()].iter_mut().zip(&difference[row]);
        for (i, (weight, difference)) in values.enumerate() {
            *weight = f32::from((difference - lamp.at(i)).abs() < tolerance);
        }
    }
    let length = weight.len();
    for ((value, two), one) in
        rows[1..length - 1].iter_mut().zip(weight.windows(2)).zip(&weight[2..])
    {
        *value = two[0] * two[1] * one;
    }
    kept.fill(0.0);
    let first = inside.rows.0.max(1);
    let end = inside.rows.1.min(grid.height.saturating_sub(1));
    for j in first..end {
        let row = j * stride;
        let columns = inside.columns.0..inside.columns.1;
        let into = kept[row..row + stride][columns.clone()].iter_mut();
        let [above, here, below] =
            [row - stride, row, row + stride].map(|row| &rows[row..row + stride][columns.clone()]);
        for (((value, above), here), below) in into.zip(above).zip(here).zip(below) {
            *value = above * here * below;
        }
    }
}

/// The plane of the lamp is fitted to one in so many rows.
const PLANE_ROWS: usize = 2;

/// Sums for the plane that fits a difference best.
struct Plane {
    count: f32,
    /// Sums of the products of (1, x, y, difference) among each other.
    products: [[f64; 4]; 4],
}

impl Plane {
    /// Fitted to the cells inside that are within `tolerance` of `plane`, in some of the rows.
    fn fit(
        grid: Grid,
        inside: Inside,
        difference: &[f32],
        plane: [f32; 3],
        tolerance: f32,
    ) -> Self {
        let step = 2.0 / grid.width as f32;
        let mut products = [[0.0; 4]; 4];
        for j in (inside.rows.0..inside.rows.1).step_by(PLANE_ROWS) {
            let lamp = LampRow::new(grid, plane, j);
            let start = j * grid.stride();
            let mut sums = [[0.0_f32; LANES]; 6];
            let columns = start + inside.columns.0..start + inside.columns.1;
            for (block, e) in difference[columns].chunks_exact(LANES).enumerate() {
                for k in 0..LANES {
                    let i = (inside.columns.0 + block * LANES + k) as f32;
                    let x = (i + 0.5) * step - 1.0;
                    let off = e[k] - (lamp.left + lamp.step * i);
                    let weight = if off.abs() < tolerance { 1.0_f32 } else { 0.0 };
                    let (wx, we) = (weight * x, weight * e[k]);
                    sums[0][k] += weight;
                    sums[1][k] += wx;
                    sums[2][k] += wx * x;
                    sums[3][k] += we;
                    sums[4][k] += we * x;
                    sums[5][k] += we * e[k];
                }
            }
            let [one, x, xx, e, ex, ee] = sums.map(|lanes| f64::from(lanes.iter().sum::<f32>()));
            let y = 2.0 * (j as f64 + 0.5) / grid.height as f64 - 1.0;
            let row = [
                [one, x, y * one, e],
                [x, xx, y * x, ex],
                [y * one, y * x, y * y * one, y * e],
                [e, ex, y * e, ee],
            ];
            for (sums, row) in products.iter_mut().zip(row) {
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum += value;
                }
            }
        }
        Self { count: products[0][0] as f32, products }
    }

    /// The plane: at the middle, its slope to the right edge and to the lower.
    fn solve(&self) -> Option<[f32; 3]> {
        let p = &self.products;
        let left = nalgebra::Matrix3::from_fn(|j, i| p[j][i]);
        let right = nalgebra::Vector3::from_fn(|j, _| p[j][3]);
        let found = left.cholesky()?.solve(&right);
        Some([found[0] as f32, found[1] as f32, found[2] as f32])
    }

    /// Standard deviation of the difference from `plane`.
    fn deviation(&self, plane: [f32; 3]) -> f32 {
        let factors = [plane[0], plane[1], plane[2], -1.0].map(f64::from);
        let mut sum = 0.0;
        for (row, a) in self.products.iter().zip(factors) {
            for (value, b) in row.iter().zip(factors) {
                sum += a * b * value;
            }
        }
        (sum.max(0.0) / f64::from(self.count).max(1.0)).sqrt() as f32
    }
}

/// Sums for the shift between two pictures.
struct Flow {
    /// xx, xy, yy of the slopes; x, y of slope times error; error², texture², texture × error.
    sums: [f32; 8],
}

impl Flow {
    fn solve(&self) -> Option<[f32; 2]> {
        let [xx, xy, yy, ex, ey, ..] = self.sums;
        let determinant = xx * yy - xy * xy;
        if determinant.is_nan() || determinant <= 1e-6 * (xx + yy) * (xx + yy) {
            return None;
        }
        Some([(yy * ex - xy * ey) / determinant, (xx * ey - xy * ex) / determinant])
    }

    /// The part of the frame's texture that the reference's explains once it is moved by `rest`:
    /// 1 where nothing is left, about −1 for other ground.
    fn agreement(&self, rest: [f32; 2]) -> f32 {
        let [_, _, _, ex, ey, ee, tt, te] = self.sums;
        let left = (ee - rest[0] * ex - rest[1] * ey).max(0.0);
        let texture = tt + 2.0 * te + ee;
        if texture > 0.0 { 1.0 - left / texture } else { -1.0 }
    }
}
