//! What a policy file says about itself: the JSON under the key `lasergym` of its metadata.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::PolicyError;
use crate::limits::{MAX_LAYERS, MAX_MANIFEST_BYTES};
use crate::operation::Operation;
use crate::shape::Shape;

/// Format of the manifest that this version reads.
pub const FORMAT: u32 = 1;

/// Key of the manifest in the metadata of the safetensors file.
pub const MANIFEST_KEY: &str = "lasergym";

/// Name by which layers read the input of the network.
pub const INPUT_NAME: &str = "input";

/// Everything that a policy file says besides its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the format, [`FORMAT`].
    pub format: u32,
    /// Shape of the observation that the network reads.
    pub input: Shape,
    /// The layers in the order in which they run. The last one gives the output.
    pub layers: Vec<Layer>,
    /// How an observation becomes the input of the first layer.
    #[serde(default)]
    pub observation: Observation,
    /// How the output becomes an action.
    #[serde(default)]
    pub actions: ActionMapping,
    /// How the caller turns the output into a decision, for instance `{"kind": "direct"}`. The
    /// runner does not read it.
    #[serde(default)]
    pub decision: Value,
    /// Id and arguments of the environment that the policy was trained in. Not read.
    #[serde(default)]
    pub environment: Value,
    /// Versions of the software that wrote the file. Not read.
    #[serde(default)]
    pub versions: Value,
    /// Summary of the training. Not read.
    #[serde(default)]
    pub training: Value,
}

/// One layer of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// A name of its own, by which later layers read its result.
    pub name: String,
    /// Names of what it reads: earlier layers or [`INPUT_NAME`]. Empty stands for the layer just
    /// before, or the input of the network for the first layer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// What it does.
    pub operation: Operation,
}

/// How an observation becomes the input of the first layer: it is normalised where
/// `normalise` is given, then divided by `divide_by`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Observation {
    /// Name of the kind of observation, for instance `layers`. Not read.
    #[serde(default)]
    pub name: String,
    /// Divisor, finite and not 0: 255 for images of bytes.
    #[serde(default = "one")]
    pub divide_by: f32,
    /// Running normalisation as `VecNormalize` of Stable-Baselines3 does it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalise: Option<RunningNormalisation>,
}

impl Default for Observation {
    fn default() -> Self {
        Self { name: String::new(), divide_by: 1.0, normalise: None }
    }
}

/// clip((x − mean) / √(variance + epsilon), −clip, clip), value by value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunningNormalisation {
    /// Name of the tensor of means, one a value of the observation.
    pub mean: String,
    /// Name of the tensor of variances, one a value of the observation.
    pub variance: String,
    /// Added to the variance, at least 0.
    pub epsilon: f64,
    /// Largest magnitude of the result, above 0.
    pub clip: f32,
}

/// How the output of the network becomes an action.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum ActionMapping {
    /// The output is the action.
    #[default]
    Identity,
    /// The output, clipped to the range of the actions.
    Clip {
        /// Least value of each action.
        low: Vec<f32>,
        /// Greatest value of each action.
        high: Vec<f32>,
    },
    /// low + (tanh(output) + 1) / 2 × (high − low).
    Squash {
        /// Least value of each action.
        low: Vec<f32>,
        /// Greatest value of each action.
        high: Vec<f32>,
    },
}

fn one() -> f32 {
    1.0
}

impl Manifest {
    /// Reads a manifest from JSON.
    ///
    /// # Errors
    /// [`PolicyError`] when the text is too long, is not such a manifest, has another format or
    /// has no layer or too many.
    pub fn from_json(text: &str) -> Result<Self, PolicyError> {
        if text.len() > MAX_MANIFEST_BYTES {
            return Err(PolicyError::ManifestTooLarge {
                bytes: text.len(),
                limit: MAX_MANIFEST_BYTES,
            });
        }
        let bad = |error: serde_json::Error| PolicyError::BadManifest { reason: error.to_string() };
        let format: FormatOnly = serde_json::from_str(text).map_err(bad)?;
        if format.format != FORMAT {
            return Err(PolicyError::UnknownFormat { found: format.format, supported: FORMAT });
        }
        let manifest: Self = serde_json::from_str(text).map_err(bad)?;
        let count = manifest.layers.len();
        if count == 0 || count > MAX_LAYERS {
            return Err(PolicyError::Count { what: "layers", count, limit: MAX_LAYERS });
        }
        Ok(manifest)
    }
}

/// The part of a manifest that every format has.
#[derive(Deserialize)]
struct FormatOnly {
    format: u32,
}
