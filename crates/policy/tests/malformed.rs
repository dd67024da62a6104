//! Every malformed file is refused by an error that names what is wrong.

#![allow(clippy::expect_used, clippy::panic, reason = "a helper that fails fails its test")]

mod policy_file;

use lasergym_policy::{MAX_LAYERS, Network, PolicyError};
use policy_file::PolicyFile;
use safetensors::tensor::Dtype;
use serde_json::{Value, json};

fn error_of(bytes: &[u8]) -> PolicyError {
    let error = Network::from_bytes(bytes).expect_err("a malformed file");
    assert!(!error.to_string().is_empty());
    error
}

fn error(file: &PolicyFile) -> PolicyError {
    error_of(&file.bytes())
}

/// A linear layer from 2 to 3 values, sound as it is.
fn linear() -> PolicyFile {
    PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w", "bias": "b"})])
        .with("w", &[3, 2], &[1.0; 6])
        .with("b", &[3], &[0.0; 3])
}

/// One operation over 4 × 6 × 6 with the tensor `w` of the given shape.
fn one(operation: Value, shape: &[usize]) -> PolicyFile {
    PolicyFile::new([4, 6, 6], &[operation]).with("w", shape, &vec![0.5; shape.iter().product()])
}

/// A convolution with one setting changed.
fn convolution(key: &str, value: Value) -> PolicyFile {
    let mut operation = json!({"kind": "conv2d", "weight": "w"});
    operation[key] = value;
    one(operation, &[2, 4, 3, 3])
}

fn setting_of(file: &PolicyFile) -> &'static str {
    match error(file) {
        PolicyError::InvalidSetting { name, .. } => name,
        other => panic!("{other}"),
    }
}

#[test]
fn the_files_below_are_sound_but_for_one_thing() {
    assert!(Network::from_bytes(&linear().bytes()).is_ok());
    assert!(Network::from_bytes(&convolution("groups", json!(1)).bytes()).is_ok());
}

#[test]
fn missing_file() {
    let error = Network::load("no/such/policy.safetensors").expect_err("no file");
    assert!(matches!(error, PolicyError::Unreadable { .. }));
}

#[test]
fn empty_file() {
    assert!(matches!(error_of(b""), PolicyError::NotSafetensors { .. }));
}

#[test]
fn not_safetensors() {
    let error = error_of(b"this is the text of a letter, not a file of tensors");
    assert!(matches!(error, PolicyError::NotSafetensors { .. }));
}

#[test]
fn header_longer_than_the_file() {
    let mut bytes = linear().bytes();
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(matches!(error_of(&bytes), PolicyError::NotSafetensors { .. }));
}

#[test]
fn truncated_at_any_byte() {
    let bytes = linear().bytes();
    for length in 0..bytes.len() {
        assert!(matches!(error_of(&bytes[..length]), PolicyError::NotSafetensors { .. }));
    }
}

#[test]
fn no_manifest() {
    assert_eq!(error_of(&linear().bytes_with(None)), PolicyError::NoManifest);
}

#[test]
fn manifest_that_is_not_json() {
    let error = error_of(&linear().bytes_with(Some("format = 1")));
    assert!(matches!(error, PolicyError::BadManifest { .. }));
}

#[test]
fn manifest_of_another_format() {
    let file = linear().with_entry("/format", json!(7));
    assert_eq!(error(&file), PolicyError::UnknownFormat { found: 7, supported: 1 });
}

#[test]
fn manifest_with_an_unknown_key() {
    let file = linear().with_entry("/laser", json!(true));
    assert!(matches!(error(&file), PolicyError::BadManifest { .. }));
}

#[test]
fn manifest_that_is_too_long() {
    let file = linear().with_entry("/training", json!("a".repeat(5 << 20)));
    assert!(matches!(error(&file), PolicyError::ManifestTooLarge { .. }));
}

#[test]
fn manifest_nested_too_deeply() {
    let text = format!("{{\"format\": 1, \"training\": {}", "[".repeat(100_000));
    let error = error_of(&linear().bytes_with(Some(&text)));
    assert!(matches!(error, PolicyError::BadManifest { .. }));
}

