//! A policy for tests, whose network gives a constant.

use lasergym_policy::Network;

use super::policy_agent::PolicyAgent;
use crate::PlanError;

/// A policy file of one layer over the mean of each channel, with weights of 0 and the given bias.
pub(super) fn file(channels: usize, size: usize, bias: &[f32], decision: &str) -> Vec<u8> {
    let outputs = bias.len();
    let manifest = format!(
        r#"{{"format": 1,
             "input": {{"channels": {channels}, "height": {size}, "width": {size}}},
             "layers": [
                 {{"name": "mean", "operation": {{"kind": "global_average_pool"}}}},
                 {{"name": "head", "operation": {{"kind": "linear", "weight": "w", "bias": "b"}}}}
             ],
             "decision": {decision}}}"#
    );
    let weights_len = 4 * outputs * channels;
    let header = serde_json::json!({
        "__metadata__": {"lasergym": manifest},
        "w": {"dtype": "F32", "shape": [outputs, channels], "data_offsets": [0, weights_len]},
        "b": {
            "dtype": "F32",
            "shape": [outputs],
            "data_offsets": [weights_len, weights_len + 4 * outputs],
        },
    })
    .to_string();
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.resize(bytes.len() + weights_len, 0);
    bytes.extend(bias.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// The spatial policy that corrects nothing: greedy with ring score.
pub(crate) fn spatial() -> PolicyAgent {
    let decision = r#"{"kind": "spatial", "ring_weight": 0.35, "polish_px": 0.5}"#;
    made(18, 28, &[0.0; 289], decision).unwrap()
}

/// The policy of [`file`].
pub(super) fn made(
    channels: usize,
    size: usize,
    bias: &[f32],
    decision: &str,
) -> Result<PolicyAgent, PlanError> {
    PolicyAgent::new(Network::from_bytes(&file(channels, size, bias, decision))?)
}
