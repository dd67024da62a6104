//! The kernel under convolutions and linear layers: tiles of pixels × output channels whose sums
//! stay in registers.
//!
//! Activations lie pixel by pixel, channels next to one another. For a tile of pixels and a block
//! of output channels, every tap loads one vector row of weights, shared by all pixels, and one
//! value of each pixel, shared by all channels.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]
#![allow(
    clippy::needless_range_loop,
    reason = "constant bounds let the loops unroll into registers"
)]

use pulp::{Simd, bytemuck};

use crate::instructions::{Kernel, broadcast, multiply_add};

/// Weights that are loaded together, at an address from which every processor loads at full speed.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(32))]
pub(crate) struct Line(pub(crate) [f32; LINE]);

/// Weights in a [`Line`].
pub(crate) const LINE: usize = 8;

/// What one pass over all output pixels and channels of one group reads.
#[derive(Clone, Copy)]
pub(crate) struct TilePass<'a> {
    /// The padded input.
    pub(crate) input: &'a [f32],
    /// Where the window of each output pixel begins in the input.
    pub(crate) pixel_starts: &'a [usize],
    /// Where each run of consecutive taps begins, from the beginning of the window.
    pub(crate) run_starts: &'a [usize],
    /// Taps in a run, at least 1.
    pub(crate) run_length: usize,
    /// Weights: blocks × taps × lines of a block, filled up with zeros.
    pub(crate) weights: &'a [Line],
    /// Bias: blocks × channels of a block.
    pub(crate) bias: &'a [f32],
    /// Vectors in a block.
    pub(crate) block_vectors: usize,
    /// Results are raised to at least this: 0 for `ReLU`, −∞ otherwise.
    pub(crate) least: f32,
    /// Channels of the output, those of other groups included.
    pub(crate) output_channels: usize,
    /// First channel that this pass writes.
    pub(crate) first_channel: usize,
    /// Channels that this pass writes.
    pub(crate) channels: usize,
}

/// A pass and where it writes: output pixels × output channels.
pub(crate) struct TileKernel<'a> {
    /// What to do.
    pub(crate) pass: TilePass<'a>,
    /// Where to write.
    pub(crate) output: &'a mut [f32],
}

impl Kernel for TileKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, simd: S) {
        let Self { pass, output } = self;
        // V vectors a block, R lines a row of weights, P pixels a tile: constants, so that sums, one
        // row of weights and one value fill the registers, 16 of them or 32 of the longest.
        match (S::F32_LANES, pass.block_vectors) {
            (4 | 8, 1) => blocks::<S, FUSED, 1, 1, 12>(simd, pass, output),
            (4, 2) => blocks::<S, FUSED, 2, 1, 6>(simd, pass, output),
            (4, 3) => blocks::<S, FUSED, 3, 2, 3>(simd, pass, output),
            (4, 4) => blocks::<S, FUSED, 4, 2, 2>(simd, pass, output),
            (4, _) => blocks::<S, FUSED, 8, 4, 1>(simd, pass, output),
            (8, 2) => blocks::<S, FUSED, 2, 2, 6>(simd, pass, output),
            (8, 3) => blocks::<S, FUSED, 3, 3, 3>(simd, pass, output),
            (8, 4) => blocks::<S, FUSED, 4, 4, 2>(simd, pass, output),
            (8, _) => blocks::<S, FUSED, 8, 8, 1>(simd, pass, output),
            (_, 1) => blocks::<S, FUSED, 1, 2, 14>(simd, pass, output),
            (_, 2) => blocks::<S, FUSED, 2, 4, 12>(simd, pass, output),
            (_, 3) => blocks::<S, FUSED, 3, 6, 8>(simd, pass, output),
            (_, 4) => blocks::<S, FUSED, 4, 8, 6>(simd, pass, output),
            (_, _) => blocks::<S, FUSED, 8, 16, 1>(simd, pass, output),
        }
    }
}

