//! Models of an axis from a recorded trajectory: command and position against time.

use std::fmt::Write;

use crate::GalvoError;
use crate::axis::{AxisModel, AxisTracker, Follower};
use crate::least_squares::{Fit, least_squares};
use crate::servo::{Ramp, ServoPoles};
use crate::step_response::StepResponse;
use crate::table::read_table;

/// First line of a recorded trajectory. The command is linear between its samples.
pub const TRAJECTORY_HEADER: &str = "time_us,command_um,position_um";

/// Most samples of a trajectory.
pub const MAX_TRAJECTORY_SAMPLES: usize = 100_000;

/// One sample of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectorySample {
    /// Time, µs.
    pub time_us: f64,
    /// Command, µm.
    pub command_um: f64,
    /// Measured position, µm.
    pub position_um: f64,
}

/// A family of models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelFamily {
    /// Third-order Bessel servo and dead time.
    Bessel,
    /// Second-order servo and dead time.
    SecondOrder,
    /// Constant acceleration time and dead time.
    AccelerationTime,
}

impl ModelFamily {
    /// All families.
    pub const ALL: [Self; 3] = [Self::Bessel, Self::SecondOrder, Self::AccelerationTime];

    /// Its name in head files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bessel => "bessel",
            Self::SecondOrder => "second-order",
            Self::AccelerationTime => "acceleration-time",
        }
    }

    /// Names of the parameters, as in head files.
    #[must_use]
    pub fn parameters(self) -> &'static [&'static str] {
        match self {
            Self::Bessel => &["lag_us", "dead_time_us"],
            Self::SecondOrder => &["lag_us", "dead_time_us", "damping"],
            Self::AccelerationTime => &["acceleration_time_us", "dead_time_us"],
        }
    }

    /// The model of parameters in units of 100 µs (damping in units of 1).
    fn model(self, values: &[f64]) -> Option<AxisModel> {
        let (size_us, dead_time_us) = (100.0 * values[0], 100.0 * values[1].max(0.0));
        if !(1.0..=1e5).contains(&size_us) {
            return None;
        }
        let follower = match self {
            Self::Bessel => Follower::Servo(ServoPoles::bessel(size_us)),
            Self::SecondOrder => Follower::Servo(ServoPoles::second_order(size_us, values[2])),
            Self::AccelerationTime => {
                Follower::Step(StepResponse::constant_acceleration(size_us).ok()?)
            }
        };
        let model = AxisModel { follower, dead_time_us };
        model.validate().ok()?;
        Some(model)
    }

    /// Where a search starts, for a lag of `lag_us`.
    fn starts(self, lag_us: f64) -> Vec<Vec<f64>> {
        let lag = lag_us / 100.0;
        let parts = [0.1, 0.4];
        match self {
            Self::Bessel => parts.map(|dead| vec![lag * (1.0 - dead), lag * dead]).to_vec(),
            Self::SecondOrder => {
                parts.map(|dead| vec![lag * (1.0 - dead), lag * dead, 0.75]).to_vec()
            }
            Self::AccelerationTime => {
                parts.map(|dead| vec![2.0 * lag * (1.0 - dead), lag * dead]).to_vec()
            }
        }
    }
}

/// A model fitted to a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The family.
    pub family: ModelFamily,
    /// The model.
    pub model: AxisModel,
    /// Parameters in the order of [`ModelFamily::parameters`].
    pub values: Vec<f64>,
    /// Half-widths of their 95 % intervals, for many samples.
    pub confidence_95: Vec<f64>,
    /// Root mean square distance between measured and modelled positions, µm.
    pub rms_um: f64,
}

impl Identification {
    /// The model as the TOML section `[axis]` of a head file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut text = format!("[axis]\nkind = \"{}\"\n", self.family.name());
        for (name, value) in self.family.parameters().iter().zip(&self.values) {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{name} = {value:?}");
        }
        text
    }
}

/// The samples in a text: [`TRAJECTORY_HEADER`], then a line for each.
///
/// # Errors
/// [`GalvoError::Table`] for what is no table of numbers.
pub fn read_trajectory(text: &str) -> Result<Vec<TrajectorySample>, GalvoError> {
    let rows = read_table(text, TRAJECTORY_HEADER)?;
    let samples = rows.iter().map(|row| TrajectorySample {
        time_us: row[0],
        command_um: row[1],
        position_um: row[2],
    });
    Ok(samples.collect())
}

/// Fits a model of `family` to a trajectory that begins at rest.
///
/// # Errors
/// [`GalvoError::Calibration`] when there are fewer than 10 or more than
/// [`MAX_TRAJECTORY_SAMPLES`] samples, times do not increase, nothing moves, or the samples do not
/// determine the parameters.
pub fn identify(
    samples: &[TrajectorySample],
    family: ModelFamily,
) -> Result<Identification, GalvoError> {
    let fault = |reason: &str| GalvoError::Calibration { reason: reason.to_owned() };
    if !(10..=MAX_TRAJECTORY_SAMPLES).contains(&samples.len()) {
        return Err(fault("10 to 100000 samples are needed"));
    }
    if samples.windows(2).any(|pair| pair[1].time_us <= pair[0].time_us) {
        return Err(fault("times must increase"));
    }
    let lag_us = lag_of(samples).ok_or_else(|| fault("the command does not move"))?;
    let residuals = |values: &[f64]| {
        let model = family.model(values)?;
        let modelled = follow(&model, samples);
        // A negative dead time is no model: it counts as its own distance from one.
        let beyond = 100.0 * values[1].min(0.0);
        Some(samples.iter().zip(modelled).map(|(s, x)| x - s.position_um + beyond).collect())
    };
    let fits =
        family.starts(lag_us).into_iter().filter_map(|start| least_squares(&start, residuals));
    let best: Option<Fit> = fits.fold(None, |best: Option<Fit>, fit| match best {
        Some(best) if best.rms <= fit.rms => Some(best),
        _ => Some(fit),
    });
    let fit = best.ok_or_else(|| fault("the samples do not determine the model"))?;
    let values = fit.values.as_slice();
    let model = family.model(values).ok_or_else(|| fault("no stable model fits"))?;
    let unit = |k: usize| if k < 2 { 100.0 } else { 1.0 };
    Ok(Identification {
        family,
        model,
        values: values.iter().enumerate().map(|(k, value)| (value * unit(k)).max(0.0)).collect(),
        confidence_95: fit.errors.iter().enumerate().map(|(k, e)| 1.96 * e * unit(k)).collect(),
        rms_um: fit.rms,
    })
}

