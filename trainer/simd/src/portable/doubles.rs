//! Two `f64` as a plain array, which 128-bit registers hold.

use super::Portable;
use crate::{Doubles, Lanes, Mask};

/// A vector of two lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub(crate) struct Two([f64; 2]);

/// The lanes of a [`Two`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mask2([bool; 2]);

impl Mask for Mask2 {
    const LANES: usize = 2;

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self([self.0[0] & other.0[0], self.0[1] & other.0[1]])
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self([self.0[0] | other.0[0], self.0[1] | other.0[1]])
    }
    #[inline(always)]
    fn not(self) -> Self {
        Self([!self.0[0], !self.0[1]])
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self.0[0]) | (u32::from(self.0[1]) << 1)
    }
}

/// Defines the methods that are one operation of a number, or of two.
macro_rules! lanewise {
    ($($name:ident($($other:ident)?) = $operation:path;)*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            Self([0, 1].map(|i| $operation(self.0[i] $(, $other.0[i])?)))
        }
    )*};
}

/// Defines comparisons.
macro_rules! comparisons {
    ($($name:ident = $operation:path;)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Mask2 {
            Mask2([0, 1].map(|i| $operation(&self.0[i], &other.0[i])))
        }
    )*};
}

impl Lanes for Two {
    type Token = Portable;
    type Number = f64;
    const LANES: usize = 2;

    #[inline(always)]
    fn splat(_: Portable, x: f64) -> Self {
        Self([x; 2])
    }
    #[inline(always)]
    fn load(_: Portable, from: &[f64]) -> Self {
        Self(*from.first_chunk().expect("two lanes to load"))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..2].copy_from_slice(&self.0);
    }
    lanewise! {
        add(other) = core::ops::Add::add;
        sub(other) = core::ops::Sub::sub;
        mul(other) = core::ops::Mul::mul;
        div(other) = core::ops::Div::div;
        sqrt() = f64::sqrt;
    }
}

impl Doubles for Two {
    type Mask = Mask2;

    #[inline(always)]
    fn token(self) -> Portable {
        Portable
    }
    lanewise! {
        copysign(other) = f64::copysign;
        neg() = core::ops::Neg::neg;
        max(other) = f64::max;
        min(other) = f64::min;
    }
    comparisons! {
        lt = PartialOrd::lt;
        le = PartialOrd::le;
        eq = PartialEq::eq;
    }
    #[inline(always)]
    fn select(mask: Mask2, yes: Self, no: Self) -> Self {
        Self([0, 1].map(|i| if mask.0[i] { yes.0[i] } else { no.0[i] }))
    }
}
