//! Runs allocate nothing.

#![allow(clippy::expect_used, clippy::panic, reason = "a helper that fails fails its test")]

mod policy_file;

use lasergym_policy::{Instructions, Network};
use policy_file::{PolicyFile, numbers};
use serde_json::json;

/// Every kind of layer in one network.
fn network(instructions: Instructions) -> Network {
    let layers = json!([
        {"name": "unshuffle", "operation": {"kind": "pixel_unshuffle", "factor": 2}},
        {"name": "convolve", "operation": {
            "kind": "conv2d", "weight": "a", "padding": [2, 2], "dilation": [2, 2], "groups": 2,
        }},
        {"name": "relu", "operation": {"kind": "relu"}},
        {"name": "silu", "inputs": ["unshuffle"], "operation": {"kind": "silu"}},
        {"name": "add", "inputs": ["relu", "silu"], "operation": {"kind": "add"}},
        {"name": "concat", "inputs": ["add", "relu"], "operation": {"kind": "concat"}},
        {"name": "normalise", "operation": {"kind": "normalise", "mean": "m", "deviation": "d"}},
        {"name": "pool", "operation": {"kind": "max_pool", "kernel": [2, 2], "stride": [2, 2]}},
        {"name": "spread", "operation": {
            "kind": "conv_transpose2d", "weight": "b", "stride": [2, 2],
        }},
        {"name": "crop", "operation": {"kind": "crop", "top": 1, "bottom": 0, "left": 0, "right": 1}},
        {"name": "shuffle", "operation": {"kind": "pixel_shuffle", "factor": 2}},
        {"name": "gelu", "operation": {"kind": "gelu"}},
        {"name": "flatten", "operation": {"kind": "flatten"}},
        {"name": "linear", "operation": {"kind": "linear", "weight": "c"}},
    ]);
    let file = PolicyFile::new([2, 8, 8], &[])
        .with_entry("/layers", layers)
        .with_entry("/actions", json!({"kind": "clip", "low": [-1, -1], "high": [1, 1]}))
        .with("a", &[8, 4, 3, 3], &numbers(1, 288))
        .with("b", &[16, 4, 2, 2], &numbers(2, 256))
        .with("c", &[2, 36], &numbers(3, 72))
        .with("m", &[16], &[0.1; 16])
        .with("d", &[16], &[2.0; 16]);
    Network::with_instructions(&file.bytes(), instructions).expect("a sound file")
}

#[test]
fn runs_allocate_nothing() {
    for instructions in [Instructions::Best, Instructions::Portable] {
        let network = network(instructions);
        let floats = numbers(4, network.input().values());
        let bytes = vec![7_u8; network.input().values()];
        let mut scratch = network.scratch();
        let allocations = allocation_counter::measure(|| {
            for _ in 0..3 {
                network.run(&floats, &mut scratch).expect("finite values");
                network.act(&floats, &mut scratch).expect("finite values");
                network.act_bytes(&bytes, &mut scratch).expect("finite values");
            }
        });
        assert_eq!(allocations.count_total, 0);
    }
}

#[test]
fn scratch_of_another_network_grows_once() {
    let network = network(Instructions::Best);
    let floats = numbers(4, network.input().values());
    let mut scratch = lasergym_policy::Scratch::default();
    let first = network.run(&floats, &mut scratch).expect("finite values").to_vec();
    let allocations = allocation_counter::measure(|| {
        let again = network.run(&floats, &mut scratch).expect("finite values");
        assert_eq!(first, again);
    });
    assert_eq!(allocations.count_total, 0);
}
