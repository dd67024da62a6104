//! Policy files made in memory.

#![allow(dead_code, reason = "each test file uses a part")]

use std::collections::HashMap;

use safetensors::tensor::{Dtype, TensorView};
use serde_json::{Value, json};

/// A policy file before it is written.
#[derive(Clone)]
pub(crate) struct PolicyFile {
    pub(crate) manifest: Value,
    pub(crate) tensors: Vec<(String, Dtype, Vec<usize>, Vec<u8>)>,
}

impl PolicyFile {
    /// A file with layers, each an operation over the one before it.
    pub(crate) fn new(input: [usize; 3], operations: &[Value]) -> Self {
        let layers: Vec<Value> = operations
            .iter()
            .enumerate()
            .map(|(index, operation)| json!({"name": format!("layer {index}"), "operation": operation}))
            .collect();
        let [channels, height, width] = input;
        let manifest = json!({
            "format": 1,
            "input": {"channels": channels, "height": height, "width": width},
            "layers": layers,
        });
        Self { manifest, tensors: Vec::new() }
    }

    /// With an F32 tensor.
    pub(crate) fn with(mut self, name: &str, shape: &[usize], values: &[f32]) -> Self {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.tensors.push((name.to_owned(), Dtype::F32, shape.to_vec(), bytes));
        self
    }

    /// With a tensor of any type.
    pub(crate) fn with_bytes(
        mut self,
        name: &str,
        dtype: Dtype,
        shape: &[usize],
        bytes: Vec<u8>,
    ) -> Self {
        self.tensors.push((name.to_owned(), dtype, shape.to_vec(), bytes));
        self
    }

    /// With an entry of the manifest replaced.
    pub(crate) fn with_entry(mut self, pointer: &str, value: Value) -> Self {
        let (parent, key) = pointer.rsplit_once('/').expect("a JSON pointer");
        let parent = self.manifest.pointer_mut(parent).expect("an entry of the manifest");
        parent.as_object_mut().expect("an object").insert(key.to_owned(), value);
        self
    }

    /// The bytes of the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.bytes_with(Some(&self.manifest.to_string()))
    }

    /// The bytes with any manifest, or none.
    pub(crate) fn bytes_with(&self, manifest: Option<&str>) -> Vec<u8> {
        let views = self.tensors.iter().map(|(name, dtype, shape, bytes)| {
            (name.clone(), TensorView::new(*dtype, shape.clone(), bytes).expect("a sound tensor"))
        });
        let metadata =
            manifest.map(|text| HashMap::from([("lasergym".to_owned(), text.to_owned())]));
        safetensors::serialize(views, metadata).expect("a sound file")
    }
}

/// Numbers in [−1, 1) that look random, the same for the same seed.
pub(crate) fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}
