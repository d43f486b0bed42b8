//! The vectors of `leg-simd` as the numbers of `leg-plant`.

use leg_plant::lanes::{MAX_LANES, Mask, Real, rough_root};
use leg_simd::Doubles;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// A vector whose lanes are numbers of as many hops.
#[derive(Clone, Copy)]
pub(crate) struct Wide<D>(pub(crate) D);

/// The results of a comparison.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<M>(M);

/// Defines operators that are a method of the vector.
macro_rules! operators {
    ($($operator:ident $name:ident),*) => {$(
        impl<D: Doubles> $operator for Wide<D> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self(self.0.$name(other.0))
            }
        }
    )*};
}

operators!(Add add, Sub sub, Mul mul, Div div);

impl<D: Doubles> Neg for Wide<D> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.neg())
    }
}

impl<M: leg_simd::Mask> BitAnd for Lanes<M> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0.and(other.0))
    }
}

impl<M: leg_simd::Mask> BitOr for Lanes<M> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0.or(other.0))
    }
}

impl<M: leg_simd::Mask> Not for Lanes<M> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.not())
    }
}

impl<M: leg_simd::Mask> Mask for Lanes<M> {
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits()
    }
}

/// Defines methods that are one of the vector.
macro_rules! methods {
    ($($name:ident($($other:ident)?) -> $result:ty = $of:ident;)*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> $result {
            $of(self.0.$name($($other.0)?))
        }
    )*};
}

impl<D: Doubles> Real for Wide<D> {
    type Mask = Lanes<D::Mask>;
    const LANES: usize = D::LANES;

    #[inline(always)]
    fn splat(self, x: f64) -> Self {
        Self(D::splat(self.0.token(), x))
    }
    #[inline(always)]
    fn load(self, from: &[f64]) -> Self {
        Self(D::load(self.0.token(), from))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        self.0.store(to);
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.copysign(D::splat(self.0.token(), 0.0)))
    }
    methods! {
        sqrt() -> Self = Wide;
        copysign(sign) -> Self = Wide;
        max(other) -> Self = Wide;
        min(other) -> Self = Wide;
        lt(other) -> Self::Mask = Lanes;
        le(other) -> Self::Mask = Lanes;
        eq(other) -> Self::Mask = Lanes;
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(D::select(mask.0, yes.0, no.0))
    }
    #[inline(always)]
    fn rough_root<const N: usize>(self) -> Self {
        let mut lanes = [0.0; MAX_LANES];
        self.store(&mut lanes);
        for x in &mut lanes[..D::LANES] {
            *x = rough_root::<N>(*x);
        }
        self.load(&lanes)
    }
}