#[test]
fn unknown_operation() {
    let file = PolicyFile::new([1, 1, 1], &[json!({"kind": "attention"})]);
    assert!(matches!(error(&file), PolicyError::BadManifest { .. }));
}

#[test]
fn unknown_setting_of_an_operation() {
    assert!(matches!(error(&convolution("speed", json!(1))), PolicyError::BadManifest { .. }));
}

#[test]
fn negative_padding() {
    let file = convolution("padding", json!([-1, 0]));
    assert!(matches!(error(&file), PolicyError::BadManifest { .. }));
}

#[test]
fn no_layers() {
    let file = PolicyFile::new([1, 1, 1], &[]);
    assert!(matches!(error(&file), PolicyError::Count { what: "layers", count: 0, .. }));
}

#[test]
fn too_many_layers() {
    let file = PolicyFile::new([1, 1, 1], &vec![json!({"kind": "relu"}); MAX_LAYERS + 1]);
    assert!(matches!(error(&file), PolicyError::Count { what: "layers", .. }));
}

#[test]
fn too_many_tensors() {
    let mut file = linear();
    for index in 0..5000 {
        file = file.with(&format!("t{index}"), &[1], &[0.0]);
    }
    assert!(matches!(error(&file), PolicyError::Count { what: "tensors", .. }));
}

#[test]
fn two_layers_of_one_name() {
    let layer = json!({"name": "a", "operation": {"kind": "relu"}});
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", json!([layer, layer]));
    assert_eq!(error(&file), PolicyError::DuplicateLayer { layer: "a".to_owned() });
}

#[test]
fn layer_called_input() {
    let layer = json!({"name": "input", "operation": {"kind": "relu"}});
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", json!([layer]));
    assert_eq!(error(&file), PolicyError::DuplicateLayer { layer: "input".to_owned() });
}

#[test]
fn layer_that_reads_a_later_one() {
    let layers = json!([
        {"name": "a", "inputs": ["b"], "operation": {"kind": "relu"}},
        {"name": "b", "operation": {"kind": "relu"}},
    ]);
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", layers);
    let expected = PolicyError::UnknownInput { layer: "a".to_owned(), input: "b".to_owned() };
    assert_eq!(error(&file), expected);
}

#[test]
fn layer_that_reads_itself() {
    let layers = json!([{"name": "a", "inputs": ["a"], "operation": {"kind": "relu"}}]);
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", layers);
    assert!(matches!(error(&file), PolicyError::UnknownInput { .. }));
}

#[test]
fn layer_that_nothing_reads() {
    let layers = json!([
        {"name": "a", "operation": {"kind": "relu"}},
        {"name": "b", "inputs": ["input"], "operation": {"kind": "relu"}},
    ]);
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", layers);
    assert_eq!(error(&file), PolicyError::UnusedLayer { layer: "a".to_owned() });
}

#[test]
fn sum_of_one_input() {
    let file = PolicyFile::new([1, 1, 1], &[json!({"kind": "add"})]);
    assert!(matches!(error(&file), PolicyError::InputCount { found: 1, .. }));
}

#[test]
fn activation_of_two_inputs() {
    let layers =
        json!([{"name": "a", "inputs": ["input", "input"], "operation": {"kind": "relu"}}]);
    let file = PolicyFile::new([1, 1, 1], &[]).with_entry("/layers", layers);
    assert!(matches!(error(&file), PolicyError::InputCount { found: 2, .. }));
}

/// Adds or joins the input (4 × 6 × 6) and its mean (4 × 1 × 1).
fn joined(kind: &str) -> PolicyFile {
    let layers = json!([
        {"name": "mean", "operation": {"kind": "global_average_pool"}},
        {"name": "both", "inputs": ["input", "mean"], "operation": {"kind": kind}},
    ]);
    PolicyFile::new([4, 6, 6], &[]).with_entry("/layers", layers)
}

#[test]
fn sum_of_different_shapes() {
    assert!(matches!(error(&joined("add")), PolicyError::LayerInput { .. }));
}

#[test]
fn concatenation_of_different_sizes() {
    assert!(matches!(error(&joined("concat")), PolicyError::LayerInput { .. }));
}

#[test]
fn missing_tensor() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]);
    let expected =
        PolicyError::MissingTensor { layer: "layer 0".to_owned(), tensor: "w".to_owned() };
    assert_eq!(error(&file), expected);
}

