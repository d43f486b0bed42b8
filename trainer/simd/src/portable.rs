//! Vectors as plain arrays, for the compilation target's own instructions.

mod doubles;

use super::{Lanes, Pair, Simd, Sum, Vector};
use doubles::Two;

/// The token of the baseline, which needs no proof.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Simd for Portable {
    type V8 = Array;
    type V16 = Pair<Array, Array>;
    type Wide = Array;
    type Doubles = Two;
    const MANY_REGISTERS: bool = false;
}

/// A vector of eight lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Array([f32; 8]);

#[inline(always)]
fn zip(a: Array, b: Array, f: impl Fn(f32, f32) -> f32) -> Array {
    let mut out = a;
    for i in 0..8 {
        out.0[i] = f(a.0[i], b.0[i]);
    }
    out
}

impl Lanes for Array {
    type Token = Portable;
    type Number = f32;
    const LANES: usize = 8;

    #[inline(always)]
    fn splat(_: Portable, x: f32) -> Self {
        Self([x; 8])
    }
    #[inline(always)]
    fn load(_: Portable, from: &[f32]) -> Self {
        Self(*from.first_chunk().expect("eight lanes to load"))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        zip(self, other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        zip(self, other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        zip(self, other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        zip(self, other, |a, b| a / b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
}

impl Vector for Array {
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        zip(self, other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        zip(self, other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        zip(self, gate, |a, g| if g > 0.0 { a } else { 0.0 })
    }
}

impl Sum for Array {
    #[inline(always)]
    fn sum(self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.0;
        let four = [a + e, b + f, c + g, d + h];
        (four[0] + four[2]) + (four[1] + four[3])
    }
}
