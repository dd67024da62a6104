//! Random ground: texture at several scales.

use lasergym_ablation::Stream;

/// Sizes of the texture's features, µm, each with its share of the variance.
const OCTAVES: [(f64, f32); 3] = [(0.8, 0.3), (2.5, 0.4), (8.0, 0.3)];

/// A texture of mean 0 and variance 1, `width` × `height` px, row by row.
pub(super) fn texture(
    stream: &mut Stream,
    width: usize,
    height: usize,
    scale_frame_px_per_um: f64,
) -> Vec<f32> {
    let mut texture = vec![0.0; width * height];
    for (feature_um, share) in OCTAVES {
        let cell_px = (feature_um * scale_frame_px_per_um).max(1.0);
        add_value_noise(stream, &mut texture, width, cell_px as f32, share.sqrt());
    }
    texture
}

/// Adds normals on a lattice of `cell_px`, with smooth steps between them.
fn add_value_noise(
    stream: &mut Stream,
    texture: &mut [f32],
    width: usize,
    cell_px: f32,
    deviation: f32,
) {
    let height = texture.len() / width;
    let cells = |length: usize| (length as f32 / cell_px) as usize + 2;
    let (columns, rows) = (cells(width), cells(height));
    let lattice: Vec<f32> = (0..columns * rows).map(|_| stream.normal() as f32).collect();
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    // Between lattice points the variance of the mean of two is smaller: 13/35 + 13/35 on average
    // along each axis.
    let deviation = deviation / (26.0 / 35.0);
    let steps: Vec<(usize, f32)> = (0..width)
        .map(|i| {
            let x = i as f32 / cell_px;
            (x as usize, smooth(x.fract()))
        })
        .collect();
    let mut between = vec![0.0; columns];
    for (j, row) in texture.chunks_exact_mut(width).enumerate() {
        let y = j as f32 / cell_px;
        let (first, weight) = (y as usize * columns, smooth(y.fract()));
        let (upper, lower) = (&lattice[first..], &lattice[first + columns..]);
        for ((value, upper), lower) in between.iter_mut().zip(upper).zip(lower) {
            *value = deviation * (upper + weight * (lower - upper));
        }
        for (value, &(column, weight)) in row.iter_mut().zip(&steps) {
            let (left, right) = (between[column], between[column + 1]);
            *value += left + weight * (right - left);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_has_variance_one() {
        let texture = texture(&mut Stream::from_seed(1), 1000, 1000, 4.0);
        let variance = texture.iter().map(|value| value * value).sum::<f32>() / 1e6;
        assert!((variance - 1.0).abs() < 0.1, "{variance}");
    }
}