/// The family that fits best.
///
/// # Errors
/// As [`identify`], when no family fits.
pub fn identify_best(samples: &[TrajectorySample]) -> Result<Identification, GalvoError> {
    let mut best = identify(samples, ModelFamily::Bessel);
    for family in [ModelFamily::SecondOrder, ModelFamily::AccelerationTime] {
        let found = identify(samples, family);
        let better = match (&best, &found) {
            (Ok(best), Ok(found)) => found.rms_um < best.rms_um,
            (Err(_), Ok(_)) => true,
            _ => false,
        };
        if better {
            best = found;
        }
    }
    best
}

/// About the lag: where the command moves, command minus position over speed.
fn lag_of(samples: &[TrajectorySample]) -> Option<f64> {
    let (mut products, mut squares) = (0.0, 0.0);
    for pair in samples.windows(2) {
        let speed = (pair[1].command_um - pair[0].command_um) / (pair[1].time_us - pair[0].time_us);
        products += speed * (pair[1].command_um - pair[1].position_um);
        squares += speed * speed;
    }
    (squares > 0.0).then(|| (products / squares).clamp(5.0, 1e4))
}

/// Where a model is at each sample, µm.
fn follow(model: &AxisModel, samples: &[TrajectorySample]) -> Vec<f64> {
    let Some(first) = samples.first() else { return Vec::new() };
    let mut tracker = AxisTracker::new(model, first.command_um);
    let mut positions = vec![first.command_um];
    for pair in samples.windows(2) {
        let duration_us = pair[1].time_us - pair[0].time_us;
        let speed = (pair[1].command_um - pair[0].command_um) / duration_us;
        tracker.command(Ramp { start_um: pair[0].command_um, speed, duration_us });
        tracker.advance(duration_us);
        positions.push(tracker.mirror().position_um);
    }
    positions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ScanHead;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    /// A ramp there and back, sampled every 10 µs with a noise of 1 µm.
    fn recording(model: &AxisModel) -> Vec<TrajectorySample> {
        let mut generator = rand_pcg::Pcg64::seed_from_u64(4);
        let noise = Normal::new(0.0, 1.0).unwrap();
        let command = |t: f64| if t < 1000.0 { 2.0 * t } else { (4000.0 - 2.0 * t).max(0.0) };
        let mut samples: Vec<TrajectorySample> = (0..300)
            .map(|k| {
                let time_us = 10.0 * f64::from(k);
                TrajectorySample { time_us, command_um: command(time_us), position_um: 0.0 }
            })
            .collect();
        let positions = follow(model, &samples);
        for (sample, position) in samples.iter_mut().zip(positions) {
            sample.position_um = position + noise.sample(&mut generator);
        }
        samples
    }

    #[test]
    fn the_head_that_was_recorded_is_found() {
        for (name, family) in [
            ("bessel", ModelFamily::Bessel),
            ("second-order", ModelFamily::SecondOrder),
            ("dead-time", ModelFamily::SecondOrder),
            ("acceleration-time", ModelFamily::AccelerationTime),
        ] {
            let head = ScanHead::shipped(name).unwrap();
            let samples = recording(&head.x);
            let found = identify(&samples, family).unwrap();
            assert!((found.model.lag_us() - head.x.lag_us()).abs() < 1.0, "{name}: {found:?}");
            assert!(found.rms_um < 1.2, "{name}: {found:?}");
            let again = ScanHead::from_toml(&found.to_toml()).unwrap();
            assert!((again.x.lag_us() - found.model.lag_us()).abs() < 1e-9);
        }
    }

    #[test]
    fn the_best_family_wins() {
        let head = ScanHead::shipped("acceleration-time").unwrap();
        let found = identify_best(&recording(&head.x)).unwrap();
        assert_eq!(found.family, ModelFamily::AccelerationTime);
    }

    #[test]
    fn useless_recordings_are_refused() {
        let still = TrajectorySample { time_us: 0.0, command_um: 1.0, position_um: 1.0 };
        let resting: Vec<TrajectorySample> =
            (0..20).map(|k| TrajectorySample { time_us: f64::from(k), ..still }).collect();
        for samples in [vec![still; 3], vec![still; 20], resting] {
            let error = identify(&samples, ModelFamily::Bessel).unwrap_err();
            assert!(matches!(error, GalvoError::Calibration { .. }), "{error}");
        }
        assert!(read_trajectory("time_us,command_um,position_um\n1,2\n").is_err());
    }
}
