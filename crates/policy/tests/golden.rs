//! Networks exported from torch give what torch gives; `tests/golden/policy/write.py` writes them.

#![allow(clippy::expect_used, clippy::panic, reason = "a helper that fails fails its test")]

use std::fs;
use std::path::Path;

use lasergym_policy::{Instructions, Network};
use safetensors::SafeTensors;

/// Largest difference that counts as equal; the outputs are of the order of 1.
const TOLERANCE: f32 = 1e-5;

fn floats(file: &SafeTensors<'_>, name: &str) -> Vec<f32> {
    let view = file.tensor(name).expect("a tensor of the cases");
    view.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

/// Runs the network of one family of layers on its 16 observations.
fn assert_equals_torch(family: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/policy");
    let cases =
        fs::read(folder.join(format!("{family}.cases.safetensors"))).expect("a golden file");
    let cases = SafeTensors::deserialize(&cases).expect("a golden file");
    let (observations, outputs) = (floats(&cases, "observations"), floats(&cases, "outputs"));
    let bytes = fs::read(folder.join(format!("{family}.safetensors"))).expect("a golden file");
    for instructions in [Instructions::Best, Instructions::Portable] {
        let network = Network::with_instructions(&bytes, instructions).expect("a golden network");
        let mut scratch = network.scratch();
        let observations = observations.chunks_exact(network.input().values());
        let expected = outputs.chunks_exact(network.output().values());
        assert_eq!((observations.len(), expected.len()), (16, 16));
        for (observation, expected) in observations.zip(expected) {
            let actual = network.run(observation, &mut scratch).expect("finite values");
            for (value, expected) in actual.iter().zip(expected) {
                assert!((value - expected).abs() < TOLERANCE, "{value} instead of {expected}");
            }
            let bytes: Vec<u8> = observation.iter().map(|&value| value as u8).collect();
            let actual = actual.to_vec();
            assert_eq!(network.run_bytes(&bytes, &mut scratch).expect("bytes"), actual);
        }
    }
}

#[test]
fn convolutions_equal_torch() {
    assert_equals_torch("convolution");
}

#[test]
fn transposed_convolutions_equal_torch() {
    assert_equals_torch("transposed");
}

#[test]
fn linear_layers_equal_torch() {
    assert_equals_torch("linear");
}

#[test]
fn activations_equal_torch() {
    assert_equals_torch("activations");
}

#[test]
fn pooling_equals_torch() {
    assert_equals_torch("pooling");
}

#[test]
fn shuffling_equals_torch() {
    assert_equals_torch("shuffle");
}

#[test]
fn residual_sums_and_concatenations_equal_torch() {
    assert_equals_torch("residual");
}

#[test]
fn normalisation_equals_torch() {
    assert_equals_torch("normalise");
}

#[test]
fn half_precision_weights_equal_torch() {
    assert_equals_torch("float16");
}

#[test]
fn brain_float_weights_equal_torch() {
    assert_equals_torch("bfloat16");
}

#[test]
fn byte_weights_equal_torch() {
    assert_equals_torch("int8");
}
