//! The number type of the apex map: one `f64`, or a vector of several.
//!
//! The equations of a stance are written once, generic over [`Real`]. Each operation is one IEEE
//! operation per lane, in the order written, so that a lane has the bits of the scalar plant.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// The results of a comparison, one a lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// Returns the lanes as bits, the first lane in the lowest.
    fn bits(self) -> u32;

    /// Returns whether any lane is true.
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
}

/// A number, or a vector of numbers with lane-wise operations.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The type of comparisons.
    type Mask: Mask;
    /// Number of lanes.
    const LANES: usize;

    /// Returns `x` in every lane.
    #[must_use]
    fn splat(self, x: f64) -> Self;
    /// Loads the first lanes of `from`, which holds at least as many numbers.
    #[must_use]
    fn load(self, from: &[f64]) -> Self;
    /// Stores the lanes over the first numbers of `to`, which holds at least as many.
    fn store(self, to: &mut [f64]);
    /// Returns the square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    #[must_use]
    fn abs(self) -> Self;
    /// Returns the magnitude of `self` with the sign of `sign`.
    #[must_use]
    fn copysign(self, sign: Self) -> Self;
    /// Returns the larger number, or the one that is not NaN.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Returns the smaller number, or the one that is not NaN.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// Returns `self < other`; false for NaN, as in the other comparisons.
    fn lt(self, other: Self) -> Self::Mask;
    /// Returns `self <= other`.
    fn le(self, other: Self) -> Self::Mask;
    /// Returns `self == other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// Returns `yes` where the mask is true, else `no`.
    #[must_use]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Returns a rough `N`-th root of each lane, see [`rough_root`].
    #[must_use]
    fn rough_root<const N: usize>(self) -> Self;

    /// Returns `self > other`.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// Returns `self >= other`.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// Returns 1 with the sign of the number, or NaN.
    #[inline(always)]
    #[must_use]
    fn signum(self) -> Self {
        Self::select(self.eq(self), self.splat(1.0).copysign(self), self)
    }
    /// Returns the number or the bound that it is beyond. A NaN stays.
    #[inline(always)]
    #[must_use]
    fn clamp(self, low: Self, high: Self) -> Self {
        let raised = Self::select(self.lt(low), low, self);
        Self::select(raised.gt(high), high, raised)
    }
}

/// Estimates the `N`-th root of a positive number to a few percent, from the fact that the bits of
/// a float are nearly its logarithm. Unlike `powf` it gives the same bits on every machine.
#[inline(always)]
#[must_use]
pub fn rough_root<const N: usize>(x: f64) -> f64 {
    const ONE: i64 = 1.0_f64.to_bits().cast_signed();
    let n = const { N.cast_signed() as i64 };
    let over_one = x.to_bits().cast_signed() - ONE;
    f64::from_bits((ONE + over_one / n).cast_unsigned())
}

impl Mask for bool {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

impl Real for f64 {
    type Mask = bool;
    const LANES: usize = 1;

    #[inline(always)]
    fn splat(self, x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self;
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::abs(self)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Self::copysign(self, sign)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::max(self, other)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::min(self, other)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn rough_root<const N: usize>(self) -> Self {
        rough_root::<N>(self)
    }
}