#[test]
fn tensor_of_another_type() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]).with_bytes(
        "w",
        Dtype::F64,
        &[1, 2],
        vec![0; 16],
    );
    assert!(matches!(error(&file), PolicyError::TensorType { .. }));
}

#[test]
fn bytes_without_a_scale() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]).with_bytes(
        "w",
        Dtype::I8,
        &[3, 2],
        vec![1; 6],
    );
    assert!(matches!(error(&file), PolicyError::TensorScale { expected: 3, .. }));
}

#[test]
fn bytes_with_a_scale_of_the_wrong_length() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})])
        .with_bytes("w", Dtype::I8, &[3, 2], vec![1; 6])
        .with("w.scale", &[2], &[1.0, 1.0]);
    assert!(matches!(error(&file), PolicyError::TensorScale { expected: 3, .. }));
}

#[test]
fn scale_that_is_not_finite() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})])
        .with_bytes("w", Dtype::I8, &[3, 2], vec![1; 6])
        .with("w.scale", &[3], &[1.0, f32::INFINITY, 1.0]);
    assert!(matches!(error(&file), PolicyError::WeightNotFinite { index: 2, .. }));
}

#[test]
fn weights_that_are_not_finite() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut weights = [1.0; 6];
        weights[4] = value;
        let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]).with(
            "w",
            &[3, 2],
            &weights,
        );
        assert!(matches!(error(&file), PolicyError::WeightNotFinite { index: 4, .. }));
    }
}

