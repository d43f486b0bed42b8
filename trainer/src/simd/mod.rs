//! Vectors of `f32`, and the choice of the instruction set at run time.
//!
//! Numerical code is written once, generic over [`Simd`], and compiled for each
//! [`Isa`]. Every operation here is one IEEE operation per lane, in the order
//! written, never contracted to a fused multiply-add: the results are the same
//! bits on every instruction set, so a seed gives the same policy everywhere.
//!
//! A vector can only be made from the token of its instruction set, and the
//! token only by [`dispatch`] after the CPU was asked. So the rest of the crate
//! is safe code, and `x86` is the one module with `unsafe` in it.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// What the compilation target guarantees.
    Baseline,
    /// AVX2: 16 registers of 8 lanes.
    Avx2,
    /// AVX-512F: 32 registers of 16 lanes.
    Avx512,
}

impl Isa {
    /// Every instruction set, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// The widest that this CPU has.
    #[must_use]
    pub fn best() -> Self {
        Self::ALL.into_iter().rfind(|isa| isa.available()).unwrap_or(Self::Baseline)
    }

    /// Whether this CPU (and the operating system) has it.
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

    /// Its name, for reports.
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
    /// Eight lanes.
    type V8: Sum<Token = Self>;
    /// Sixteen lanes.
    type V16: Sum<Token = Self>;
    /// The columns of a tile of the matrix product.
    type Wide: Vector<Token = Self>;
    /// Whether the registers hold ten rows of `Wide` sums, or only five.
    const MANY_REGISTERS: bool;
}

/// A vector of `f32`. Holding one proves that the CPU has its instruction set.
///
/// Comparisons follow x86: where an operand is not a number, the second is taken.
pub trait Vector: Copy {
    /// The instruction set that it needs.
    type Token: Simd;
    /// Lanes.
    const LANES: usize;
    /// `x` in every lane.
    fn splat(token: Self::Token, x: f32) -> Self;
    /// The first lanes of `from`, which must have as many.
    fn load(token: Self::Token, from: &[f32]) -> Self;
    /// Writes the lanes over the first of `to`, which must have as many.
    fn store(self, to: &mut [f32]);
    /// `self + other`.
    #[must_use]
    fn add(self, other: Self) -> Self;
    /// `self - other`.
    #[must_use]
    fn sub(self, other: Self) -> Self;
    /// `self * other`.
    #[must_use]
    fn mul(self, other: Self) -> Self;
    /// `self / other`.
    #[must_use]
    fn div(self, other: Self) -> Self;
    /// The square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// `if self > other { self } else { other }`.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// `if self < other { self } else { other }`.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// `self` where `gate` is above zero, else 0.
    #[must_use]
    fn where_positive(self, gate: Self) -> Self;
}

/// A vector whose lanes can be added up.
pub trait Sum: Vector {
    /// The sum of the lanes: the upper half is added to the lower, until one is left.
    fn sum(self) -> f32;
}

/// Two vectors side by side.
#[derive(Clone, Copy, Debug)]
pub struct Pair<A, B>(A, B);

impl<A: Vector, B: Vector<Token = A::Token>> Vector for Pair<A, B> {
    type Token = A::Token;
    const LANES: usize = A::LANES + B::LANES;

    #[inline(always)]
    fn splat(token: Self::Token, x: f32) -> Self {
        Self(A::splat(token, x), B::splat(token, x))
    }
    #[inline(always)]
    fn load(token: Self::Token, from: &[f32]) -> Self {
        Self(A::load(token, from), B::load(token, &from[A::LANES..]))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.0.store(to);
        self.1.store(&mut to[A::LANES..]);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0.add(other.0), self.1.add(other.1))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0.sub(other.0), self.1.sub(other.1))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0.mul(other.0), self.1.mul(other.1))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(self.0.div(other.0), self.1.div(other.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        Self(self.0.where_positive(gate.0), self.1.where_positive(gate.1))
    }
}

impl<V: Sum> Sum for Pair<V, V> {
    #[inline(always)]
    fn sum(self) -> f32 {
        self.0.add(self.1).sum()
    }
}

/// Numerical code to be run under an instruction set.
pub trait Kernel {
    /// What it gives.
    type Output;
    /// The code. Must be `#[inline(always)]`, as must be all that it calls:
    /// only what is inlined is compiled for the instruction set.
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
