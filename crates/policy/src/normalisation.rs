//! (x − mean) / deviation by stored means and deviations.

use crate::PolicyError;
use crate::shape::Shape;
use crate::tensors::Tensor;

/// A normalisation, its values in the order of the activation or one a channel.
#[derive(Debug)]
pub(crate) struct Normalisation {
    mean: Vec<f32>,
    factor: Vec<f32>,
}

impl Normalisation {
    /// A normalisation of `input` for `layer`.
    pub(crate) fn new(
        layer: &str,
        input: Shape,
        mean: Tensor,
        deviation: Tensor,
    ) -> Result<Self, PolicyError> {
        let Shape { channels, height, width } = input;
        for tensor in [&mean, &deviation] {
            if tensor.shape != [channels] && tensor.shape != [channels, height, width] {
                let expected = format!("({channels}) or ({channels}, {height}, {width})");
                return Err(tensor.shape_error(layer, expected));
            }
        }
        if mean.shape != deviation.shape {
            return Err(deviation.shape_error(layer, format!("{:?}, as its mean", mean.shape)));
        }
        let mut factor = deviation.values;
        for value in &mut factor {
            let inverse = 1.0 / *value;
            if !inverse.is_finite() {
                return Err(PolicyError::InvalidSetting {
                    owner: layer.to_owned(),
                    name: "deviation",
                    value: value.to_string(),
                    expected: "different from 0 and not so small that its inverse overflows"
                        .to_owned(),
                });
            }
            *value = inverse;
        }
        let one_a_value = mean.shape.len() == 3;
        let order = |values: Vec<f32>| if one_a_value { by_pixels(input, &values) } else { values };
        Ok(Self { mean: order(mean.values), factor: order(factor) })
    }

    /// Means and deviations.
    pub(crate) fn parameters(&self) -> u64 {
        (self.mean.len() + self.factor.len()) as u64
    }

    /// Normalises in place.
    pub(crate) fn run(&self, values: &mut [f32]) {
        for part in values.chunks_exact_mut(self.mean.len()) {
            for ((value, mean), factor) in part.iter_mut().zip(&self.mean).zip(&self.factor) {
                *value = (*value - mean) * factor;
            }
        }
    }
}

/// Values in the order pixel by pixel from the order channel by channel.
fn by_pixels(shape: Shape, planes: &[f32]) -> Vec<f32> {
    let pixels = shape.pixels();
    (0..pixels)
        .flat_map(|pixel| (0..shape.channels).map(move |channel| channel * pixels + pixel))
        .map(|index| planes[index])
        .collect()
}
