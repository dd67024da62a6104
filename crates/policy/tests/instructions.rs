//! Portable instructions and the best ones give the same on whole networks, run after run.

#![allow(clippy::expect_used, clippy::panic, reason = "a helper that fails fails its test")]

mod policy_file;

use lasergym_policy::{Instructions, Network};
use policy_file::{PolicyFile, numbers};
use serde_json::{Value, json};

/// Weights of variance 1 / inputs, so that activations neither grow nor fade.
fn weights(seed: u64, shape: &[usize]) -> Vec<f32> {
    let inputs: usize = shape[1..].iter().product();
    let scale = (3.0 / inputs as f32).sqrt();
    numbers(seed, shape.iter().product()).into_iter().map(|x| x * scale).collect()
}

/// `NatureCNN` with its head, on 1 × 100 × 100.
fn nature() -> PolicyFile {
    let conv = |name: &str, stride: usize| json!({"kind": "conv2d", "weight": name, "stride": [stride, stride]});
    let relu = || json!({"kind": "relu"});
    let operations: [Value; 10] = [
        conv("a", 4),
        relu(),
        conv("b", 2),
        relu(),
        conv("c", 1),
        relu(),
        json!({"kind": "flatten"}),
        json!({"kind": "linear", "weight": "d"}),
        relu(),
        json!({"kind": "linear", "weight": "e"}),
    ];
    PolicyFile::new([1, 100, 100], &operations)
        .with("a", &[32, 1, 8, 8], &weights(1, &[32, 1, 8, 8]))
        .with("b", &[64, 32, 4, 4], &weights(2, &[64, 32, 4, 4]))
        .with("c", &[64, 64, 3, 3], &weights(3, &[64, 64, 3, 3]))
        .with("d", &[512, 5184], &weights(4, &[512, 5184]))
        .with("e", &[2, 512], &weights(5, &[2, 512]))
}

/// Dilated convolutions over a crop, halved in size and back.
fn crop() -> PolicyFile {
    let mut operations = vec![json!({"kind": "pixel_unshuffle", "factor": 2})];
    let mut file = PolicyFile::new([6, 56, 56], &[]);
    for (index, dilation) in [1, 1, 2, 4].into_iter().enumerate() {
        let name = format!("w{index}");
        operations.push(json!({
            "kind": "conv2d", "weight": name, "padding": [dilation, dilation],
            "dilation": [dilation, dilation],
        }));
        operations.push(json!({"kind": "silu"}));
        file = file.with(&name, &[24, 24, 3, 3], &weights(index as u64, &[24, 24, 3, 3]));
    }
    operations.push(json!({"kind": "conv2d", "weight": "head"}));
    operations.push(json!({"kind": "pixel_shuffle", "factor": 2}));
    let layers = PolicyFile::new([6, 56, 56], &operations).manifest["layers"].clone();
    file.with("head", &[4, 24, 1, 1], &weights(9, &[4, 24, 1, 1])).with_entry("/layers", layers)
}

#[test]
fn portable_and_best_instructions_agree() {
    for file in [nature(), crop()] {
        let bytes = file.bytes();
        let best = Network::with_instructions(&bytes, Instructions::Best).expect("a sound file");
        let portable =
            Network::with_instructions(&bytes, Instructions::Portable).expect("a sound file");
        let (mut one, mut other) = (best.scratch(), portable.scratch());
        for seed in 0..4 {
            let observation = numbers(seed, best.input().values());
            let outputs = best.run(&observation, &mut one).expect("finite values");
            let expected = portable.run(&observation, &mut other).expect("finite values");
            for (value, expected) in outputs.iter().zip(expected) {
                assert!((value - expected).abs() < 1e-5, "{value} instead of {expected}");
            }
        }
    }
}

#[test]
fn reruns_give_the_same_bits() {
    let network = Network::from_bytes(&crop().bytes()).expect("a sound file");
    let mut scratch = network.scratch();
    let observation = numbers(1, network.input().values());
    let first = network.run(&observation, &mut scratch).expect("finite values").to_vec();
    let noise = numbers(2, network.input().values());
    network.run(&noise, &mut scratch).expect("finite values");
    assert_eq!(network.run(&observation, &mut scratch).expect("finite values"), first);
    let mut fresh = network.scratch();
    assert_eq!(network.run(&observation, &mut fresh).expect("finite values"), first);
}

#[test]
fn threads_share_a_network() {
    let network = Network::from_bytes(&crop().bytes()).expect("a sound file");
    let observation = numbers(1, network.input().values());
    let run = || network.run(&observation, &mut network.scratch()).expect("finite").to_vec();
    let expected = run();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..2).map(|_| scope.spawn(run)).collect();
        for thread in threads {
            assert_eq!(thread.join().expect("no panic"), expected);
        }
    });
}
