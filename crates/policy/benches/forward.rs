//! One run of typical networks on one thread.

use std::collections::HashMap;

use criterion::{Criterion, criterion_group, criterion_main};
use lasergym_policy::{Instructions, Network};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::{Value, json};

/// A network in memory: shape of the input, operations, and shapes of the weights by name.
struct Example {
    input: [usize; 3],
    operations: Vec<Value>,
    weights: Vec<(String, Vec<usize>)>,
}

impl Example {
    fn new(input: [usize; 3]) -> Self {
        Self { input, operations: Vec::new(), weights: Vec::new() }
    }

    /// With an operation without weights.
    fn then(mut self, operation: Value) -> Self {
        self.operations.push(operation);
        self
    }

    /// With an operation that has weights of the given shape.
    fn weighted(mut self, mut operation: Value, shape: &[usize]) -> Self {
        let name = format!("weight {}", self.weights.len());
        operation["weight"] = json!(name);
        self.weights.push((name, shape.to_vec()));
        self.then(operation)
    }

    fn network(&self, instructions: Instructions) -> Option<Network> {
        let layers: Vec<Value> = self
            .operations
            .iter()
            .enumerate()
            .map(|(index, operation)| json!({"name": index.to_string(), "operation": operation}))
            .collect();
        let [channels, height, width] = self.input;
        let manifest = json!({
            "format": 1,
            "input": {"channels": channels, "height": height, "width": width},
            "layers": layers,
        });
        let tensors: Vec<(&str, Vec<usize>, Vec<u8>)> = self
            .weights
            .iter()
            .map(|(name, shape)| {
                let values = (0..shape.iter().product()).map(|i: usize| (i % 7) as f32 * 1e-3);
                (name.as_str(), shape.clone(), values.flat_map(f32::to_le_bytes).collect())
            })
            .collect();
        let views = tensors.iter().filter_map(|(name, shape, bytes)| {
            Some((*name, TensorView::new(Dtype::F32, shape.clone(), bytes).ok()?))
        });
        let metadata = HashMap::from([("lasergym".to_owned(), manifest.to_string())]);
        let bytes = safetensors::serialize(views, Some(metadata)).ok()?;
        Network::with_instructions(&bytes, instructions).ok()
    }
}

/// `NatureCNN` of Stable-Baselines3 with a head of two actions.
fn nature() -> Example {
    let conv = |stride: usize| json!({"kind": "conv2d", "stride": [stride, stride]});
    let relu = json!({"kind": "relu"});
    Example::new([1, 100, 100])
        .weighted(conv(4), &[32, 1, 8, 8])
        .then(relu.clone())
        .weighted(conv(2), &[64, 32, 4, 4])
        .then(relu.clone())
        .weighted(conv(1), &[64, 64, 3, 3])
        .then(relu.clone())
        .then(json!({"kind": "flatten"}))
        .weighted(json!({"kind": "linear"}), &[512, 5184])
        .then(relu)
        .weighted(json!({"kind": "linear"}), &[2, 512])
}

/// Four convolutions of growing dilation over a crop of 56 × 56 pixels.
fn crop(channels: usize, activation: &str) -> Example {
    let mut inputs = 12;
    let mut example =
        Example::new([3, 56, 56]).then(json!({"kind": "pixel_unshuffle", "factor": 2}));
    for dilation in [1, 1, 2, 4] {
        let pair = [dilation, dilation];
        let operation = json!({"kind": "conv2d", "padding": pair, "dilation": pair});
        example = example
            .weighted(operation, &[channels, inputs, 3, 3])
            .then(json!({"kind": activation}));
        inputs = channels;
    }
    example.weighted(json!({"kind": "conv2d"}), &[1, channels, 1, 1])
}

fn forward(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("forward");
    let examples = [
        ("nature", nature()),
        ("crop of 24 channels, silu", crop(24, "silu")),
        ("crop of 32 channels, relu", crop(32, "relu")),
    ];
    for (name, example) in examples {
        for instructions in [Instructions::Best, Instructions::Portable] {
            let Some(network) = example.network(instructions) else { continue };
            let mut scratch = network.scratch();
            let observation = vec![0.5; network.input().values()];
            group.bench_function(format!("{name}, {instructions:?}"), |bencher| {
                bencher.iter(|| network.run(&observation, &mut scratch).map(|outputs| outputs[0]));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, forward);
criterion_main!(benches);
