//! Each layer equals its definition, over random shapes, strides, dilations and paddings, with the
//! instructions of this processor and with portable ones.

#![allow(clippy::expect_used, clippy::panic, reason = "a helper that fails fails its test")]

mod policy_file;
mod reference;

use lasergym_policy::{Instructions, Network};
use policy_file::{PolicyFile, numbers};
use proptest::prelude::*;
use reference::{Geometry, Planes, Pool, convolve, convolve_transposed, pool};
use serde_json::{Value, json};

/// Checks a file against the output expected on `input`.
fn assert_gives(file: &PolicyFile, input: &Planes, expected: &Planes) {
    for instructions in [Instructions::Best, Instructions::Portable] {
        let network =
            Network::with_instructions(&file.bytes(), instructions).expect("a sound file");
        let output = network.output();
        assert_eq!([output.channels, output.height, output.width], expected.shape);
        let observation: Vec<f32> = input.values.iter().map(|&value| value as f32).collect();
        let mut scratch = network.scratch();
        // Twice: nothing of the first run may be left in the buffers.
        for _ in 0..2 {
            let outputs = network.run(&observation, &mut scratch).expect("finite values");
            for (index, (&value, &expected)) in outputs.iter().zip(&expected.values).enumerate() {
                assert!(
                    (f64::from(value) - expected).abs() < 1e-5 * expected.abs().max(1.0),
                    "{instructions:?}, output {index}: {value} instead of {expected}"
                );
            }
        }
    }
}

fn planes(seed: u64, shape: [usize; 3]) -> Planes {
    Planes::new(shape, &numbers(seed, shape.iter().product()))
}

