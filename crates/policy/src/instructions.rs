//! Which vector instructions the kernels use.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use pulp::{Arch, Scalar128b, Simd, WithSimd, bytemuck};

/// Which vector instructions the kernels use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Instructions {
    /// The widest that the processor has and the build knows: AVX2 with fused multiply-add (AVX-512
    /// with the feature `avx512`) on x86-64, Neon on `AArch64`.
    #[default]
    Best,
    /// Those of every processor that the build runs on. Slower; results differ by rounding only.
    Portable,
}

/// Values in a vector of portable instructions.
const PORTABLE_LANES: usize = 4;

/// Code that is compiled once for each set of instructions.
pub(crate) trait Kernel {
    /// What it gives.
    type Output;

    /// Runs with the vectors of `simd`. `FUSED` says whether a fused multiply-add is an
    /// instruction. Must be `#[inline(always)]`, as everything that it calls.
    fn run<S: Simd, const FUSED: bool>(self, simd: S) -> Self::Output;
}

/// A kernel as pulp takes it.
struct Fused<K>(K);

impl<K: Kernel> WithSimd for Fused<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        self.0.run::<S, true>(simd)
    }
}

impl Instructions {
    /// Runs a kernel with these instructions.
    pub(crate) fn dispatch<K: Kernel>(self, kernel: K) -> K::Output {
        match (self, Arch::new()) {
            (Self::Portable, _) | (_, Arch::Scalar) => kernel.run::<Scalar128b, false>(Scalar128b),
            (Self::Best, arch) => arch.dispatch(Fused(kernel)),
        }
    }

    /// Values in one vector.
    pub(crate) fn lanes(self) -> usize {
        self.dispatch(Lanes)
    }
}

/// Asks for the number of values in one vector.
struct Lanes;

impl Kernel for Lanes {
    type Output = usize;

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, _: S) -> usize {
        S::F32_LANES
    }
}

/// x · y + sum.
#[inline(always)]
pub(crate) fn multiply_add<S: Simd, const FUSED: bool>(
    simd: S,
    x: S::f32s,
    y: S::f32s,
    sum: S::f32s,
) -> S::f32s {
    if FUSED {
        return simd.mul_add_e_f32s(x, y, sum);
    }
    if S::F32_LANES != PORTABLE_LANES {
        return simd.add_f32s(simd.mul_f32s(x, y), sum);
    }
    // Plain arrays, which become the vectors of the build; the portable ones of pulp are calls.
    let (x, y): ([f32; PORTABLE_LANES], [f32; PORTABLE_LANES]) =
        (bytemuck::cast(x), bytemuck::cast(y));
    let mut sums: [f32; PORTABLE_LANES] = bytemuck::cast(sum);
    for lane in 0..PORTABLE_LANES {
        sums[lane] += x[lane] * y[lane];
    }
    bytemuck::cast(sums)
}

/// A vector of equal values.
#[inline(always)]
pub(crate) fn broadcast<S: Simd, const FUSED: bool>(simd: S, value: f32) -> S::f32s {
    if !FUSED && S::F32_LANES == PORTABLE_LANES {
        return bytemuck::cast([value; PORTABLE_LANES]);
    }
    simd.splat_f32s(value)
}
