//! Smooth random surfaces, as targets of episodes.

use lasergym_batch::Stream;

/// Waves that are added up.
const WAVES: usize = 6;

/// Wavelengths, as parts of the side: from the first to the second.
const WAVELENGTHS: (f64, f64) = (0.4, 1.5);

/// A square surface of `side` × `side` depths from 0 to `depth_um`, row by row: the sum of six plane
/// waves of random direction, phase and wavelength (0.4 to 1.5 sides), the longer the higher.
pub fn random_relief(stream: &mut Stream, side: usize, depth_um: f64) -> Vec<f64> {
    let mut heights = vec![0.0; side * side];
    let turn = std::f64::consts::TAU;
    for _ in 0..WAVES {
        let (shortest, longest) = WAVELENGTHS;
        let wavelength = shortest + (longest - shortest) * stream.uniform();
        let (sine, cosine) = (turn * stream.uniform()).sin_cos();
        let phase = turn * stream.uniform();
        let per_px = turn / (wavelength * side as f64);
        // cos(a + b) = cos a cos b − sin a sin b: one cosine a row and a column, not one a pixel.
        let columns: Vec<(f64, f64)> =
            (0..side).map(|column| (per_px * cosine * column as f64).sin_cos()).collect();
        for (row, heights) in heights.chunks_exact_mut(side).enumerate() {
            let (row_sine, row_cosine) = (per_px * sine * row as f64 + phase).sin_cos();
            for (height, (sine, cosine)) in heights.iter_mut().zip(&columns) {
                *height += wavelength * (cosine * row_cosine - sine * row_sine);
            }
        }
    }
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let per_height = if high > low { depth_um / (high - low) } else { 0.0 };
    for height in &mut heights {
        *height = ((*height - low) * per_height).clamp(0.0, depth_um);
    }
    heights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reliefs_are_smooth_and_span_the_depth() {
        let mut stream = Stream::from_seed(4);
        for _ in 0..50 {
            let relief = random_relief(&mut stream, 60, 20.0);
            let low = relief.iter().copied().fold(f64::INFINITY, f64::min);
            let high = relief.iter().copied().fold(0.0, f64::max);
            assert!(low.abs() < 1e-12 && (high - 20.0).abs() < 1e-9);
            // The shortest wave, 24 px long, could rise by 2π/24 of half the depth from pixel to pixel.
            for row in relief.chunks_exact(60) {
                assert!(row.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 20.0 * 0.14));
            }
        }
    }

    #[test]
    fn a_seed_is_a_relief() {
        let of = |seed| random_relief(&mut Stream::from_seed(seed), 20, 3.0);
        assert_eq!(of(7), of(7));
        assert_ne!(of(7), of(8));
    }
}
