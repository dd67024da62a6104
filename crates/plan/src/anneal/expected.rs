//! A plan for the rest of a job whose pulses will not land quite where they are aimed.

use std::sync::Arc;

use lasergym_geom::{Point, WORKPIECE_SIZE_PX};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::{Job, PlanError};

use super::options::Ramp;
use super::planner::NARROW_RADIUS_PX;

/// Largest standard deviation of a pulse's displacement that can be planned for, px.
pub const MAX_POINTING_ERROR_PX: f64 = 8.0;

/// Aims lie on a lattice of this pitch: what is expected of a pulse is smooth.
const STEPS_PER_PX: usize = 4;

/// Standard deviations beyond which a displacement does not count.
const REACH: f64 = 3.5;

/// Least probability that a pulse leaves a pixel pristine; keeps products above zero.
const LEAST_PRISTINE: f64 = 1e-3;

/// As for [`super::Completion`], in expected pixels.
const TEMPERATURE_PX: Ramp = Ramp { from: 0.5, to: 0.1 };

/// Standard deviation of a move, px.
const STEP_PX: Ramp = Ramp { from: 1.5, to: 0.5 };

/// Temperatures that a refinement goes through; the products are worked out anew before each.
const ROUNDS: u32 = 6;

/// The pulses that are still to come, and what they are expected to gain when each lands with a
/// Gaussian error: a pixel that pulse k machines with probability pₖ stays pristine with
/// probability Π (1 − pₖ).
#[derive(Debug, Clone)]
pub struct ExpectedCompletion {
    blur: Arc<PulseBlur>,
    /// +1 where target remains, −1 where the workpiece must stay, else 0.
    worth: Vec<f32>,
    /// Probability that each pixel stays pristine.
    pristine: Vec<f32>,
    aims: Vec<Aim>,
    gain_px: f64,
    generator: Pcg64Mcg,
}

/// An aim, in lattice steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Aim {
    x: i32,
    y: i32,
}

impl ExpectedCompletion {
    /// The completion of `job` by pulses aimed at `positions`, moved to the nearest places of a
    /// lattice of 1/4 px, each of which lands as `blur` says. `seed` is that of the moves.
    #[must_use]
    pub fn new(job: &Job, positions: &[Point], blur: &Arc<PulseBlur>, seed: u64) -> Self {
        let (remaining, forbidden) = (job.workpiece().remaining(), job.workpiece().forbidden());
        let mut worth = vec![0.0; WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX];
        for (row, column) in remaining.pixels() {
            worth[row * WORKPIECE_SIZE_PX + column] = 1.0;
        }
        for (row, column) in forbidden.pixels() {
            worth[row * WORKPIECE_SIZE_PX + column] = -1.0;
        }
        let mut completion = Self {
            blur: Arc::clone(blur),
            worth,
            pristine: Vec::new(),
            aims: positions.iter().map(|&position| Aim::near(position)).collect(),
            gain_px: 0.0,
            generator: Pcg64Mcg::seed_from_u64(seed),
        };
        completion.work_out();
        completion
    }

    /// The aims, px.
    #[must_use]
    pub fn positions(&self) -> Vec<Point> {
        self.aims.iter().map(|aim| aim.position()).collect()
    }

    /// Hits − misses that all pulses together are expected to gain, px.
    #[must_use]
    pub fn gain_px(&self) -> f64 {
        self.gain_px
    }

    /// What one pulse aimed at the place nearest to `position` is expected to gain at once, px,
    /// where none of the others has been fired.
    #[must_use]
    pub fn first_gain_px(&self, position: Point) -> f64 {
        let (aim, blur) = (Aim::near(position), &self.blur);
        let mut gain_px = 0.0;
        blur.rows(aim, |pixels, kernel| {
            let survives = &blur.survives[kernel];
            let worth = &self.worth[pixels];
            gain_px +=
                worth.iter().zip(survives).map(|(w, s)| f64::from(w * (1.0 - s))).sum::<f64>();
        });
        gain_px
    }

