//! Any bytes as a policy file give a network or an error, and networks run. The bytes are tried as a
//! whole file, and as a manifest over a few sound tensors.
#![no_main]

use std::collections::HashMap;

use lasergym_policy::Network;
use safetensors::tensor::{Dtype, TensorView};

/// Multiplications up to which a network is run.
const RUNNABLE: u64 = 1 << 24;

fn load_and_run(bytes: &[u8]) {
    let Ok(network) = Network::from_bytes(bytes) else { return };
    if network.multiplications() <= RUNNABLE {
        let observation = vec![1.0; network.input().values()];
        let _ = network.act(&observation, &mut network.scratch());
    }
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    load_and_run(bytes);
    let Ok(manifest) = std::str::from_utf8(bytes) else { return };
    let values: Vec<u8> = (0..144).flat_map(|i| (i as f32 * 0.1 - 7.0).to_le_bytes()).collect();
    let shapes: [(&str, &[usize]); 6] = [
        ("conv", &[4, 4, 3, 3]),
        ("thin", &[4, 1, 3, 3]),
        ("head", &[2, 36, 1, 1]),
        ("linear", &[12, 12]),
        ("vector", &[4]),
        ("one", &[1]),
    ];
    let tensors = shapes.map(|(name, shape)| {
        let bytes = &values[..4 * shape.iter().product::<usize>()];
        (name, TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("a sound tensor"))
    });
    let metadata = HashMap::from([("lasergym".to_owned(), manifest.to_owned())]);
    load_and_run(&safetensors::serialize(tensors, Some(metadata)).expect("a sound file"));
});
