//! AVX2 and AVX-512F vectors of `f64`.

use core::arch::x86_64::{
    __m256d, __m512d, __mmask8, _CMP_EQ_OQ, _CMP_LE_OQ, _CMP_LT_OQ, _CMP_UNORD_Q, _mm256_add_pd,
    _mm256_and_pd, _mm256_andnot_pd, _mm256_blendv_pd, _mm256_castsi256_pd, _mm256_cmp_pd,
    _mm256_div_pd, _mm256_loadu_pd, _mm256_max_pd, _mm256_min_pd, _mm256_movemask_pd,
    _mm256_mul_pd, _mm256_or_pd, _mm256_set1_epi64x, _mm256_set1_pd, _mm256_sqrt_pd,
    _mm256_storeu_pd, _mm256_sub_pd, _mm256_xor_pd, _mm512_add_pd, _mm512_castpd_si512,
    _mm512_castsi512_pd, _mm512_cmp_pd_mask, _mm512_div_pd, _mm512_loadu_pd, _mm512_mask_blend_pd,
    _mm512_max_pd, _mm512_min_pd, _mm512_mul_pd, _mm512_set1_pd, _mm512_sqrt_pd, _mm512_storeu_pd,
    _mm512_sub_pd, _mm512_ternarylogic_epi64, _mm512_xor_si512,
};

use super::{Avx512, ProvesAvx2};
use crate::{Doubles, Lanes, Mask};

/// A vector of four lanes; `T` is the token of its creation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct F64x4<T>(__m256d, T);

/// The lanes of an [`F64x4`]: all bits set where true.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mask4<T>(__m256d, T);

/// A vector of eight lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct F64x8(__m512d, Avx512);

/// The lanes of an [`F64x8`], one bit each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mask8(__mmask8);

/// Defines the comparisons of [`F64x4`].
macro_rules! compare4 {
    ($($name:ident = $predicate:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self::Mask {
            // SAFETY: `self` was made from a token, so the CPU has AVX2.
            unsafe { Mask4(_mm256_cmp_pd::<$predicate>(self.0, other.0), self.1) }
        }
    )*};
}

/// Defines the comparisons of [`F64x8`].
macro_rules! compare8 {
    ($($name:ident = $predicate:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self::Mask {
            // SAFETY: `self` was made from a token, so the CPU has AVX-512F.
            unsafe { Mask8(_mm512_cmp_pd_mask::<$predicate>(self.0, other.0)) }
        }
    )*};
}

impl<T: ProvesAvx2> Mask for Mask4<T> {
    const LANES: usize = 4;

    lanewise! {
        and(other) = _mm256_and_pd;
        or(other) = _mm256_or_pd;
    }
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: `self` was made from a token, so the CPU has AVX2.
        unsafe {
            let all = _mm256_castsi256_pd(_mm256_set1_epi64x(-1));
            Self(_mm256_xor_pd(self.0, all), self.1)
        }
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        // SAFETY: `self` was made from a token, so the CPU has AVX2.
        unsafe { _mm256_movemask_pd(self.0).cast_unsigned() }
    }
}

lanes!(
    F64x4<T>, T, f64, 4, [<T: ProvesAvx2>], _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd,
    _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd, _mm256_sqrt_pd
);

impl<T: ProvesAvx2> Doubles for F64x4<T> {
    type Mask = Mask4<T>;

    #[inline(always)]
    fn token(self) -> T {
        self.1
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        // SAFETY: AVX2 by the token.
        unsafe {
            let bit = _mm256_set1_pd(-0.0);
            let sign = _mm256_and_pd(bit, sign.0);
            Self(_mm256_or_pd(_mm256_andnot_pd(bit, self.0), sign), self.1)
        }
    }
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX2 by the token.
        unsafe { Self(_mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)), self.1) }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: AVX2 by the token. The instruction returns its second operand for a NaN.
        unsafe {
            let larger = _mm256_max_pd(other.0, self.0);
            let nan = _mm256_cmp_pd::<_CMP_UNORD_Q>(self.0, self.0);
            Self(_mm256_blendv_pd(larger, other.0, nan), self.1)
        }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: AVX2 by the token. The instruction returns its second operand for a NaN.
        unsafe {
            let smaller = _mm256_min_pd(other.0, self.0);
            let nan = _mm256_cmp_pd::<_CMP_UNORD_Q>(self.0, self.0);
            Self(_mm256_blendv_pd(smaller, other.0, nan), self.1)
        }
    }
    compare4! {
        lt = _CMP_LT_OQ;
        le = _CMP_LE_OQ;
        eq = _CMP_EQ_OQ;
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        // SAFETY: AVX2 by the token.
        unsafe { Self(_mm256_blendv_pd(no.0, yes.0, mask.0), no.1) }
    }
}

impl Mask for Mask8 {
    const LANES: usize = 8;

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self.0)
    }
}

lanes!(
    F64x8,
    Avx512,
    f64,
    8,
    [],
    _mm512_set1_pd,
    _mm512_loadu_pd,
    _mm512_storeu_pd,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_sqrt_pd
);

impl Doubles for F64x8 {
    type Mask = Mask8;

    #[inline(always)]
    fn token(self) -> Avx512 {
        self.1
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        /// Of three operands, the bits of the second where those of the first are set, else of
        /// the third.
        const CHOOSE: i32 = 0xca;
        // SAFETY: AVX-512F by the token.
        unsafe {
            let bit = _mm512_castpd_si512(_mm512_set1_pd(-0.0));
            let (sign, own) = (_mm512_castpd_si512(sign.0), _mm512_castpd_si512(self.0));
            let chosen = _mm512_ternarylogic_epi64::<CHOOSE>(bit, sign, own);
            Self(_mm512_castsi512_pd(chosen), self.1)
        }
    }
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX-512F by the token.
        unsafe {
            let bit = _mm512_castpd_si512(_mm512_set1_pd(-0.0));
            Self(_mm512_castsi512_pd(_mm512_xor_si512(_mm512_castpd_si512(self.0), bit)), self.1)
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: AVX-512F by the token. The instruction returns its second operand for a NaN.
        unsafe {
            let larger = _mm512_max_pd(other.0, self.0);
            let nan = _mm512_cmp_pd_mask::<_CMP_UNORD_Q>(self.0, self.0);
            Self(_mm512_mask_blend_pd(nan, larger, other.0), self.1)
        }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: AVX-512F by the token. The instruction returns its second operand for a NaN.
        unsafe {
            let smaller = _mm512_min_pd(other.0, self.0);
            let nan = _mm512_cmp_pd_mask::<_CMP_UNORD_Q>(self.0, self.0);
            Self(_mm512_mask_blend_pd(nan, smaller, other.0), self.1)
        }
    }
    compare8! {
        lt = _CMP_LT_OQ;
        le = _CMP_LE_OQ;
        eq = _CMP_EQ_OQ;
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        // SAFETY: AVX-512F by the token.
        unsafe { Self(_mm512_mask_blend_pd(mask.0, no.0, yes.0), no.1) }
    }
}