    /// Does `moves` Metropolis moves.
    pub fn refine(&mut self, moves: u64) {
        if self.aims.is_empty() || moves == 0 {
            return;
        }
        for round in 0..ROUNDS {
            self.work_out();
            let fraction = f64::from(round) / f64::from(ROUNDS - 1);
            let (temperature_px, step_px) = (TEMPERATURE_PX.at(fraction), STEP_PX.at(fraction));
            for _ in 0..moves.div_ceil(u64::from(ROUNDS)) {
                self.try_move(temperature_px, step_px);
            }
        }
    }

    fn try_move(&mut self, temperature_px: f64, step_px: f64) {
        let k = self.generator.random_range(0..self.aims.len());
        let mut step = || {
            let normal: f64 = StandardNormal.sample(&mut self.generator);
            (normal * step_px * STEPS_PER_PX as f64).round() as i32
        };
        let from = self.aims[k];
        let to = Aim { x: from.x + step(), y: from.y + step() };
        let edge = (WORKPIECE_SIZE_PX * STEPS_PER_PX) as i32;
        if to == from || !(0..=edge).contains(&to.x) || !(0..=edge).contains(&to.y) {
            return;
        }
        let gain_px = self.lift(from) + self.fire(to);
        if gain_px >= 0.0 || self.generator.random::<f64>() < (gain_px / temperature_px).exp() {
            self.aims[k] = to;
            self.gain_px += gain_px;
        } else {
            self.lift(to);
            self.fire(from);
        }
    }

    /// Works out the products from the aims.
    fn work_out(&mut self) {
        self.pristine.clear();
        self.pristine.resize(self.worth.len(), 1.0);
        self.gain_px = 0.0;
        for k in 0..self.aims.len() {
            self.gain_px += self.fire(self.aims[k]);
        }
    }

    /// Adds a pulse and returns what is expected of it, px.
    fn fire(&mut self, aim: Aim) -> f64 {
        let Self { blur, worth, pristine, .. } = self;
        let mut gain_px = 0.0;
        blur.rows(aim, |pixels, kernel| {
            gain_px +=
                multiply(&worth[pixels.clone()], &mut pristine[pixels], &blur.survives[kernel]);
        });
        gain_px
    }

    /// Takes a pulse away and returns what that gains, px.
    fn lift(&mut self, aim: Aim) -> f64 {
        let Self { blur, worth, pristine, .. } = self;
        let mut gain_px = 0.0;
        blur.rows(aim, |pixels, kernel| {
            gain_px +=
                multiply(&worth[pixels.clone()], &mut pristine[pixels], &blur.revives[kernel]);
        });
        gain_px
    }
}

/// Multiplies `pristine` by `factors` and returns the change of Σ worth · (1 − pristine).
#[inline]
fn multiply(worth: &[f32], pristine: &mut [f32], factors: &[f32]) -> f64 {
    let mut gain = 0.0_f32;
    for ((worth, pristine), factor) in worth.iter().zip(pristine).zip(factors) {
        let next = *pristine * factor;
        gain += worth * (*pristine - next);
        *pristine = next;
    }
    f64::from(gain)
}

impl Aim {
    fn near(position: Point) -> Self {
        let step = |coordinate: f64| (coordinate * STEPS_PER_PX as f64).round() as i32;
        Self { x: step(position.x), y: step(position.y) }
    }

    fn position(self) -> Point {
        let coordinate = |step: i32| f64::from(step) / STEPS_PER_PX as f64;
        Point::new(coordinate(self.x), coordinate(self.y))
    }
}

/// Probabilities that a pulse which lands with a Gaussian error leaves the pixels about its aim
/// pristine, for each place of the aim within its pixel.
#[derive(Debug, Clone)]
pub struct PulseBlur {
    reach_px: usize,
    /// Shape (steps y, steps x, side, side).
    survives: Vec<f32>,
    /// The inverses.
    revives: Vec<f32>,
}

