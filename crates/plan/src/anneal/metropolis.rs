//! Metropolis moves of single pulses at sub-pixel positions.

use rand::Rng;
use rand_pcg::Pcg64Mcg;

use super::cover::Cover;
use super::lattice::{EDGE, MAX_STEP_PX, Place, STEPS_PER_PX};
use super::window::Window;

/// Entries of the table of steps.
const STEP_CHOICES: usize = 256;

/// Losses from here on are never accepted, px. At the highest useful temperatures their odds are
/// below those of one draw in a plan.
const MAX_LOSS_PX: usize = 64;

/// What one move does at the present temperature.
#[derive(Debug, Clone)]
pub(super) struct MoveOdds {
    /// Steps along one axis, lattice units: quantiles of a normal distribution.
    steps: [i16; STEP_CHOICES],
    /// Entry k: a loss of k px is accepted when 16 random bits are below this.
    acceptance: [u32; MAX_LOSS_PX],
    /// A move is a jump when 16 random bits are below this.
    jump: u32,
}

impl MoveOdds {
    /// Moves of standard deviation `step_px` along each axis at `temperature_px`.
    pub(super) fn new(
        normal: &NormalQuantiles,
        temperature_px: f64,
        step_px: f64,
        jump_share: f64,
    ) -> Self {
        // The pixels of two positions that are less than a step apart may be a step apart.
        let limit_px = MAX_STEP_PX as f64 - 1.0;
        Self {
            steps: normal.0.map(|quantile| {
                let step_px = (quantile * step_px).clamp(-limit_px, limit_px);
                (step_px * f64::from(STEPS_PER_PX)).round() as i16
            }),
            acceptance: std::array::from_fn(|k| {
                ((-(k as f64) / temperature_px).exp() * 65536.0).round() as u32
            }),
            jump: (jump_share * 65536.0).round() as u32,
        }
    }

    #[inline]
    fn accepts(&self, gain_px: i32, bits: u64) -> bool {
        let loss_px = (-gain_px).max(0) as usize;
        loss_px < MAX_LOSS_PX && ((bits & 0xffff) as u32) < self.acceptance[loss_px]
    }
}

/// Evenly spaced quantiles of the standard normal distribution.
#[derive(Debug, Clone)]
pub(super) struct NormalQuantiles([f64; STEP_CHOICES]);

impl NormalQuantiles {
    pub(super) fn new() -> Self {
        Self(std::array::from_fn(|k| normal_quantile((k as f64 + 0.5) / STEP_CHOICES as f64)))
    }
}

/// The value that a standard normal number falls short of with probability `probability`, to about
/// 0.005 (Shore 1982): steps need no more.
fn normal_quantile(probability: f64) -> f64 {
    let upper = probability.max(1.0 - probability);
    let quantile = 5.5556 * (1.0 - ((1.0 - upper) / upper).powf(0.1186));
    quantile.copysign(probability - 0.5)
}

/// A plan under way: pulses, their cover and what they gain.
#[derive(Debug, Clone)]
pub(super) struct Walk<W> {
    pub(super) cover: Cover<W>,
    pub(super) places: Vec<Place>,
    /// Hits − misses, px.
    pub(super) gain_px: i32,
}

impl<W: Window> Walk<W> {
    /// Does `moves` moves of the first `free` pulses, at least one, and offers every plan to `best`.
    pub(super) fn metropolis(
        &mut self,
        moves: u64,
        free: usize,
        odds: &MoveOdds,
        rng: &mut Pcg64Mcg,
        best: &mut BestPlaces,
    ) {
        for _ in 0..moves {
            let bits = rng.next_u64();
            // The high half of this product chooses the pulse, the low half is as good as new.
            let product = (bits >> 32) * free as u64;
            let k = (product >> 32) as usize;
            let place = self.places[k];
            if ((bits & 0xffff) as u32) < odds.jump {
                self.jump(k, odds, rng);
            } else {
                let step = |byte: u64| i32::from(odds.steps[(byte & 0xff) as usize]);
                let to = Place { x: place.x + step(bits >> 16), y: place.y + step(bits >> 24) };
                if to.x < 0 || to.y < 0 || to.x > EDGE || to.y > EDGE {
                    continue;
                }
                let gain_px = self.cover.move_gain_px(place, to);
                if !odds.accepts(gain_px, product >> 16) {
                    continue;
                }
                self.cover.shift(place, to);
                self.places[k] = to;
                self.gain_px += gain_px;
            }
            best.offer(self.gain_px, &self.places);
        }
    }

    /// Tries a pulse anywhere on the workpiece.
    fn jump(&mut self, k: usize, odds: &MoveOdds, rng: &mut Pcg64Mcg) {
        let bits = rng.next_u64();
        let coordinate = |bits: u64| (((bits & 0xff_ffff) * (EDGE as u64 + 1)) >> 24) as i32;
        let to = Place { x: coordinate(bits), y: coordinate(bits >> 24) };
        let place = self.places[k];
        let mut gain_px = self.cover.lift(place, |_, _, _| ());
        gain_px += self.cover.fire(to, |_, _, _| ());
        if odds.accepts(gain_px, bits >> 48) {
            self.places[k] = to;
            self.gain_px += gain_px;
        } else {
            self.cover.lift(to, |_, _, _| ());
            self.cover.fire(place, |_, _, _| ());
        }
    }
}

/// The best pulses of a restart so far.
#[derive(Debug, Clone, Default)]
pub(super) struct BestPlaces {
    pub(super) gain_px: i32,
    pub(super) places: Vec<Place>,
}

impl BestPlaces {
    /// Takes over `places` when they gain more.
    #[inline]
    pub(super) fn offer(&mut self, gain_px: i32, places: &[Place]) {
        if gain_px > self.gain_px {
            self.gain_px = gain_px;
            self.places.clear();
            self.places.extend_from_slice(places);
        }
    }
}
