//! Re-placement: lift a pulse and put it back where it gains most, on pixel centres.

use lasergym_geom::WORKPIECE_SIZE_PX;
use rand::Rng;
use rand_pcg::Pcg64Mcg;

use crate::GainMap;

use super::lattice::Place;
use super::metropolis::{BestPlaces, Walk};
use super::window::Window;

/// Part of the re-placements that look about the old place only.
const LOCAL_SHARE: f64 = 0.7;

/// Pixels on either side of the old place that a local re-placement looks at.
const LOCAL_REACH: usize = 3;

/// Draws of Gumbel noise: the place of largest gain + noise is then drawn with odds that fall
/// exponentially with what it gains less.
const GUMBELS: usize = 256;

/// Noise for one choice at one temperature, in 1/64 px.
#[derive(Debug, Clone)]
pub(super) struct GumbelNoise {
    quantiles: [i32; GUMBELS],
}

impl GumbelNoise {
    const SCALE: f64 = 64.0;

    pub(super) fn new(temperature_px: f64) -> Self {
        let quantiles = std::array::from_fn(|k| {
            let probability = (k as f64 + 0.5) / GUMBELS as f64;
            (-(-probability.ln()).ln() * temperature_px * Self::SCALE).round() as i32
        });
        Self { quantiles }
    }

    /// The index of the largest gain + noise.
    #[inline]
    fn choose(&self, gains_px: impl Iterator<Item = i32>, rng: &mut Pcg64Mcg) -> usize {
        let mut best = (i32::MIN, 0);
        let mut bits = 0;
        for (k, gain_px) in gains_px.enumerate() {
            if k % 8 == 0 {
                bits = rng.next_u64();
            }
            let noisy = gain_px * Self::SCALE as i32 + self.quantiles[(bits & 0xff) as usize];
            bits >>= 8;
            if noisy > best.0 {
                best = (noisy, k);
            }
        }
        best.1
    }
}

/// Does `count` re-placements; `gains` belongs to the cover of `walk`.
pub(super) fn replace_pulses<W: Window>(
    walk: &mut Walk<W>,
    gains: &mut GainMap,
    count: u64,
    noise: &GumbelNoise,
    rng: &mut Pcg64Mcg,
    best: &mut BestPlaces,
) {
    for _ in 0..count {
        let bits = rng.next_u64();
        let k = (((bits >> 32) * walk.places.len() as u64) >> 32) as usize;
        let old = walk.places[k];
        walk.gain_px += walk.cover.lift(old, |row, hits, misses| gains.restored(row, hits, misses));
        let local = ((bits & 0xffff) as f64) < LOCAL_SHARE * 65536.0;
        let new = if local { near(gains, old, noise, rng) } else { anywhere(gains, noise, rng) };
        walk.gain_px += walk.cover.fire(new, |row, hits, misses| gains.machined(row, hits, misses));
        walk.places[k] = new;
        best.offer(walk.gain_px, &walk.places);
    }
}

/// A good pixel centre about `old`.
fn near(gains: &GainMap, old: Place, noise: &GumbelNoise, rng: &mut Pcg64Mcg) -> Place {
    let around = |pixel: usize| {
        let first = pixel.saturating_sub(LOCAL_REACH);
        first..(pixel + LOCAL_REACH + 1).min(WORKPIECE_SIZE_PX)
    };
    let (row, column) = old.pixel();
    let (rows, columns) = (around(row), around(column));
    let width = columns.len();
    let nearby = rows
        .clone()
        .flat_map(|row| gains.row(row)[columns.clone()].iter().map(|&gain_px| i32::from(gain_px)));
    let choice = noise.choose(nearby, rng);
    Place::pixel_center(rows.start + choice / width, columns.start + choice % width)
}

/// A good pixel centre anywhere: first the row by its best place, then the place in it.
fn anywhere(gains: &GainMap, noise: &GumbelNoise, rng: &mut Pcg64Mcg) -> Place {
    let row_best =
        |row| gains.row(row).iter().fold(i16::MIN, |best: i16, &gain_px| best.max(gain_px));
    let row = noise.choose((0..WORKPIECE_SIZE_PX).map(|row| i32::from(row_best(row))), rng);
    let column = noise.choose(gains.row(row).iter().map(|&gain_px| i32::from(gain_px)), rng);
    Place::pixel_center(row, column)
}
