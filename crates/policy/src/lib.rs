//! Runs trained policies.

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