impl PulseBlur {
    /// Pulses of `pulse_radius_px` that are displaced by `pointing_error_px` (standard deviation
    /// along each axis).
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] for a pointing error outside (0, 8] px or a radius outside (0, 24]
    /// px.
    pub fn new(pulse_radius_px: f64, pointing_error_px: f64) -> Result<Self, PlanError> {
        for (name, value, most, expected) in [
            ("pointing_error_px", pointing_error_px, MAX_POINTING_ERROR_PX, "in (0, 8] px"),
            ("pulse_radius_px", pulse_radius_px, NARROW_RADIUS_PX, "in (0, 24] px"),
        ] {
            if !(value > 0.0 && value <= most) {
                let value = value.to_string();
                return Err(PlanError::InvalidOption { name, value, expected });
            }
        }
        let reach_px = (pulse_radius_px + REACH * pointing_error_px).ceil() as usize;
        let side = 2 * reach_px + 1;
        let radial = RadialProbability::new(pulse_radius_px, pointing_error_px);
        let mut survives = Vec::with_capacity(STEPS_PER_PX * STEPS_PER_PX * side * side);
        let centre = |k: usize| k as f64 + 0.5 - reach_px as f64;
        for step_y in 0..STEPS_PER_PX {
            for step_x in 0..STEPS_PER_PX {
                let at = |step: usize| step as f64 / STEPS_PER_PX as f64;
                for row in 0..side {
                    for column in 0..side {
                        let distance_px =
                            (centre(row) - at(step_y)).hypot(centre(column) - at(step_x));
                        let pristine = 1.0 - radial.at(distance_px);
                        survives.push(pristine.max(LEAST_PRISTINE) as f32);
                    }
                }
            }
        }
        let revives = survives.iter().map(|s| 1.0 / s).collect();
        Ok(Self { reach_px, survives, revives })
    }

    /// Calls `each` with the pixels of every row that a pulse at `aim` may reach, and the entries of
    /// the tables that belong to them.
    #[inline]
    fn rows(&self, aim: Aim, mut each: impl FnMut(std::ops::Range<usize>, std::ops::Range<usize>)) {
        let (size, steps) = (WORKPIECE_SIZE_PX as i32, STEPS_PER_PX as i32);
        let (reach, side) = (self.reach_px as i32, 2 * self.reach_px as i32 + 1);
        let (column, row) = (aim.x.div_euclid(steps), aim.y.div_euclid(steps));
        let table = (aim.y.rem_euclid(steps) * steps + aim.x.rem_euclid(steps)) * side * side;
        let (first, end) = ((column - reach).max(0), (column + reach + 1).min(size));
        if first >= end {
            return;
        }
        for y in (row - reach).max(0)..(row + reach + 1).min(size) {
            let pixels = (y * size + first) as usize..(y * size + end) as usize;
            let start = table + (y - row + reach) * side + first - (column - reach);
            each(pixels, start as usize..(start + end - first) as usize);
        }
    }
}

/// Probability that a disc whose centre is displaced by a Gaussian error covers a point, by the
/// distance of the point from the aim: P(|d + e| ≤ r), a Rice distribution.
struct RadialProbability {
    values: Vec<f64>,
}

impl RadialProbability {
    /// Entries for each px.
    const RESOLUTION: f64 = 32.0;

    fn new(radius_px: f64, deviation_px: f64) -> Self {
        let furthest_px = radius_px + (REACH + 1.0) * deviation_px + 2.0;
        let entries = (furthest_px * Self::RESOLUTION).ceil() as usize;
        let values = (0..=entries)
            .map(|k| covered(k as f64 / Self::RESOLUTION, radius_px, deviation_px))
            .collect();
        Self { values }
    }

    fn at(&self, distance_px: f64) -> f64 {
        let entry = distance_px * Self::RESOLUTION;
        let (low, fraction) = (entry.floor() as usize, entry.fract());
        match (self.values.get(low), self.values.get(low + 1)) {
            (Some(a), Some(b)) => a + (b - a) * fraction,
            _ => 0.0,
        }
    }
}

