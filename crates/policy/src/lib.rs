//! Runs trained policies from files: no Python, no ONNX, no unsafe code.
//!
//! A policy file is a [safetensors](https://github.com/huggingface/safetensors) file whose metadata
//! holds a JSON [`Manifest`] under the key [`MANIFEST_KEY`]: the shape of the observation, the
//! layers in order with the names of their tensors, the scaling of the observation, and how outputs
//! become actions. `lasergym.export` in Python writes such files.
//!
//! [`Network::load`] checks a file completely, whoever wrote it: its size, the shape at every layer,
//! every weight, and the memory and time that a run takes. Weights are laid out for the vector
//! instructions of the processor ([`Instructions`]). [`Network::run`] then takes one observation and
//! allocates nothing.
//!
//! ```
//! use std::collections::HashMap;
//!
//! use lasergym_policy::Network;
//! use safetensors::tensor::{Dtype, TensorView};
//!
//! // A policy of one linear layer: twice the first value, minus the second.
//! let manifest = r#"{
//!     "format": 1,
//!     "input": {"channels": 2, "height": 1, "width": 1},
//!     "layers": [{"name": "head", "operation": {"kind": "linear", "weight": "head.weight"}}],
//!     "actions": {"kind": "clip", "low": [-1.0], "high": [1.0]}
//! }"#;
//! let weights: Vec<u8> = [2.0_f32, -1.0].iter().flat_map(|w| w.to_le_bytes()).collect();
//! let weights = TensorView::new(Dtype::F32, vec![1, 2], &weights)?;
//! let metadata = HashMap::from([("lasergym".to_owned(), manifest.to_owned())]);
//! let file = safetensors::serialize([("head.weight", weights)], Some(metadata))?;
//!
//! let network = Network::from_bytes(&file)?;
//! let mut scratch = network.scratch();
//! assert_eq!(network.run(&[1.0, 0.5], &mut scratch)?, [1.5]);
//! assert_eq!(network.act(&[1.0, 0.5], &mut scratch)?, [1.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Sources: layers mean what they mean in [PyTorch](https://docs.pytorch.org/docs/stable/nn.html);
//! running normalisation is that of `VecNormalize` of Stable-Baselines3 (Raffin et al. 2021, JMLR
//! 22:268); the exponential is that of Cephes (Moshier 1992), the error function 7.1.26 of
//! Abramowitz and Stegun (1964).

mod action;
mod activation;
mod convolution;
mod error;
mod instructions;
mod limits;
mod manifest;
mod network;
mod normalisation;
mod observation;
mod operation;
mod padding;
mod pooling;
mod program;
mod rearrangement;
mod scratch;
mod shape;
mod step;
mod tensors;
mod tile_kernel;

pub use error::PolicyError;
pub use instructions::Instructions;
pub use limits::{
    MAX_ACTIVATION_VALUES, MAX_DIMENSION, MAX_FILE_BYTES, MAX_LAYERS, MAX_MANIFEST_BYTES,
    MAX_MULTIPLICATIONS, MAX_NETWORK_VALUES, MAX_PARAMETERS, MAX_TENSORS,
};
pub use manifest::{
    ActionMapping, FORMAT, INPUT_NAME, Layer, MANIFEST_KEY, Manifest, Observation,
    RunningNormalisation,
};
pub use network::Network;
pub use operation::{GeluApproximation, Operation};
pub use scratch::Scratch;
pub use shape::Shape;
