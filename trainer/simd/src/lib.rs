//! Vectors of `f32` and `f64`, and the choice of the instruction set at run time.
//!
//! Numerical code is written once, generic over [`Simd`], and compiled for each [`Isa`]. Every
//! operation is one IEEE operation per lane, in the order written, and never contracted to a
//! fused multiply-add. So every instruction set gives the same bits, and a seed gives the same
//! policy everywhere.
//!
//! A vector can only be created from the token of its instruction set, and only [`dispatch`]
//! creates tokens, after it has checked the CPU. So the rest of the crate is safe code, and
//! `x86` is the only module with `unsafe`.

#![allow(
    clippy::inline_always,
    reason = "code that is inlined is compiled for the instruction set"
)]

mod doubles;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use doubles::{Doubles, Mask};

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// The instructions that the compilation target guarantees.
    Baseline,
    /// AVX2: 16 registers of 8 lanes.
    Avx2,
    /// AVX-512F: 32 registers of 16 lanes.
    Avx512,
}

impl Isa {
    /// Every instruction set, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Returns the widest instruction set of this CPU.
    #[must_use]
    pub fn best() -> Self {
        Self::ALL.into_iter().rfind(|isa| isa.available()).unwrap_or(Self::Baseline)
    }

    /// Whether this CPU and the operating system support it.
    #[must_use]
    pub fn available(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => std::arch::is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                std::arch::is_x86_feature_detected!("avx512f")
                    && std::arch::is_x86_feature_detected!("avx2")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// Returns its name, for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512f",
        }
    }
}

/// An instruction set's vectors, and how many of them its registers hold.
pub trait Simd: Copy {
    /// A vector of eight lanes.
    type V8: Sum<Token = Self>;
    /// A vector of sixteen lanes.
    type V16: Sum<Token = Self>;
    /// The columns of a tile of the matrix product.
    type Wide: Vector<Token = Self>;
    /// The `f64` of a register, or of several where one would wait for its results.
    type Doubles: Doubles<Token = Self>;
    /// Whether the registers hold ten rows of `Wide` sums, or only five.
    const MANY_REGISTERS: bool;
}

/// A vector of numbers. A value proves that the CPU has its instruction set.
pub trait Lanes: Copy {
    /// Token of the instruction set.
    type Token: Simd;
    /// The type of a lane.
    type Number: Copy;
    /// Number of lanes.
    const LANES: usize;
    /// Returns a vector with `x` in every lane.
    fn splat(token: Self::Token, x: Self::Number) -> Self;
    /// Loads the first lanes of `from`.
    ///
    /// # Panics
    /// If `from` has fewer numbers than lanes.
    fn load(token: Self::Token, from: &[Self::Number]) -> Self;
    /// Stores the lanes over the first numbers of `to`.
    ///
    /// # Panics
    /// If `to` has fewer numbers than lanes.
    fn store(self, to: &mut [Self::Number]);
    /// Returns `self + other`.
    #[must_use]
    fn add(self, other: Self) -> Self;
    /// Returns `self - other`.
    #[must_use]
    fn sub(self, other: Self) -> Self;
    /// Returns `self * other`.
    #[must_use]
    fn mul(self, other: Self) -> Self;
    /// Returns `self / other`.
    #[must_use]
    fn div(self, other: Self) -> Self;
    /// Returns the square root.
    #[must_use]
    fn sqrt(self) -> Self;
}

/// A vector of `f32`.
///
/// Comparisons follow x86: where an operand is NaN, the result is the second operand.
pub trait Vector: Lanes<Number = f32> {
    /// Returns `if self > other { self } else { other }`.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Returns `if self < other { self } else { other }`.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// Returns `self` where `gate` is above zero, else 0.
    #[must_use]
    fn where_positive(self, gate: Self) -> Self;
}

/// A vector whose lanes can be summed.
pub trait Sum: Vector {
    /// Returns the sum of the lanes: the upper half is added to the lower until one is left.
    fn sum(self) -> f32;
}