/// Integrates the normal density along x; along y it is an error function.
fn covered(distance_px: f64, radius_px: f64, deviation_px: f64) -> f64 {
    const STEPS: usize = 400;
    let width_px = 2.0 * radius_px / STEPS as f64;
    (0..STEPS)
        .map(|k| {
            let x_px = -radius_px + (k as f64 + 0.5) * width_px;
            let half_chord_px = (radius_px * radius_px - x_px * x_px).sqrt();
            let along = (x_px - distance_px) / deviation_px;
            let density =
                (-0.5 * along * along).exp() / (deviation_px * std::f64::consts::TAU.sqrt());
            density * error_function(half_chord_px / (deviation_px * std::f64::consts::SQRT_2))
        })
        .sum::<f64>()
        * width_px
}

/// erf of x ≥ 0 to 1.5e-7 (Abramowitz and Stegun 7.1.26).
fn error_function(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let polynomial = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592]
        .into_iter()
        .fold(0.0, |sum, coefficient| sum * t + coefficient);
    1.0 - polynomial * t * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Greedy, Planner};
    use lasergym_ablation::{Stream, Workpiece, star};
    use proptest::prelude::*;

    fn job(pulses: usize) -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, pulses).unwrap()
    }

    fn blur(deviation_px: f64) -> Arc<PulseBlur> {
        Arc::new(PulseBlur::new(9.0, deviation_px).unwrap())
    }

    #[test]
    fn a_disc_covers_as_often_as_it_does_in_trials() {
        let mut stream = Stream::from_seed(1);
        for (distance_px, deviation_px) in [(0.0, 1.0), (8.0, 1.0), (9.5, 2.0), (14.0, 3.0)] {
            let aside = Point::new(distance_px, 0.0);
            let trials = 20_000;
            let hits = (0..trials)
                .filter(|_| (aside + stream.displacement(deviation_px)).length() <= 9.0)
                .count();
            let expected = RadialProbability::new(9.0, deviation_px).at(distance_px);
            let found = hits as f64 / f64::from(trials);
            assert!((found - expected).abs() < 0.015, "{distance_px}: {found} {expected}");
        }
    }

    #[test]
    fn what_is_expected_is_the_mean_of_trials() {
        let job = job(40);
        let plan = Greedy::default().plan_to_end(&job).unwrap();
        let mut stream = Stream::from_seed(2);
        for deviation_px in [0.5, 2.0] {
            let completion = ExpectedCompletion::new(&job, &plan.positions, &blur(deviation_px), 0);
            let trials = 300;
            let sum_px: i32 = (0..trials)
                .map(|_| {
                    let displaced: Vec<Point> = plan
                        .positions
                        .iter()
                        .map(|&p| p + stream.displacement(deviation_px))
                        .collect();
                    job.outcome(&displaced).gain_px()
                })
                .sum();
            let mean_px = f64::from(sum_px) / f64::from(trials);
            assert!(
                (completion.gain_px() - mean_px).abs() < 12.0,
                "{mean_px} {}",
                completion.gain_px()
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]
        #[test]
        fn gains_that_are_kept_up_are_those_worked_out_anew(
            seed in 0_u64..1000, deviation_px in 0.3..4.0,
        ) {
            let job = job(20);
            let plan = Greedy::default().plan_to_end(&job).unwrap();
            let mut completion =
                ExpectedCompletion::new(&job, &plan.positions, &blur(deviation_px), seed);
            let before_px = completion.gain_px();
            completion.refine(1200);
            let anew =
                ExpectedCompletion::new(&job, &completion.positions(), &blur(deviation_px), 0);
            prop_assert!((anew.gain_px() - completion.gain_px()).abs() < 0.5);
            prop_assert!(completion.gain_px() > before_px - 5.0);
        }
    }

    #[test]
    fn a_first_pulse_alone_is_worth_what_the_plan_of_it_is() {
        let aim = Point::new(50.0, 50.0);
        let completion = ExpectedCompletion::new(&job(1), &[aim], &blur(1.0), 0);
        assert!((completion.first_gain_px(aim) - completion.gain_px()).abs() < 0.01);
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        for (radius_px, error_px) in [(9.0, 0.0), (9.0, f64::NAN), (9.0, 9.0), (30.0, 1.0)] {
            let error = PulseBlur::new(radius_px, error_px).unwrap_err();
            assert!(matches!(error, PlanError::InvalidOption { .. }), "{error}");
        }
    }
}
