//! Fits a disc to a difference picture.
//!
//! A pulse machines ground within its disc, and ground that is machined already hardly changes. So
//! the difference at a cell is −h (α b + β): h is the part of the cell inside the disc, b its
//! brightness before, and α b + β how much ground of that brightness darkens. Centre, radius, α and
//! β are found together by Gauss–Newton steps with Huber weights (Huber 1964).

use nalgebra::{SMatrix, SVector};

use super::change::Change;
use crate::CameraCalibration;

/// Unknowns: x, y and radius of the disc, α and β.
const UNKNOWNS: usize = 5;

/// Widths of the disc's rim in successive steps, as a standard deviation in cells. The last is
/// that of a cell and of the optics together.
const RIM_CELLS: [f32; 7] = [1.5, 1.1, 0.8, 0.6, 0.45, 0.45, 0.45];

/// A smooth step of standard deviation 1 reaches this far to each side.
const STEP_REACH: f32 = 2.236;

/// Differences from the fit beyond this many standard deviations count less.
const HUBER: f32 = 3.0;

/// Standard deviation of α about 1: machined ground is as dark wherever it was.
const ALPHA_SPREAD: f32 = 0.15;

/// Standard deviation by which a pulse changes ground that was machined before. More than that of
/// its grain, since grain is coarser than cells.
const GRAIN: f32 = 0.1;

/// The model is off by this fraction of the contrast.
const MODEL_ERROR: f32 = 0.05;

/// Cells farther outside of the disc are left out, cells.
const REACH_CELLS: f32 = 4.0;

/// Cells near a disc.
#[derive(Debug, Default)]
pub(super) struct Patch {
    cells: Vec<Cell>,
}

/// A cell of a patch; positions are px of the pattern.
#[derive(Debug, Clone, Copy)]
struct Cell {
    x: f32,
    y: f32,
    difference: f32,
    before: f32,
    /// Part of it that was machined before, in [0, 1].
    machined: f32,
}

/// What is expected of a disc.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    pub(super) radius_px: f32,
    pub(super) radius_range_px: f32,
    pub(super) radius_spread_px: f32,
    /// Darkening from which ground is machined.
    pub(super) least_contrast: f32,
    /// Where the pulse was aimed, px of the pattern, if anywhere.
    pub(super) aimed_px: Option<(f32, f32)>,
    /// How far from there it usually lands, px.
    pub(super) aim_spread_px: f32,
}

impl Expected {
    /// How much a disc speaks against what is expected: twice the negative logarithm of its
    /// probability. Far from the aim it grows slowly (a Cauchy distribution).
    fn surprise(&self, disc: &Disc) -> f32 {
        let radius = (disc.radius - self.radius_px) / self.radius_spread_px;
        let aim = self.aimed_px.map_or(0.0, |(x, y)| {
            let far = (disc.x - x).hypot(disc.y - y) / self.aim_spread_px;
            2.0 * (far * far).ln_1p()
        });
        radius * radius + aim
    }
}

/// A disc that fits, px of the pattern, and how well.
#[derive(Debug, Clone, Copy)]
pub(super) struct DiscFit {
    pub(super) x_px: f32,
    pub(super) y_px: f32,
    pub(super) radius_px: f32,
    /// Darkening of ground that was pristine.
    pub(super) contrast: f32,
    /// Area that has darkened as much as pristine ground does, px².
    pub(super) new_area_px: f32,
    /// How much likelier the disc is than none: twice the logarithm.
    pub(super) gain: f32,
    /// Part of the change within the disc that it explains, at most 1.
    pub(super) explained: f32,
    /// Standard deviation of the centre along its worst direction, px.
    pub(super) center_error_px: f32,
    /// Part of the rim that is seen, in [0, 1].
    pub(super) visible_rim: f32,
}

impl DiscFit {
    /// Distance of a point (x, y) of the pattern from the centre, px.
    pub(super) fn distance_px(&self, (x_px, y_px): (f32, f32)) -> f32 {
        (x_px - self.x_px).hypot(y_px - self.y_px)
    }
}