/// Two vectors, used as one of twice the width.
#[derive(Clone, Copy, Debug)]
pub struct Pair<A, B>(A, B);

/// Defines methods that do the same to both halves.
macro_rules! halves {
    ($($name:ident($($other:ident)?);)*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            Self(self.0.$name($($other.0)?), self.1.$name($($other.1)?))
        }
    )*};
}
use halves;

impl<A: Lanes, B: Lanes<Token = A::Token, Number = A::Number>> Lanes for Pair<A, B> {
    type Token = A::Token;
    type Number = A::Number;
    const LANES: usize = A::LANES + B::LANES;

    #[inline(always)]
    fn splat(token: Self::Token, x: Self::Number) -> Self {
        Self(A::splat(token, x), B::splat(token, x))
    }
    #[inline(always)]
    fn load(token: Self::Token, from: &[Self::Number]) -> Self {
        Self(A::load(token, from), B::load(token, &from[A::LANES..]))
    }
    #[inline(always)]
    fn store(self, to: &mut [Self::Number]) {
        self.0.store(to);
        self.1.store(&mut to[A::LANES..]);
    }
    halves! {
        add(other);
        sub(other);
        mul(other);
        div(other);
        sqrt();
    }
}

impl<A: Vector, B: Vector<Token = A::Token>> Vector for Pair<A, B> {
    halves! {
        max(other);
        min(other);
        where_positive(gate);
    }
}

impl<V: Sum> Sum for Pair<V, V> {
    #[inline(always)]
    fn sum(self) -> f32 {
        self.0.add(self.1).sum()
    }
}

/// Numerical code that runs under an instruction set.
pub trait Kernel {
    /// The result of the code.
    type Output;
    /// Runs the code. It must be `#[inline(always)]`, as must everything that it calls: only
    /// inlined code is compiled for the instruction set.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Runs `kernel` compiled for `isa`.
///
/// # Panics
/// If this CPU does not have `isa`.
pub fn dispatch<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    assert!(isa.available(), "this CPU does not have {}; use Isa::best()", isa.name());
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => x86::run_avx512(kernel),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => x86::run_avx2(kernel),
        _ => kernel.run(portable::Portable),
    }
}

#[cfg(test)]
mod tests {
    use super::{Isa, Kernel, Pair, Simd, Sum, dispatch};

    struct Everything<'a>(&'a [f32]);

    impl Everything<'_> {
        #[inline(always)]
        fn of<V: Sum>(&self, token: V::Token, out: &mut Vec<u32>) {
            let mut lanes = [0.0; 32];
            for (a, b) in self.0.windows(32).zip(self.0[7..].windows(32)) {
                let (x, y) = (V::load(token, a), V::load(token, b));
                let all = [
                    x.add(y),
                    x.sub(y),
                    x.mul(y),
                    x.div(y),
                    x.max(y),
                    x.min(y),
                    x.mul(x).sqrt(),
                    x.where_positive(y),
                    V::splat(token, a[3]),
                ];
                for v in all {
                    v.store(&mut lanes);
                    out.extend(lanes[..V::LANES].iter().map(|x| x.to_bits()));
                }
                out.push(x.sum().to_bits());
            }
        }
    }

    impl Kernel for Everything<'_> {
        type Output = Vec<u32>;
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Vec<u32> {
            let mut out = Vec::new();
            self.of::<S::V8>(simd, &mut out);
            self.of::<S::V16>(simd, &mut out);
            self.of::<Pair<S::V16, S::V16>>(simd, &mut out);
            out
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let mut state = 1_u32;
        let mut numbers: Vec<f32> = (0..200)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f32::from_bits((state >> 8) | 0x3f00_0000) - 1.3
            })
            .collect();
        numbers.extend([0.0, -0.0, 1e-40, -1e-40, f32::MAX, f32::MIN_POSITIVE]);
        numbers.extend((0..40).map(|i| i as f32 - 20.0));
        let baseline = dispatch(Isa::Baseline, Everything(&numbers));
        for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
            assert_eq!(dispatch(isa, Everything(&numbers)), baseline, "{isa:?}");
        }
    }
}
