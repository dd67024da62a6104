//! Where the beam is after a stroke has started, along the stroke: what run-ins and delays follow from.

use lasergym_geom::Point;

use crate::axis::{AxisModel, AxisTracker, Follower};
use crate::calibration::Calibration;
use crate::compensation::KnownAxes;
use crate::servo::Ramp;

/// An axis whose part of the direction is below this hardly moves: it is not waited for.
const LEAST_PART: f64 = 1e-3;

/// Samples of a start.
const SAMPLES: u32 = 2400;

/// A start of one axis at a speed, sampled at even times from 0 on.
#[derive(Debug, Clone)]
struct AxisStart {
    step_us: f64,
    positions_um: Vec<f64>,
    /// Time after which the speed stays within the tolerance, µs.
    settled_us: f64,
    /// Time after a stop until the speed leaves the tolerance, µs.
    holding_us: f64,
}

impl AxisStart {
    fn sample(axis: &AxisModel, speed: f64, tolerance: f64, end_us: f64) -> Self {
        let step_us = end_us / f64::from(SAMPLES);
        let mut tracker = AxisTracker::new(axis, 0.0);
        tracker.command(Ramp { start_um: 0.0, speed, duration_us: 2.0 * end_us });
        let mut start = Self { step_us, positions_um: vec![0.0], settled_us: 0.0, holding_us: 0.0 };
        let mut held = true;
        for k in 1..=SAMPLES {
            tracker.advance(step_us);
            let mirror = tracker.mirror();
            start.positions_um.push(mirror.position_um);
            let part = mirror.speed_m_s / speed;
            if (part - 1.0).abs() > tolerance {
                start.settled_us = f64::from(k) * step_us;
            }
            // A stop from a steady speed is a start the other way round, limit or not.
            held = held && part.abs() <= tolerance;
            if held {
                start.holding_us = f64::from(k) * step_us;
            }
        }
        start
    }
}

/// Time after which an axis has forgotten its start at `speed`, µs.
fn forgetting_us(axis: &AxisModel, speed: f64) -> f64 {
    let accelerating_us = match &axis.follower {
        Follower::Limited(servo) => 1e6 * speed / servo.acceleration_limit_m_s2,
        Follower::Servo(_) | Follower::Step(_) => 0.0,
    };
    12.0 * axis.lag_us().max(1.0) + 8.0 * accelerating_us
}

/// How the beam starts along a stroke.
#[derive(Debug, Clone)]
pub(crate) struct Approach {
    speed: f64,
    /// Lag along the stroke, µs.
    pub(crate) lag_us: f64,
    /// How far the beam runs beside its command, to the right of the direction, µm.
    pub(crate) lateral_um: f64,
    /// Time from the start after which the speed is even, µs.
    pub(crate) settled_us: f64,
    /// Time after a stop until it is no longer even, µs.
    pub(crate) holding_us: f64,
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    /// Sampled positions, µm, every `step_us`.
    Sampled { step_us: f64, positions_um: Vec<f64> },
    /// Ahead of the steady lag by this when settled, which fades within another lag, µm.
    Led(f64),
}

/// The starts of a head, kept as long as they can be used again.
#[derive(Debug, Clone)]
pub(crate) struct Approaches<'a> {
    axes: &'a KnownAxes,
    tolerance: f64,
    /// Of linear axes: their starts at 1 m/s.
    at_unit_speed: Option<[AxisStart; 2]>,
}

impl<'a> Approaches<'a> {
    pub(crate) fn new(axes: &'a KnownAxes, tolerance: f64) -> Self {
        let at_unit_speed = match axes {
            KnownAxes::Model { x, y } if x.is_linear() && y.is_linear() => {
                let end_us = forgetting_us(x, 1.0).max(forgetting_us(y, 1.0));
                let first = AxisStart::sample(x, 1.0, tolerance, end_us);
                let second = if x == y {
                    first.clone()
                } else {
                    AxisStart::sample(y, 1.0, tolerance, end_us)
                };
                Some([first, second])
            }
            _ => None,
        };
        Self { axes, tolerance, at_unit_speed }
    }