impl Patch {
    /// Takes the cells within reach of a disc about `center_px` of the pattern, except those that
    /// `ignored` names by their position on the pattern.
    pub(super) fn take(
        &mut self,
        change: &Change,
        calibration: &CameraCalibration,
        (x_px, y_px): (f32, f32),
        reach_px: f32,
        least_contrast: f32,
        ignored: impl Fn(f32, f32) -> bool,
    ) {
        self.cells.clear();
        let grid = change.grid;
        let cell_px = grid.cell as f64;
        let center = calibration.frame_px(lasergym_geom::Point::new(x_px.into(), y_px.into()));
        let reach = f64::from(reach_px) * calibration.scale_frame_px_per_um() / cell_px * 1.05;
        let range = |center: f64, (first, end): (usize, usize)| {
            let low = (center / cell_px - reach).floor().clamp(first as f64, end as f64);
            let high = (center / cell_px + reach).ceil().clamp(low, end as f64);
            low as usize..high as usize
        };
        let origin = calibration.pattern_px(lasergym_geom::Point::default());
        let across = calibration.pattern_vector(lasergym_geom::Point::new(cell_px, 0.0));
        let down = calibration.pattern_vector(lasergym_geom::Point::new(0.0, cell_px));
        for j in range(center.y, change.inside.rows) {
            for i in range(center.x, change.inside.columns) {
                let position = origin + across * (i as f64 + 0.5) + down * (j as f64 + 0.5);
                let (x, y) = (position.x as f32, position.y as f32);
                let (dx, dy) = (x - x_px, y - y_px);
                if dx * dx + dy * dy < reach_px * reach_px && !ignored(x, y) {
                    let at = j * grid.stride() + i;
                    let (difference, before) = (change.difference[at], change.before[at]);
                    let machined = ((1.0 - before) / least_contrast - 0.5).clamp(0.0, 1.0);
                    self.cells.push(Cell { x, y, difference, before, machined });
                }
            }
        }
    }

    /// The disc that fits best, from a first guess. `cell_px` is the side of a cell on the pattern.
    pub(super) fn fit(
        &self,
        (x_px, y_px): (f32, f32),
        noise: f32,
        cell_px: f32,
        expected: Expected,
    ) -> Option<DiscFit> {
        if self.cells.len() < 4 * UNKNOWNS {
            return None;
        }
        let mut disc =
            Disc { x: x_px, y: y_px, radius: expected.radius_px, alpha: 1.0, beta: -0.7 };
        let mut deviation = noise.max(MODEL_ERROR * 0.3);
        disc.darken(&self.cells, RIM_CELLS[0] * cell_px);
        let mut inverse = SMatrix::<f32, UNKNOWNS, UNKNOWNS>::zeros();
        for (round, rim) in RIM_CELLS.iter().enumerate() {
            let rim_px = rim * cell_px;
            let (mut normal, mut right) = disc.sums(&self.cells, rim_px, deviation);
            let mut expect = |k: usize, value: f32, spread: f32| {
                let weight = (spread * spread).recip();
                normal[(k, k)] += weight;
                right[k] += weight * value;
            };
            if let Some((x, y)) = expected.aimed_px {
                let (dx, dy) = (x - disc.x, y - disc.y);
                let spread = expected.aim_spread_px;
                let spread = (spread * spread + dx * dx + dy * dy).sqrt();
                expect(0, dx, spread);
                expect(1, dy, spread);
            }
            expect(2, expected.radius_px - disc.radius, expected.radius_spread_px);
            expect(3, 1.0 - disc.alpha, ALPHA_SPREAD);
            // Hold what nothing is seen of.
            expect(0, 0.0, 2.0);
            expect(1, 0.0, 2.0);
            expect(4, 0.0, 0.5);
            inverse = normal.try_inverse()?;
            let step = inverse * right;
            let limit = 1.5_f32;
            disc.x += step[0].clamp(-limit, limit);
            disc.y += step[1].clamp(-limit, limit);
            let range = expected.radius_range_px;
            disc.radius = (disc.radius + step[2].clamp(-limit, limit))
                .clamp(expected.radius_px - range, expected.radius_px + range);
            disc.alpha += step[3];
            disc.beta += step[4];
            if round >= 2 {
                deviation = noise.max(MODEL_ERROR * (disc.alpha + disc.beta).abs());
            }
        }
        let rim_px = RIM_CELLS[RIM_CELLS.len() - 1] * cell_px;
        let mut fit = disc.judged(&self.cells, rim_px, noise, cell_px, inverse);
        fit.gain -= expected.surprise(&disc);
        Some(fit)
    }
}

impl Cell {
    /// Variance of the difference from the model, where that of pristine ground is `deviation`².
    fn variance(&self, deviation: f32) -> f32 {
        let grain = GRAIN * self.machined;
        deviation * deviation + grain * grain
    }
}

/// A difference of `off` standard deviations as Huber counts it.
fn huber(off: f32) -> f32 {
    if off > HUBER { HUBER * (2.0 * off - HUBER) } else { off * off }
}

/// A disc while it is being fitted.
#[derive(Debug, Clone, Copy)]
struct Disc {
    x: f32,
    y: f32,
    radius: f32,
    alpha: f32,
    beta: f32,
}

