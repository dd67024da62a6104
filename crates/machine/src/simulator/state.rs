//! What a rig is made of between two commands, and what chance does to it.

use lasergym_ablation::Stream;
use lasergym_geom::Point;
use serde::{Deserialize, Serialize};

use super::SimulatorOptions;

/// What the laser has really machined.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueMark {
    /// Centre, px of the pattern, to the right.
    pub x_px: f64,
    /// Centre, px of the pattern, down.
    pub y_px: f64,
    /// Radius, px of the pattern.
    pub radius_px: f64,
    /// Which call of `fire` made it, from 0; a double fire makes two marks with the same number.
    pub pulse: u64,
}

impl TrueMark {
    /// Centre, px of the pattern.
    #[must_use]
    pub fn center_px(&self) -> Point {
        Point::new(self.x_px, self.y_px)
    }
}

/// A speck of dust or a fragment on the workpiece.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Speck {
    /// Centre, px of the pattern, to the right.
    pub x_px: f64,
    /// Centre, px of the pattern, down.
    pub y_px: f64,
    /// Radius, px of the pattern.
    pub radius_px: f64,
    /// How much darker it is than the ground, in [0, 1].
    pub opacity: f64,
}

/// Virtual time of a rig, phase by phase.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseTimes {
    /// Moving, s.
    pub move_s: f64,
    /// Settling after moves, s.
    pub settle_s: f64,
    /// Exposing and reading frames, s.
    pub expose_s: f64,
    /// Pulses, s.
    pub pulse_s: f64,
}

impl PhaseTimes {
    /// All phases together, s.
    #[must_use]
    pub fn total_s(&self) -> f64 {
        self.move_s + self.settle_s + self.expose_s + self.pulse_s
    }
}

/// All that a rig is made of: saved and loaded, a rig goes on exactly as it would have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigState {
    /// Its errors.
    pub options: SimulatorOptions,
    /// Seed of all that is random in it.
    pub seed: u64,
    /// What has been machined, in order.
    pub marks: Vec<TrueMark>,
    /// What lies on the workpiece.
    pub specks: Vec<Speck>,
    /// Where the stage was sent, µm (x, y).
    pub commanded_um: [f64; 2],
    /// Where the screw stands, which the encoders see, µm (x, y).
    pub screw_um: [f64; 2],
    /// Where the screw has pushed the carriage, without drift, µm (x, y).
    pub carriage_um: [f64; 2],
    /// What lay under the laser when the last frame was exposed, µm (x, y).
    pub frame_taken_at_um: [f64; 2],
    /// Moves so far.
    pub moves: u64,
    /// Calls of `fire` so far.
    pub pulses: u64,
    /// Frames so far.
    pub frames: u64,
    /// Whether the laser would fire.
    pub armed: bool,
    /// Exposure of the next frame, s.
    pub exposure_s: f64,
    /// Virtual time so far.
    pub elapsed: PhaseTimes,
}

/// What randomness is drawn for. Each event has its own stream, so that a rig is the same however
/// its calls are split over processes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Event {
    Ground,
    Sensor,
    Drift,
    Move,
    Pulse,
    Frame,
    Dust,
}

/// The random stream of event `number` of its kind.
pub(super) fn stream_of(seed: u64, event: Event, number: u64) -> Stream {
    // SplitMix64 (Steele et al. 2014) of the three numbers.
    let mix = |value: u64| {
        let z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    Stream::from_seed(mix(mix(mix(seed) ^ event as u64) ^ number))
}

/// A number with a Poisson distribution of the given mean, at most 10 000.
pub(super) fn poisson(stream: &mut Stream, mean: f64) -> usize {
    // Sums of independent Poisson numbers are Poisson: parts small enough for the product method.
    let parts = (mean / 16.0).ceil().max(1.0);
    let limit = (-mean / parts).exp();
    let mut count = 0;
    for _ in 0..parts as usize {
        let mut product = stream.uniform();
        while product > limit && count < 10_000 {
            product *= stream.uniform();
            count += 1;
        }
    }
    count
}

/// A direction, every one as likely.
pub(super) fn direction(stream: &mut Stream) -> Point {
    let (sin, cos) = (std::f64::consts::TAU * stream.uniform()).sin_cos();
    Point::new(cos, sin)
}

/// A distance with an exponential distribution.
pub(super) fn exponential(stream: &mut Stream, mean: f64) -> f64 {
    -mean * (1.0 - stream.uniform()).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poisson_has_its_mean_and_variance() {
        for mean in [0.0, 0.3, 6.0, 80.0] {
            let mut stream = Stream::from_seed(3);
            let draws: Vec<f64> = (0..20_000).map(|_| poisson(&mut stream, mean) as f64).collect();
            let average = draws.iter().sum::<f64>() / 2e4;
            let variance = draws.iter().map(|n| (n - average).powi(2)).sum::<f64>() / 2e4;
            assert!((average - mean).abs() <= 5.0 * (mean / 2e4).sqrt(), "{mean}: {average}");
            assert!((variance - mean).abs() <= 0.06 * mean, "{mean}: {variance}");
        }
    }

    #[test]
    fn streams_differ_by_seed_event_and_number() {
        let draw = |seed, event, number| stream_of(seed, event, number).uniform().to_bits();
        assert_eq!(draw(1, Event::Pulse, 0), draw(1, Event::Pulse, 0));
        assert_ne!(draw(1, Event::Pulse, 0), draw(1, Event::Pulse, 1));
        assert_ne!(draw(1, Event::Pulse, 0), draw(1, Event::Frame, 0));
        assert_ne!(draw(1, Event::Pulse, 0), draw(2, Event::Pulse, 0));
    }
}