fn pair(range: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = [usize; 2]> {
    [range.clone(), range]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn convolution_equals_its_definition(
        seed in any::<u64>(),
        (groups, group_inputs, group_outputs) in (1_usize..=3, 1_usize..=9, 1_usize..=40),
        kernel in pair(1..=4),
        stride in pair(1..=3),
        padding in pair(0..=4),
        dilation in pair(1..=4),
        extra in pair(0..=12),
        with_bias in any::<bool>(),
        rectified in any::<bool>(),
    ) {
        let side = |axis: usize| {
            (dilation[axis] * (kernel[axis] - 1) + 1 + extra[axis])
                .saturating_sub(2 * padding[axis])
                .max(1)
        };
        let input = planes(seed, [groups * group_inputs, side(0), side(1)]);
        let shape = [groups * group_outputs, group_inputs, kernel[0], kernel[1]];
        let weights = numbers(seed ^ 1, shape.iter().product());
        let bias = numbers(seed ^ 2, shape[0]);
        let mut operation = json!({
            "kind": "conv2d", "weight": "weight", "stride": stride, "padding": padding,
            "dilation": dilation, "groups": groups,
        });
        if with_bias {
            operation["bias"] = json!("bias");
        }
        let operations = [operation, json!({"kind": "relu"})];
        let file = PolicyFile::new(input.shape, &operations[..=usize::from(rectified)])
            .with("weight", &shape, &weights)
            .with("bias", &shape[..1], &bias);
        let geometry = Geometry { stride, padding, dilation, groups };
        let bias = with_bias.then_some(bias.as_slice());
        let mut expected = convolve(&input, &weights, shape, bias, geometry);
        if rectified {
            expected.values.iter_mut().for_each(|value| *value = value.max(0.0));
        }
        assert_gives(&file, &input, &expected);
    }

    #[test]
    fn transposed_convolution_equals_its_definition(
        seed in any::<u64>(),
        (inputs, outputs) in (1_usize..=6, 1_usize..=20),
        kernel in pair(1..=4),
        stride in pair(1..=3),
        dilation in pair(1..=3),
        padding in pair(0..=3),
        output_padding in pair(0..=2),
        sides in pair(2..=6),
    ) {
        let output_padding = [0, 1].map(|axis| output_padding[axis] % stride[axis]);
        let padding = [0, 1].map(|axis| {
            let full = (sides[axis] - 1) * stride[axis] + dilation[axis] * (kernel[axis] - 1);
            padding[axis].min(full / 2)
        });
        let input = planes(seed, [inputs, sides[0], sides[1]]);
        let shape = [inputs, outputs, kernel[0], kernel[1]];
        let weights = numbers(seed ^ 1, shape.iter().product());
        let bias = numbers(seed ^ 2, outputs);
        let operation = json!({
            "kind": "conv_transpose2d", "weight": "weight", "bias": "bias", "stride": stride,
            "padding": padding, "output_padding": output_padding, "dilation": dilation,
        });
        let file = PolicyFile::new(input.shape, &[operation])
            .with("weight", &shape, &weights)
            .with("bias", &[outputs], &bias);
        let geometry = Geometry { stride, padding, dilation, groups: 1 };
        let expected =
            convolve_transposed(&input, &weights, shape, &bias, geometry, output_padding);
        assert_gives(&file, &input, &expected);
    }

    #[test]
    fn linear_equals_its_definition(
        seed in any::<u64>(),
        inputs in 1_usize..=200,
        outputs in 1_usize..=150,
    ) {
        let input = planes(seed, [inputs, 1, 1]);
        let weights = numbers(seed ^ 1, inputs * outputs);
        let bias = numbers(seed ^ 2, outputs);
        let operation = json!({"kind": "linear", "weight": "weight", "bias": "bias"});
        let file = PolicyFile::new(input.shape, &[operation])
            .with("weight", &[outputs, inputs], &weights)
            .with("bias", &[outputs], &bias);
        let plain = Geometry { stride: [1, 1], padding: [0, 0], dilation: [1, 1], groups: 1 };
        let shape = [outputs, inputs, 1, 1];
        assert_gives(&file, &input, &convolve(&input, &weights, shape, Some(&bias), plain));
    }

    #[test]
    fn pooling_equals_its_definition(
        seed in any::<u64>(),
        channels in 1_usize..=20,
        kernel in pair(1..=4),
        stride in pair(1..=3),
        padding in pair(0..=2),
        extra in pair(0..=6),
        kind in prop::sample::select(vec![Pool::Greatest, Pool::Mean, Pool::MeanWithPadding]),
    ) {
        let padding = [0, 1].map(|axis| padding[axis].min(kernel[axis] / 2));
        let input = planes(seed, [channels, kernel[0] + extra[0], kernel[1] + extra[1]]);
        let operation = match kind {
            Pool::Greatest => json!({
                "kind": "max_pool", "kernel": kernel, "stride": stride, "padding": padding,
            }),
            _ => json!({
                "kind": "avg_pool", "kernel": kernel, "stride": stride, "padding": padding,
                "count_padding": kind == Pool::MeanWithPadding,
            }),
        };
        let file = PolicyFile::new(input.shape, &[operation]);
        assert_gives(&file, &input, &pool(&input, kind, kernel, stride, padding));
    }

    #[test]
    fn global_average_equals_its_definition(
        seed in any::<u64>(),
        shape in [1_usize..=20, 1..=9, 1..=9],
    ) {
        let input = planes(seed, shape);
        let file = PolicyFile::new(shape, &[json!({"kind": "global_average_pool"})]);
        let window = [shape[1], shape[2]];
        assert_gives(&file, &input, &pool(&input, Pool::Mean, window, [1, 1], [0, 0]));
    }

    #[test]
    fn shuffling_moves_channels_to_pixels_and_back(
        seed in any::<u64>(),
        shape in [1_usize..=5, 1..=6, 1..=6],
        factor in 1_usize..=3,
    ) {
        let [channels, height, width] = shape;
        let large = [channels, height * factor, width * factor];
        let small = [channels * factor * factor, height, width];
        let input = planes(seed, large);
        // torch.nn.PixelUnshuffle: channel c·f² + i·f + j at (y, x) is channel c at (y·f + i, x·f + j).
        let expected = Planes::from_fn(small, |channel, y, x| {
            let (part, source) = (channel % (factor * factor), channel / (factor * factor));
            let row = y * factor + part / factor;
            let column = x * factor + part % factor;
            input.values[(source * large[1] + row) * large[2] + column]
        });
        let unshuffle = json!({"kind": "pixel_unshuffle", "factor": factor});
        let shuffle = json!({"kind": "pixel_shuffle", "factor": factor});
        assert_gives(&PolicyFile::new(large, std::slice::from_ref(&unshuffle)), &input, &expected);
        assert_gives(&PolicyFile::new(small, std::slice::from_ref(&shuffle)), &expected, &input);
        assert_gives(&PolicyFile::new(large, &[unshuffle, shuffle]), &input, &input);
    }

    #[test]
    fn flatten_keeps_the_order_of_channels_rows_and_columns(
        seed in any::<u64>(),
        shape in [1_usize..=9, 1..=6, 1..=6],
    ) {
        let input = planes(seed, shape);
        let expected = Planes { shape: [input.values.len(), 1, 1], values: input.values.clone() };
        assert_gives(&PolicyFile::new(shape, &[json!({"kind": "flatten"})]), &input, &expected);
    }

    #[test]
    fn crop_cuts_the_border_off(
        seed in any::<u64>(),
        shape in [1_usize..=5, 1..=6, 1..=6],
        cut in [0_usize..=2, 0..=2, 0..=2, 0..=2],
    ) {
        let [channels, height, width] = shape;
        let [top, bottom, left, right] = cut;
        let input = planes(seed, [channels, height + top + bottom, width + left + right]);
        let expected = Planes::from_fn(shape, |channel, y, x| {
            input.values[(channel * input.shape[1] + y + top) * input.shape[2] + x + left]
        });
        let operation =
            json!({"kind": "crop", "top": top, "bottom": bottom, "left": left, "right": right});
        assert_gives(&PolicyFile::new(input.shape, &[operation]), &input, &expected);
    }

    #[test]
    fn normalisation_takes_one_value_a_channel_or_one_a_value(
        seed in any::<u64>(),
        shape in [1_usize..=9, 1..=5, 1..=5],
        each in any::<bool>(),
    ) {
        let input = planes(seed, shape);
        let tensor_shape = if each { shape.to_vec() } else { vec![shape[0]] };
        let count = tensor_shape.iter().product();
        let mean = numbers(seed ^ 1, count);
        let deviation: Vec<f32> = numbers(seed ^ 2, count).iter().map(|x| x + 1.5).collect();
        let expected = Planes::from_fn(shape, |channel, y, x| {
            let index = (channel * shape[1] + y) * shape[2] + x;
            let place = if each { index } else { channel };
            (input.values[index] - f64::from(mean[place])) / f64::from(deviation[place])
        });
        let operation = json!({"kind": "normalise", "mean": "mean", "deviation": "deviation"});
        let file = PolicyFile::new(shape, &[operation])
            .with("mean", &tensor_shape, &mean)
            .with("deviation", &tensor_shape, &deviation);
        assert_gives(&file, &input, &expected);
    }

    #[test]
    fn sums_and_concatenations_read_any_earlier_layer(
        seed in any::<u64>(),
        shape in [1_usize..=9, 1..=5, 1..=5],
    ) {
        let input = planes(seed, shape);
        let layers = json!([
            {"name": "a", "operation": {"kind": "tanh"}},
            {"name": "b", "inputs": ["input"], "operation": {"kind": "leaky_relu", "slope": 0.5}},
            {"name": "sum", "inputs": ["b", "a", "input"], "operation": {"kind": "add"}},
            {"name": "double", "inputs": ["sum", "sum"], "operation": {"kind": "add"}},
            {"name": "all", "inputs": ["a", "double", "b"], "operation": {"kind": "concat"}},
        ]);
        let file = PolicyFile::new(shape, &[]).with_entry("/layers", layers);
        let tanh: Vec<f64> = input.values.iter().map(|x| x.tanh()).collect();
        let leaky: Vec<f64> =
            input.values.iter().map(|&x| if x < 0.0 { 0.5 * x } else { x }).collect();
        let double =
            (0..tanh.len()).map(|i| 2.0 * (tanh[i] + leaky[i] + input.values[i]));
        let values = tanh.iter().copied().chain(double).chain(leaky.iter().copied()).collect();
        let expected = Planes { shape: [3 * shape[0], shape[1], shape[2]], values };
        assert_gives(&file, &input, &expected);
    }

    #[test]
    fn observations_are_normalised_clipped_and_divided(
        seed in any::<u64>(),
        shape in [1_usize..=4, 1..=5, 1..=5],
    ) {
        let count = shape.iter().product();
        let input = planes(seed, shape);
        let mean = numbers(seed ^ 1, count);
        let variance: Vec<f32> = numbers(seed ^ 2, count).iter().map(|x| 0.3 * (x + 1.0)).collect();
        let expected = Planes {
            shape,
            values: (0..count)
                .map(|i| {
                    let deviation = (f64::from(variance[i]) + 1e-2).sqrt();
                    ((input.values[i] - f64::from(mean[i])) / deviation).clamp(-1.5, 1.5) / 0.5
                })
                .collect(),
        };
        let observation = json!({
            "name": "layers",
            "divide_by": 0.5,
            "normalise": {"mean": "m", "variance": "v", "epsilon": 0.01, "clip": 1.5},
        });
        let identity = json!({"kind": "crop", "top": 0, "bottom": 0, "left": 0, "right": 0});
        let file = PolicyFile::new(shape, &[identity])
            .with_entry("/observation", observation)
            .with("m", &[count], &mean)
            .with("v", &[count], &variance);
        assert_gives(&file, &input, &expected);
    }
}

#[test]
fn bytes_and_floats_give_the_same() {
    let file = PolicyFile::new([2, 3, 5], &[json!({"kind": "flatten"})])
        .with_entry("/observation", json!({"name": "layers", "divide_by": 255.0}));
    let network = Network::from_bytes(&file.bytes()).expect("a sound file");
    let bytes: Vec<u8> = (0..30).map(|index| index * 8).collect();
    let floats: Vec<f32> = bytes.iter().map(|&byte| f32::from(byte)).collect();
    let (mut one, mut other) = (network.scratch(), network.scratch());
    let expected: Vec<f32> = floats.iter().map(|value| value / 255.0).collect();
    assert_eq!(network.run_bytes(&bytes, &mut one).expect("bytes are finite"), expected);
    assert_eq!(network.run(&floats, &mut other).expect("finite values"), expected);
}

#[test]
fn actions_are_clipped_or_squashed_into_their_range() {
    let outputs = [-3.0_f32, -0.5, 0.2, 4.0];
    let (low, high) = ([-1.0_f32, -1.0, 0.0, -2.0], [1.0_f32, 0.0, 1.0, 5.0]);
    let act = |actions: Value| {
        let file = PolicyFile::new([4, 1, 1], &[json!({"kind": "flatten"})])
            .with_entry("/actions", actions);
        let network = Network::from_bytes(&file.bytes()).expect("a sound file");
        let mut scratch = network.scratch();
        network.act(&outputs, &mut scratch).expect("finite values").to_vec()
    };
    assert_eq!(act(json!({"kind": "identity"})), outputs);
    assert_eq!(act(json!({"kind": "clip", "low": low, "high": high})), [-1.0, -0.5, 0.2, 4.0]);
    for (index, value) in
        act(json!({"kind": "squash", "low": low, "high": high})).into_iter().enumerate()
    {
        let share = 0.5 * (outputs[index].tanh() + 1.0);
        let expected = low[index] + share * (high[index] - low[index]);
        assert!((value - expected).abs() < 1e-6);
    }
}

#[test]
fn shorter_types_are_read_as_floats() {
    use half::{bf16, f16};
    use safetensors::tensor::Dtype;

    let weights = [0.5_f32, -1.25, 2.0, 0.75, -0.5, 1.0];
    let operation = json!({"kind": "linear", "weight": "weight"});
    let file = PolicyFile::new([3, 1, 1], &[operation]);
    let halves: Vec<u8> = weights.iter().flat_map(|&x| f16::from_f32(x).to_le_bytes()).collect();
    let brains: Vec<u8> = weights.iter().flat_map(|&x| bf16::from_f32(x).to_le_bytes()).collect();
    let bytes: Vec<u8> = [2_i8, -5, 8, 3, -2, 4].iter().map(|&x| x.cast_unsigned()).collect();
    let files = [
        file.clone().with("weight", &[2, 3], &weights),
        file.clone().with_bytes("weight", Dtype::F16, &[2, 3], halves),
        file.clone().with_bytes("weight", Dtype::BF16, &[2, 3], brains),
        file.with_bytes("weight", Dtype::I8, &[2, 3], bytes).with(
            "weight.scale",
            &[2],
            &[0.25, 0.25],
        ),
    ];
    for file in files {
        let network = Network::from_bytes(&file.bytes()).expect("a sound file");
        let mut scratch = network.scratch();
        let outputs = network.run(&[1.0, 10.0, 100.0], &mut scratch).expect("finite values");
        assert_eq!(outputs, [188.0, 95.75]);
    }
}