#[test]
fn linear_weights_for_another_input() {
    let file = one(json!({"kind": "linear", "weight": "w"}), &[3, 5]);
    assert!(matches!(error(&file), PolicyError::LayerInput { .. }), "no flatten");
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]).with(
        "w",
        &[3, 5],
        &[1.0; 15],
    );
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn linear_weights_without_outputs() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w"})]).with(
        "w",
        &[0, 2],
        &[],
    );
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn bias_of_the_wrong_length() {
    let file = PolicyFile::new([2, 1, 1], &[json!({"kind": "linear", "weight": "w", "bias": "b"})])
        .with("w", &[3, 2], &[1.0; 6])
        .with("b", &[2], &[0.0; 2]);
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn convolution_weights_with_three_axes() {
    let file = one(json!({"kind": "conv2d", "weight": "w"}), &[2, 4, 3]);
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn convolution_weights_for_other_channels() {
    let file = one(json!({"kind": "conv2d", "weight": "w"}), &[2, 5, 3, 3]);
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn convolution_kernel_without_taps() {
    let file = one(json!({"kind": "conv2d", "weight": "w"}), &[2, 4, 0, 3]);
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn convolution_kernel_larger_than_its_input() {
    let file = one(json!({"kind": "conv2d", "weight": "w"}), &[2, 4, 7, 3]);
    assert!(matches!(error(&file), PolicyError::LayerInput { .. }));
}

#[test]
fn convolution_groups_that_do_not_divide() {
    let file = convolution("groups", json!(3));
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn convolution_without_groups() {
    assert_eq!(setting_of(&convolution("groups", json!(0))), "groups");
}

#[test]
fn convolution_without_stride() {
    assert_eq!(setting_of(&convolution("stride", json!([1, 0]))), "stride");
}

#[test]
fn convolution_without_dilation() {
    assert_eq!(setting_of(&convolution("dilation", json!([0, 1]))), "dilation");
}

#[test]
fn convolution_with_boundless_padding() {
    let file = convolution("padding", json!([u64::MAX, u64::MAX]));
    assert_eq!(setting_of(&file), "padding");
    let file = convolution("padding", json!([4_000_000, 4_000_000]));
    assert!(matches!(error(&file), PolicyError::InvalidSetting { name: "shape", .. }));
    let file = convolution("padding", json!([4000, 4000]));
    assert!(matches!(error(&file), PolicyError::TooLarge { .. }));
}

#[test]
fn convolution_with_boundless_dilation() {
    let file = convolution("dilation", json!([4_000_000, 4_000_000]));
    assert!(matches!(error(&file), PolicyError::LayerInput { .. }));
}

#[test]
fn transposed_convolution_with_padding_beyond_its_output() {
    let operation = json!({"kind": "conv_transpose2d", "weight": "w", "padding": [100, 100]});
    assert_eq!(setting_of(&one(operation, &[4, 2, 3, 3])), "shape");
}

#[test]
fn transposed_convolution_with_output_padding_of_the_stride() {
    let operation = json!({"kind": "conv_transpose2d", "weight": "w", "output_padding": [1, 0]});
    assert_eq!(setting_of(&one(operation, &[4, 2, 3, 3])), "output_padding");
}

#[test]
fn transposed_convolution_with_a_boundless_stride() {
    let operation =
        json!({"kind": "conv_transpose2d", "weight": "w", "stride": [100_000, 100_000]});
    assert!(matches!(error(&one(operation, &[4, 2, 3, 3])), PolicyError::TooLarge { .. }));
}

#[test]
fn pooling_without_a_window() {
    let operation = json!({"kind": "max_pool", "kernel": [0, 2], "stride": [1, 1]});
    assert_eq!(setting_of(&one(operation, &[1])), "kernel");
}

#[test]
fn pooling_without_a_stride() {
    let operation = json!({"kind": "avg_pool", "kernel": [2, 2], "stride": [1, 0]});
    assert_eq!(setting_of(&one(operation, &[1])), "stride");
}

#[test]
fn pooling_with_padding_beyond_half_the_window() {
    let operation =
        json!({"kind": "max_pool", "kernel": [2, 2], "stride": [1, 1], "padding": [2, 0]});
    assert_eq!(setting_of(&one(operation, &[1])), "padding");
}

#[test]
fn pooling_window_larger_than_its_input() {
    let operation = json!({"kind": "max_pool", "kernel": [9, 9], "stride": [1, 1]});
    assert!(matches!(error(&one(operation, &[1])), PolicyError::LayerInput { .. }));
}

#[test]
fn shuffling_by_a_factor_that_does_not_divide() {
    for (kind, factor) in
        [("pixel_shuffle", 0), ("pixel_shuffle", 3), ("pixel_unshuffle", 0), ("pixel_unshuffle", 4)]
    {
        assert_eq!(setting_of(&one(json!({"kind": kind, "factor": factor}), &[1])), "factor");
    }
}

#[test]
fn shuffling_by_a_boundless_factor() {
    for kind in ["pixel_shuffle", "pixel_unshuffle"] {
        assert_eq!(setting_of(&one(json!({"kind": kind, "factor": u64::MAX}), &[1])), "factor");
    }
}

#[test]
fn crop_of_the_whole_input() {
    for cut in [3, usize::MAX] {
        let operation = json!({"kind": "crop", "top": cut, "bottom": 3, "left": 0, "right": 0});
        assert!(matches!(error(&one(operation, &[1])), PolicyError::LayerInput { .. }));
    }
}

#[test]
fn slope_that_is_not_a_float() {
    let file = one(json!({"kind": "leaky_relu", "slope": 1e300}), &[1]);
    assert_eq!(setting_of(&file), "slope");
}

#[test]
fn normalisation_of_the_wrong_length() {
    let operation = json!({"kind": "normalise", "mean": "w", "deviation": "w"});
    assert!(matches!(error(&one(operation, &[5])), PolicyError::TensorShape { .. }));
}

#[test]
fn normalisation_by_a_deviation_of_zero() {
    let operation = json!({"kind": "normalise", "mean": "w", "deviation": "d"});
    let file = one(operation, &[4]).with("d", &[4], &[1.0, 1.0, 0.0, 1.0]);
    assert_eq!(setting_of(&file), "deviation");
}

#[test]
fn empty_input() {
    let file = PolicyFile::new([4, 0, 6], &[json!({"kind": "relu"})]);
    assert_eq!(setting_of(&file), "shape");
}

#[test]
fn boundless_input() {
    let file = PolicyFile::new([1, usize::MAX, usize::MAX], &[json!({"kind": "relu"})]);
    assert_eq!(setting_of(&file), "shape");
    let file = PolicyFile::new([1 << 12, 1 << 12, 1 << 12], &[json!({"kind": "relu"})]);
    assert!(matches!(error(&file), PolicyError::TooLarge { .. }));
}

#[test]
fn too_many_activations() {
    let relus = vec![json!({"kind": "tanh"}); 100];
    let file = PolicyFile::new([1, 1 << 11, 1 << 10], &relus);
    let PolicyError::TooLarge { what, .. } = error(&file) else { panic!("accepted") };
    assert_eq!(what, "values of all activations");
}

#[test]
fn too_many_multiplications() {
    let operation = json!({"kind": "conv2d", "weight": "w", "padding": [32, 32]});
    let file = PolicyFile::new([16, 400, 400], &[operation.clone(), operation]).with(
        "w",
        &[16, 16, 65, 65],
        &vec![0.0; 16 * 16 * 65 * 65],
    );
    let PolicyError::TooLarge { what, .. } = error(&file) else { panic!("accepted") };
    assert_eq!(what, "multiplications of a run");
}

#[test]
fn too_many_weights_through_sharing() {
    let side = 1 << 11;
    let operations = vec![json!({"kind": "linear", "weight": "w"}); 17];
    let file = PolicyFile::new([side, 1, 1], &operations).with(
        "w",
        &[side, side],
        &vec![0.0; side * side],
    );
    let PolicyError::TooLarge { what, .. } = error(&file) else { panic!("accepted") };
    assert_eq!(what, "weights");
}

#[test]
fn observation_divided_by_zero() {
    let file = linear().with_entry("/observation", json!({"name": "", "divide_by": 0.0}));
    assert_eq!(setting_of(&file), "divide_by");
}

/// The linear layer with running normalisation of the observation.
fn normalised(key: &str, value: Value) -> PolicyFile {
    let mut normalise = json!({"mean": "m", "variance": "v", "epsilon": 0.0, "clip": 10.0});
    normalise[key] = value;
    linear()
        .with_entry("/observation", json!({"normalise": normalise}))
        .with("m", &[2], &[0.0, 0.0])
        .with("v", &[2], &[1.0, 1.0])
        .with("negative", &[2], &[1.0, -1.0])
        .with("short", &[1], &[1.0])
}

#[test]
fn observation_normalised_by_a_bad_setting() {
    assert!(Network::from_bytes(&normalised("clip", json!(5.0)).bytes()).is_ok());
    assert_eq!(setting_of(&normalised("clip", json!(0.0))), "clip");
    assert_eq!(setting_of(&normalised("epsilon", json!(-1.0))), "epsilon");
    assert_eq!(setting_of(&normalised("variance", json!("negative"))), "variance");
}

#[test]
fn observation_normalised_by_tensors_of_the_wrong_length() {
    let file = normalised("mean", json!("short"));
    assert!(matches!(error(&file), PolicyError::TensorShape { .. }));
}

#[test]
fn actions_with_too_few_ranges() {
    let actions = json!({"kind": "clip", "low": [-1.0], "high": [1.0, 1.0, 1.0]});
    assert_eq!(setting_of(&linear().with_entry("/actions", actions)), "low");
}

#[test]
fn actions_with_low_above_high() {
    let actions = json!({"kind": "squash", "low": [2.0, 0.0, 0.0], "high": [1.0, 1.0, 1.0]});
    assert_eq!(setting_of(&linear().with_entry("/actions", actions)), "low");
}

#[test]
fn observations_that_do_not_fit() {
    let network = Network::from_bytes(&linear().bytes()).expect("a sound file");
    let mut scratch = network.scratch();
    let run = |values: &[f32]| network.run(values, &mut network.scratch()).map(<[f32]>::to_vec);
    assert_eq!(run(&[1.0]), Err(PolicyError::ObservationLength { found: 1, expected: 2 }));
    assert!(matches!(
        run(&[0.0, f32::NAN]),
        Err(PolicyError::ObservationNotFinite { index: 1, .. })
    ));
    assert!(matches!(
        run(&[f32::NEG_INFINITY, 0.0]),
        Err(PolicyError::ObservationNotFinite { index: 0, .. })
    ));
    assert!(matches!(
        run(&[f32::MAX, f32::MAX]),
        Err(PolicyError::OutputNotFinite { index: 0, .. })
    ));
    assert!(network.run_bytes(&[1, 2], &mut scratch).is_ok());
}