/// Part of a step that lies below `t` standard deviations, and its slope.
fn step(t: f32) -> (f32, f32) {
    let s = (0.5 + t / (2.0 * STEP_REACH)).clamp(0.0, 1.0);
    (s * s * (3.0 - 2.0 * s), 3.0 * s * (1.0 - s) / STEP_REACH)
}

impl Disc {
    /// Distance from the centre, and the way to it.
    fn arm(&self, cell: &Cell) -> (f32, f32, f32) {
        let (dx, dy) = (cell.x - self.x, cell.y - self.y);
        ((dx * dx + dy * dy).sqrt().max(1e-3), dx, dy)
    }

    /// Chooses β, with α = 1, so that the mean darkening is right.
    fn darken(&mut self, cells: &[Cell], rim_px: f32) {
        let (mut sum, mut weight) = (0.0, 1e-6);
        for cell in cells {
            let (part, _) = step((self.radius - self.arm(cell).0) / rim_px);
            sum += part * (-cell.difference - cell.before);
            weight += part;
        }
        self.beta = sum / weight;
    }

    /// Normal equations of a Gauss–Newton step.
    fn sums(
        &self,
        cells: &[Cell],
        rim_px: f32,
        deviation: f32,
    ) -> (SMatrix<f32, UNKNOWNS, UNKNOWNS>, SVector<f32, UNKNOWNS>) {
        let mut sums = [[0.0_f32; UNKNOWNS + 1]; UNKNOWNS];
        for cell in cells {
            let (distance, dx, dy) = self.arm(cell);
            if distance > self.radius + STEP_REACH * rim_px {
                continue;
            }
            let (part, slope) = step((self.radius - distance) / rim_px);
            let darkening = self.alpha * cell.before + self.beta;
            let error = -cell.difference - part * darkening;
            let rim = darkening * slope / rim_px;
            let row = [rim * dx / distance, rim * dy / distance, rim, part * cell.before, part];
            let variance = cell.variance(deviation);
            let off = error.abs() / variance.sqrt();
            let weight = if off > HUBER { HUBER / off } else { 1.0 } / variance;
            for (k, sums) in sums.iter_mut().enumerate() {
                let factor = weight * row[k];
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum += factor * value;
                }
                sums[UNKNOWNS] += factor * error;
            }
        }
        (SMatrix::from_fn(|j, i| sums[j][i]), SVector::from_fn(|j, _| sums[j][UNKNOWNS]))
    }

    /// How well the disc fits.
    fn judged(
        &self,
        cells: &[Cell],
        rim_px: f32,
        noise: f32,
        cell_px: f32,
        inverse: SMatrix<f32, UNKNOWNS, UNKNOWNS>,
    ) -> DiscFit {
        const BINS: usize = 24;
        let contrast = self.alpha + self.beta;
        let (mut change, mut left, mut new_area, mut gain) = (0.0, 0.0, 0.0, 0.0);
        let mut rim = [(0.0_f32, 0.0_f32); BINS];
        let deviation = noise.max(MODEL_ERROR * contrast.abs());
        for cell in cells {
            let (distance, dx, dy) = self.arm(cell);
            if distance > self.radius + REACH_CELLS * cell_px {
                continue;
            }
            let (part, slope) = step((self.radius - distance) / rim_px);
            let darkening = self.alpha * cell.before + self.beta;
            let error = -cell.difference - part * darkening;
            let scale = cell.variance(deviation).sqrt().recip();
            let (before, after) =
                (huber(cell.difference.abs() * scale), huber(error.abs() * scale));
            gain += before - after;
            if distance < self.radius + 1.5 * cell_px {
                change += before;
                left += after;
            }
            new_area += part * (-cell.difference).max(0.0).min(contrast.abs());
            if slope > 0.1 {
                let angle = dy.atan2(dx) / std::f32::consts::TAU + 0.5;
                let bin = &mut rim[((angle * BINS as f32) as usize).min(BINS - 1)];
                bin.0 += darkening * slope;
                bin.1 += slope * slope;
            }
        }
        let seen = rim.iter().filter(|(sum, squares)| *sum > 4.0 * noise * squares.sqrt()).count();
        let xx = inverse[(0, 0)];
        let (xy, yy) = (inverse[(0, 1)], inverse[(1, 1)]);
        let worst = 0.5 * (xx + yy) + (0.25 * (xx - yy).powi(2) + xy * xy).max(0.0).sqrt();
        DiscFit {
            x_px: self.x,
            y_px: self.y,
            radius_px: self.radius,
            contrast,
            new_area_px: new_area / contrast.abs().max(1e-3) * cell_px * cell_px,
            gain,
            explained: if change > 0.0 { 1.0 - left / change } else { 0.0 },
            center_error_px: worst.max(0.0).sqrt(),
            visible_rim: seen as f32 / BINS as f32,
        }
    }
}
