//! What can go wrong with a policy file or a run.

use crate::shape::Shape;

/// Every error of the network runner.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyError {
    /// The file cannot be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// Path of the file.
        path: String,
        /// What the system said.
        reason: String,
    },
    /// The file is too large.
    #[error("the policy file has {bytes} bytes, but at most {limit} are read")]
    FileTooLarge {
        /// Size of the file, bytes.
        bytes: u64,
        /// Largest that is read, bytes.
        limit: usize,
    },
    /// The bytes are not a safetensors file.
    #[error("this is not a safetensors file ({reason}): export the policy again")]
    NotSafetensors {
        /// What the reader said.
        reason: String,
    },
    /// A safetensors file without the manifest of a policy.
    #[error(
        "the file has no `lasergym` entry in its metadata: write it with lasergym.export, other safetensors files do not say their layers"
    )]
    NoManifest,
    /// The manifest is too large.
    #[error("the manifest has {bytes} bytes, but at most {limit} are read")]
    ManifestTooLarge {
        /// Size of the manifest, bytes.
        bytes: usize,
        /// Largest that is read, bytes.
        limit: usize,
    },
    /// The manifest is not what this version reads.
    #[error("the manifest cannot be read ({reason}): export the policy again")]
    BadManifest {
        /// What the reader said, with line and column.
        reason: String,
    },
    /// A format that this version does not know.
    #[error("the file has format {found}, this version reads {supported}: update lasergym")]
    UnknownFormat {
        /// Format of the file.
        found: u32,
        /// Format that is read.
        supported: u32,
    },
    /// Too many tensors or layers, or none.
    #[error("the network has {count} {what}, but must have 1 to {limit}")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// Most that are accepted.
        limit: usize,
    },
    /// Two layers share a name, or one is called `input`.
    #[error("the name {layer:?} is taken twice: give each layer a name of its own, not `input`")]
    DuplicateLayer {
        /// The name.
        layer: String,
    },
    /// A layer reads from something that does not come before it.
    #[error("layer {layer:?} reads {input:?}, but no layer before it has that name")]
    UnknownInput {
        /// Name of the layer.
        layer: String,
        /// The name it reads.
        input: String,
    },
    /// A layer has the wrong number of inputs.
    #[error("layer {layer:?} has {found} inputs, but needs {expected}")]
    InputCount {
        /// Name of the layer.
        layer: String,
        /// Inputs given.
        found: usize,
        /// Inputs needed.
        expected: &'static str,
    },
    /// The result of a layer is never used.
    #[error("layer {layer:?} is read by no other layer and is not the last: leave it out")]
    UnusedLayer {
        /// Name of the layer.
        layer: String,
    },
    /// A tensor that a layer names is not in the file.
    #[error("layer {layer:?} needs the tensor {tensor:?}, which is not in the file")]
    MissingTensor {
        /// Name of the layer.
        layer: String,
        /// Name of the tensor.
        tensor: String,
    },
    /// A tensor type that is not read.
    #[error("tensor {tensor:?} has type {found}: store it as F32, F16, BF16 or I8 with a scale")]
    TensorType {
        /// Name of the tensor.
        tensor: String,
        /// Its type.
        found: String,
    },
    /// An I8 tensor without a fitting scale.
    #[error(
        "tensor {tensor:?} is stored as I8, so {tensor}.scale must be an F32 tensor with {expected} values, one an output channel"
    )]
    TensorScale {
        /// Name of the tensor.
        tensor: String,
        /// Values that the scale must have.
        expected: usize,
    },
    /// A tensor of the wrong shape.
    #[error("tensor {tensor:?} of layer {layer:?} has shape {found:?}, but must be {expected}")]
    TensorShape {
        /// Name of the layer.
        layer: String,
        /// Name of the tensor.
        tensor: String,
        /// Its shape.
        found: Vec<usize>,
        /// What is accepted.
        expected: String,
    },
    /// A weight that is not a number or infinite.
    #[error("tensor {tensor:?} has {value} at index {index}: every weight must be finite")]
    WeightNotFinite {
        /// Name of the tensor.
        tensor: String,
        /// Index of the value.
        index: usize,
        /// The value.
        value: f32,
    },
    /// A setting of a layer, the observation or the actions lies outside its range.
    #[error("{name} of {owner:?} is {value}, but must be {expected}")]
    InvalidSetting {
        /// The layer, `observation` or `actions`.
        owner: String,
        /// Name of the setting.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is accepted.
        expected: String,
    },
    /// The input of a layer has the wrong shape.
    #[error("layer {layer:?} gets an input of {found}, but needs {expected}")]
    LayerInput {
        /// Name of the layer.
        layer: String,
        /// Shape of its input.
        found: Shape,
        /// What is accepted.
        expected: String,
    },
    /// A network that needs too much memory or time.
    #[error("layer {layer:?} brings the {what} to {value}, but at most {limit} are accepted")]
    TooLarge {
        /// Name of the layer.
        layer: String,
        /// What there is too much of.
        what: &'static str,
        /// How much there is.
        value: u64,
        /// Most that is accepted.
        limit: u64,
    },
    /// An observation of the wrong length.
    #[error("the observation has {found} values, but the network reads {expected}")]
    ObservationLength {
        /// Values given.
        found: usize,
        /// Values needed: channels × height × width.
        expected: usize,
    },
    /// An observation that is not a number or infinite.
    #[error("the observation has {value} at index {index}: every value must be finite")]
    ObservationNotFinite {
        /// Index of the value.
        index: usize,
        /// The value.
        value: f32,
    },
    /// The weights of the network overflow on this observation.
    #[error(
        "the network gives {value} at output {index}: its weights overflow on this observation"
    )]
    OutputNotFinite {
        /// Index of the output.
        index: usize,
        /// The value.
        value: f32,
    },
}
