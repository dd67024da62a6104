//! The random stream of one environment.

use lasergym_geom::Point;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// A reproducible random stream: PCG XSL RR 128/64, the same bits on every machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stream {
    generator: Pcg64,
}

impl Stream {
    /// The stream of `seed`.
    #[must_use]
    pub fn from_seed(seed: u64) -> Self {
        Self { generator: Pcg64::seed_from_u64(seed) }
    }

    /// A number uniform in [0, 1) with 53 random bits.
    pub fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Two integers uniform in `0..n` from one draw: the high and the low half of 64 bits, each
    /// scaled by multiplication. The bias is below n / 2³².
    pub fn integer_pair_below(&mut self, n: u32) -> [u32; 2] {
        let bits = self.generator.next_u64();
        [bits >> 32, bits & 0xffff_ffff].map(|half| ((half * u64::from(n)) >> 32) as u32)
    }

    /// A standard normal number.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.generator)
    }

    /// A displacement whose x and y are independent normals of standard deviation `deviation_px`.
    pub fn displacement(&mut self, deviation_px: f64) -> Point {
        let (x, y) = (self.normal(), self.normal());
        Point::new(x, y) * deviation_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_and_integers_cover_their_range_evenly() {
        let mut stream = Stream::from_seed(1);
        let mut counts = [0_u32; 100];
        let mut sum = 0.0;
        for _ in 0..100_000 {
            for k in stream.integer_pair_below(100) {
                counts[k as usize] += 1;
            }
            let u = stream.uniform();
            assert!((0.0..1.0).contains(&u));
            sum += u;
        }
        // Five standard deviations of the binomial and of the mean.
        assert!(counts.iter().all(|&n| n.abs_diff(2000) < 5 * 45), "{counts:?}");
        assert!((sum / 1e5 - 0.5).abs() < 5.0 / (12e5_f64).sqrt());
    }
}
