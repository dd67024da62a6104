//! Tensors of a safetensors file as f32.

use half::{bf16, f16};
use safetensors::{Dtype, SafeTensors};

use crate::PolicyError;
use crate::limits::{MAX_PARAMETERS, MAX_TENSORS};

/// The tensors of one file.
pub(crate) struct Tensors<'a> {
    file: SafeTensors<'a>,
}

/// One tensor, all values finite.
pub(crate) struct Tensor {
    /// Name in the file.
    pub(crate) name: String,
    /// Lengths of its axes.
    pub(crate) shape: Vec<usize>,
    /// Values, last axis fastest.
    pub(crate) values: Vec<f32>,
}

impl Tensor {
    /// The error that says which shape is expected.
    pub(crate) fn shape_error(&self, layer: &str, expected: impl Into<String>) -> PolicyError {
        PolicyError::TensorShape {
            layer: layer.to_owned(),
            tensor: self.name.clone(),
            found: self.shape.clone(),
            expected: expected.into(),
        }
    }
}

impl<'a> Tensors<'a> {
    /// Takes the tensors of a file.
    pub(crate) fn new(file: SafeTensors<'a>) -> Result<Self, PolicyError> {
        if file.len() > MAX_TENSORS {
            return Err(PolicyError::Count {
                what: "tensors",
                count: file.len(),
                limit: MAX_TENSORS,
            });
        }
        Ok(Self { file })
    }

    /// Reads the tensor `name` for `layer`; I8 values are scaled along `output_axis`.
    pub(crate) fn read(
        &self,
        layer: &str,
        name: &str,
        output_axis: usize,
    ) -> Result<Tensor, PolicyError> {
        let view = self.file.tensor(name).map_err(|_| PolicyError::MissingTensor {
            layer: layer.to_owned(),
            tensor: name.to_owned(),
        })?;
        let shape = view.shape().to_vec();
        let count = shape.iter().fold(1_u64, |n, &side| n.saturating_mul(side as u64));
        if count > MAX_PARAMETERS {
            return Err(PolicyError::TooLarge {
                layer: layer.to_owned(),
                what: "weights",
                value: count,
                limit: MAX_PARAMETERS,
            });
        }
        let data = view.data();
        let values: Vec<f32> = match view.dtype() {
            Dtype::F32 => data.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
            Dtype::F16 => {
                data.as_chunks::<2>().0.iter().map(|&b| f16::from_le_bytes(b).to_f32()).collect()
            }
            Dtype::BF16 => {
                data.as_chunks::<2>().0.iter().map(|&b| bf16::from_le_bytes(b).to_f32()).collect()
            }
            Dtype::I8 => self.scaled(name, data, &shape, output_axis)?,
            other => {
                return Err(PolicyError::TensorType {
                    tensor: name.to_owned(),
                    found: format!("{other:?}"),
                });
            }
        };
        if let Some((index, &value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(PolicyError::WeightNotFinite { tensor: name.to_owned(), index, value });
        }
        Ok(Tensor { name: name.to_owned(), shape, values })
    }

    /// I8 values times the scale of their output channel.
    fn scaled(
        &self,
        name: &str,
        data: &[u8],
        shape: &[usize],
        output_axis: usize,
    ) -> Result<Vec<f32>, PolicyError> {
        let channels = shape.get(output_axis).copied().unwrap_or(0);
        let error = || PolicyError::TensorScale { tensor: name.to_owned(), expected: channels };
        let view = self.file.tensor(&format!("{name}.scale")).map_err(|_| error())?;
        if view.dtype() != Dtype::F32 || view.shape() != [channels] || channels == 0 {
            return Err(error());
        }
        let scales: Vec<f32> =
            view.data().as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        let inner = shape[output_axis + 1..].iter().product::<usize>().max(1);
        let values = data
            .iter()
            .enumerate()
            .map(|(index, &byte)| f32::from(byte.cast_signed()) * scales[index / inner % channels]);
        Ok(values.collect())
    }
}