    /// Whether every direction is alike.
    pub(crate) fn are_even(&self) -> bool {
        match self.axes {
            KnownAxes::Lines { x, y } => x == y,
            KnownAxes::Model { x, y } => x == y && x.is_linear(),
        }
    }

    /// Speed up to which the axes are known to be linear, or to have been measured, if there is such a
    /// bound, m/s.
    pub(crate) fn fastest_m_s(&self) -> Option<f64> {
        let of_axes = match self.axes {
            KnownAxes::Lines { x, y } => [x, y].map(|axis| {
                let last = axis.acceleration.points.last();
                last.map(|point| point.speed_m_s)
            }),
            KnownAxes::Model { x, y } => [x, y].map(|axis| match &axis.follower {
                Follower::Limited(servo) => Some(servo.free_speed_m_s()),
                Follower::Servo(_) | Follower::Step(_) => None,
            }),
        };
        of_axes.into_iter().flatten().reduce(f64::min)
    }

    /// The start of a stroke along `direction`, of length 1.
    pub(crate) fn approach(&self, speed: f64, direction: Point) -> Approach {
        // Where every direction is alike, x stands for all.
        let direction = if self.are_even() { Point::new(1.0, 0.0) } else { direction };
        match self.axes {
            KnownAxes::Lines { x, y } => of_lines([x, y], speed, direction),
            KnownAxes::Model { x, y } => self.of_models([x, y], speed, direction),
        }
    }

    fn of_models(&self, axes: [&AxisModel; 2], speed: f64, direction: Point) -> Approach {
        let parts = [direction.x.abs(), direction.y.abs()];
        let fresh;
        let (starts, scale) = if let Some(starts) = &self.at_unit_speed {
            (starts, speed)
        } else {
            let speeds = parts.map(|part| (part * speed).max(1e-6));
            let end_us = forgetting_us(axes[0], speed).max(forgetting_us(axes[1], speed));
            fresh = [0, 1].map(|k| AxisStart::sample(axes[k], speeds[k], self.tolerance, end_us));
            (&fresh, 1.0)
        };
        // A start of a linear axis grows with its part of the speed, one that was sampled anew is at it.
        let weights = if self.at_unit_speed.is_some() {
            parts.map(|part| part * part * scale)
        } else {
            parts
        };
        let [x, y] = starts;
        let pairs = x.positions_um.iter().zip(&y.positions_um);
        let positions_um = pairs.map(|(x, y)| weights[0] * x + weights[1] * y).collect();
        let moving = || starts.iter().zip(parts).filter(|(_, part)| *part >= LEAST_PART);
        let lags = axes.map(AxisModel::lag_us);
        Approach {
            speed,
            lag_us: along(lags, direction),
            lateral_um: beside(lags, speed, direction),
            settled_us: moving().map(|(start, _)| start.settled_us).fold(0.0, f64::max),
            holding_us: moving().map(|(start, _)| start.holding_us).fold(f64::INFINITY, f64::min),
            way: Way::Sampled { step_us: x.step_us, positions_um },
        }
    }
}

/// Σ u² τ: the lag along a direction.
fn along(lags_us: [f64; 2], direction: Point) -> f64 {
    direction.x.powi(2) * lags_us[0] + direction.y.powi(2) * lags_us[1]
}

/// V `u_x` `u_y` (`τ_y` − `τ_x`): at a constant speed the beam is at command − V (`u_x` `τ_x`, `u_y`
/// `τ_y`), which is that much to the right of the command's line.
fn beside(lags_us: [f64; 2], speed: f64, direction: Point) -> f64 {
    speed * direction.x * direction.y * (lags_us[1] - lags_us[0])
}