/// All blocks of V vectors of output channels, each over all pixels in tiles of P.
#[inline(always)]
fn blocks<S: Simd, const FUSED: bool, const V: usize, const R: usize, const P: usize>(
    simd: S,
    pass: TilePass<'_>,
    output: &mut [f32],
) {
    let width = V * S::F32_LANES;
    let taps = pass.run_starts.len() * pass.run_length;
    let pixels = pass.pixel_starts.len();
    let weight_blocks = pass.weights.as_chunks::<R>().0.chunks_exact(taps);
    for (block, (weights, bias)) in weight_blocks.zip(pass.bias.chunks_exact(width)).enumerate() {
        let Some(bias) = S::as_simd_f32s(bias).0.first_chunk::<V>() else { continue };
        if pixels < P {
            for pixel in 0..pixels {
                tile::<S, FUSED, V, R, 1>(simd, pass, weights, bias, pixel, block, output);
            }
            continue;
        }
        for pixel in (0..pixels).step_by(P) {
            // The last tile reaches back over pixels that are done, so that all tiles are full.
            let pixel = pixel.min(pixels - P);
            tile::<S, FUSED, V, R, P>(simd, pass, weights, bias, pixel, block, output);
        }
    }
}

/// One block of V vectors of output channels at P pixels; R lines are a row of weights.
#[inline(always)]
fn tile<S: Simd, const FUSED: bool, const V: usize, const R: usize, const P: usize>(
    simd: S,
    pass: TilePass<'_>,
    weights: &[[Line; R]],
    bias: &[S::f32s; V],
    first_pixel: usize,
    block: usize,
    output: &mut [f32],
) {
    let Some(starts) = pass.pixel_starts[first_pixel..].first_chunk::<P>() else { return };
    let mut sums = [*bias; P];
    for (&run, weights) in pass.run_starts.iter().zip(weights.chunks_exact(pass.run_length)) {
        let mut values: [&[f32]; P] = [&[]; P];
        for p in 0..P {
            values[p] = &pass.input[starts[p] + run..][..weights.len()];
        }
        for (tap, row) in weights.iter().enumerate() {
            let mut weight = [bias[0]; V];
            for v in 0..V {
                weight[v] = load(simd, row, v);
            }
            for p in 0..P {
                let value = broadcast::<S, FUSED>(simd, values[p][tap]);
                for v in 0..V {
                    sums[p][v] = multiply_add::<S, FUSED>(simd, value, weight[v], sums[p][v]);
                }
            }
        }
    }
    let least = simd.splat_f32s(pass.least);
    let width = V * S::F32_LANES;
    let channel = block * width;
    let written = width.min(pass.channels - channel);
    for p in 0..P {
        let start = (first_pixel + p) * pass.output_channels + pass.first_channel + channel;
        let pixel = &mut output[start..][..written];
        // Constant indices only: sums that are looked up by a variable would live in memory.
        for v in 0..V {
            let sum = simd.max_f32s(least, sums[p][v]);
            let values = &mut pixel[(v * S::F32_LANES).min(written)..];
            if let Some(vector) = S::as_mut_simd_f32s(values).0.first_mut() {
                *vector = sum;
            } else if !values.is_empty() {
                simd.partial_store_f32s(values, sum);
            }
        }
    }
}

/// Vector `index` of a row of weights.
#[inline(always)]
fn load<S: Simd, const R: usize>(simd: S, row: &[Line; R], index: usize) -> S::f32s {
    match S::F32_LANES {
        4 => {
            let line = row[index / 2].0;
            bytemuck::cast(bytemuck::cast::<[f32; LINE], [[f32; 4]; 2]>(line)[index % 2])
        }
        8 => bytemuck::cast(row[index].0),
        16 => bytemuck::cast([row[2 * index].0, row[2 * index + 1].0]),
        lanes => simd.splat_f32s(row[index * lanes / LINE].0[index * lanes % LINE]),
    }
}