/// The formulas of test lines, each axis at its own part of the speed.
fn of_lines(axes: [&Calibration; 2], speed: f64, direction: Point) -> Approach {
    let parts = [direction.x.abs(), direction.y.abs()];
    let mut lags = [0.0; 2];
    let (mut settled_us, mut lead_um) = (0.0_f64, 0.0);
    for k in 0..2 {
        if parts[k] < LEAST_PART {
            continue;
        }
        let own = parts[k] * speed;
        lags[k] = axes[k].lag.at_um(own) / own;
        let lead = axes[k].lead.as_ref().map_or(0.0, |lead| lead.signed_um(own));
        let ramp_um = (axes[k].acceleration.at_um(own) - lead).max(0.0);
        settled_us = settled_us.max(lags[k] + ramp_um / own);
        lead_um += parts[k] * lead;
    }
    let lag_us = along(lags, direction);
    Approach {
        speed,
        lag_us,
        lateral_um: if parts[0].min(parts[1]) < LEAST_PART {
            0.0
        } else {
            beside(lags, speed, direction)
        },
        settled_us,
        holding_us: 0.0,
        way: Way::Led(lead_um),
    }
}

impl Approach {
    /// Whether it comes from models.
    pub(crate) fn is_sampled(&self) -> bool {
        matches!(self.way, Way::Sampled { .. })
    }

    /// Where the beam is `t_us` after a start, along the stroke, µm.
    pub(crate) fn start_um(&self, t_us: f64) -> f64 {
        if t_us <= 0.0 {
            return 0.0;
        }
        let steady_um = self.speed * (t_us - self.lag_us);
        match &self.way {
            Way::Sampled { step_us, positions_um } => {
                let place = t_us / step_us;
                let k = place as usize;
                match (positions_um.get(k), positions_um.get(k + 1)) {
                    (Some(low), Some(high)) => low + (high - low) * (place - k as f64),
                    _ => steady_um,
                }
            }
            Way::Led(lead_um) => {
                let faded = (t_us - self.settled_us) / self.lag_us.max(1e-9);
                (steady_um + lead_um * (1.0 - faded).clamp(0.0, 1.0)).max(0.0)
            }
        }
    }

    /// Where the beam is at `t_us` when its command stops at `stop_us`, µm.
    fn at_um(&self, t_us: f64, stop_us: f64) -> f64 {
        self.start_um(t_us) - self.start_um(t_us - stop_us)
    }

    /// When the beam passes `way_um`, if the command stops at `stop_us`, µs.
    pub(crate) fn passing_us(&self, way_um: f64, stop_us: f64) -> f64 {
        let mut t_us = self.lag_us + way_um / self.speed;
        for _ in 0..12 {
            let step_us = (way_um - self.at_um(t_us, stop_us)) / self.speed;
            t_us += step_us;
            if step_us.abs() < 1e-6 {
                return t_us;
            }
        }
        // Far from its set speed: between the start and long after.
        let (mut low_us, mut high_us) = (0.0, 40.0 * self.lag_us + way_um / self.speed);
        for _ in 0..60 {
            let middle_us = 0.5 * (low_us + high_us);
            if self.at_um(middle_us, stop_us) < way_um {
                low_us = middle_us;
            } else {
                high_us = middle_us;
            }
        }
        0.5 * (low_us + high_us)
    }

    /// How long after a stop the beam still has `left_um` to go, µs.
    pub(crate) fn leaving_us(&self, left_um: f64) -> f64 {
        let (mut low_us, mut high_us) = (0.0, 20.0 * self.lag_us);
        for _ in 0..60 {
            let middle_us = 0.5 * (low_us + high_us);
            // What a start has covered, a stop has yet to cover.
            let to_go_um = self.speed * (self.lag_us - middle_us) + self.start_um(middle_us);
            if to_go_um > left_um {
                low_us = middle_us;
            } else {
                high_us = middle_us;
            }
        }
        0.5 * (low_us + high_us)
    }
}

/// Acceleration length at 1 m/s within `tolerance`, µm per m/s, of a linear axis.
pub(crate) fn acceleration_us(axis: &AxisModel, tolerance: f64) -> f64 {
    let start = AxisStart::sample(axis, 1.0, tolerance, forgetting_us(axis, 1.0));
    let k = (start.settled_us / start.step_us).round() as usize;
    start.positions_um.get(k).copied().unwrap_or(0.0).max(0.0)
}
