//! AVX2 and AVX-512F vectors, with the crate's only `unsafe` code (and that of `doubles`).
#![allow(
    unsafe_code,
    reason = "calls intrinsics that need a CPU feature; each vector is made from a token that proves the feature"
)]

use core::arch::x86_64::{
    __m256, __m512, _CMP_GT_OQ, _mm_add_ps, _mm_add_ss, _mm_cvtss_f32, _mm_movehl_ps,
    _mm_shuffle_ps, _mm256_add_ps, _mm256_and_ps, _mm256_castpd_ps, _mm256_castps256_ps128,
    _mm256_cmp_ps, _mm256_div_ps, _mm256_extractf128_ps, _mm256_loadu_ps, _mm256_max_ps,
    _mm256_min_ps, _mm256_mul_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_sqrt_ps,
    _mm256_storeu_ps, _mm256_sub_ps, _mm512_add_ps, _mm512_castps_pd, _mm512_castps512_ps256,
    _mm512_cmp_ps_mask, _mm512_div_ps, _mm512_extractf64x4_pd, _mm512_loadu_ps,
    _mm512_maskz_mov_ps, _mm512_max_ps, _mm512_min_ps, _mm512_mul_ps, _mm512_set1_ps,
    _mm512_setzero_ps, _mm512_sqrt_ps, _mm512_storeu_ps, _mm512_sub_ps,
};

use super::{Isa, Kernel, Lanes, Pair, Simd, Sum, Vector};
use doubles::{F64x4, F64x8};

/// The token that proves AVX2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(());

/// The token that proves AVX-512F and AVX2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx512(());

/// The tokens of this module, which all prove AVX2.
pub(super) trait ProvesAvx2: Simd {}
impl ProvesAvx2 for Avx2 {}
impl ProvesAvx2 for Avx512 {}

impl Simd for Avx2 {
    type V8 = F32x8<Self>;
    type V16 = Pair<F32x8<Self>, F32x8<Self>>;
    type Wide = Self::V16;
    type Doubles = F64x4<Self>;
    const MANY_REGISTERS: bool = false;
}

impl Simd for Avx512 {
    type V8 = F32x8<Self>;
    type V16 = F32x16;
    // One vector and not two: ten sums keep the multipliers as busy, without spills. Measured
    // 19 us an update against 25.
    type Wide = F32x16;
    type Doubles = F64x8;
    const MANY_REGISTERS: bool = true;
}

#[target_feature(enable = "avx2")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2(()))
}

#[target_feature(enable = "avx512f,avx2")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512(()))
}

pub(super) fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    assert!(Isa::Avx2.available());
    // SAFETY: the CPU has the feature, just asserted.
    unsafe { avx2(kernel) }
}

pub(super) fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    assert!(Isa::Avx512.available());
    // SAFETY: the CPU has both features, just asserted.
    unsafe { avx512(kernel) }
}

/// A vector of eight lanes; `T` is the token of its creation.
#[derive(Clone, Copy, Debug)]
pub(super) struct F32x8<T>(__m256, T);

/// A vector of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct F32x16(__m512, Avx512);

/// Defines the methods that are one intrinsic.
macro_rules! lanewise {
    ($($name:ident($($other:ident)?) = $intrinsic:ident;)*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            // SAFETY: `self` was made from a token, so the CPU has the feature.
            unsafe { Self($intrinsic(self.0 $(, $other.0)?), self.1) }
        }
    )*};
}

/// Defines what every vector does, each by one intrinsic.
macro_rules! lanes {
    (
        $vector:ty, $token:ty, $number:ty, $lanes:literal, [$($bound:tt)*],
        $splat:ident, $load:ident, $store:ident,
        $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident
    ) => {
        impl $($bound)* Lanes for $vector {
            type Token = $token;
            type Number = $number;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn splat(token: $token, x: $number) -> Self {
                // SAFETY: the token proves the feature.
                unsafe { Self($splat(x), token) }
            }
            #[inline(always)]
            fn load(token: $token, from: &[$number]) -> Self {
                let from: &[$number; $lanes] = from.first_chunk().expect("lanes to load");
                // SAFETY: the token proves the feature; the numbers are readable; unaligned is
                // allowed.
                unsafe { Self($load(from.as_ptr()), token) }
            }
            #[inline(always)]
            fn store(self, to: &mut [$number]) {
                let to: &mut [$number; $lanes] = to.first_chunk_mut().expect("lanes to store");
                // SAFETY: the feature by the token; the numbers are writable; unaligned is allowed.
                unsafe { $store(to.as_mut_ptr(), self.0) }
            }
            lanewise! {
                add(other) = $add;
                sub(other) = $sub;
                mul(other) = $mul;
                div(other) = $div;
                sqrt() = $sqrt;
            }
        }
    };
}

// Behind the macros, which it uses.
mod doubles;

lanes!(
    F32x8<T>, T, f32, 8, [<T: ProvesAvx2>], _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps,
    _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps, _mm256_sqrt_ps
);

impl<T: ProvesAvx2> Vector for F32x8<T> {
    lanewise! {
        max(other) = _mm256_max_ps;
        min(other) = _mm256_min_ps;
    }
    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        // SAFETY: AVX2 by the token.
        unsafe {
            let above = _mm256_cmp_ps::<_CMP_GT_OQ>(gate.0, _mm256_setzero_ps());
            Self(_mm256_and_ps(self.0, above), self.1)
        }
    }
}

impl<T: ProvesAvx2> Sum for F32x8<T> {
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: AVX2 by the token.
        unsafe {
            let four =
                _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }
}

lanes!(
    F32x16,
    Avx512,
    f32,
    16,
    [],
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_div_ps,
    _mm512_sqrt_ps
);

impl Vector for F32x16 {
    lanewise! {
        max(other) = _mm512_max_ps;
        min(other) = _mm512_min_ps;
    }
    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        // SAFETY: AVX-512F by the token.
        unsafe {
            let above = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(gate.0, _mm512_setzero_ps());
            Self(_mm512_maskz_mov_ps(above, self.0), self.1)
        }
    }
}

impl Sum for F32x16 {
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: AVX-512F by the token.
        let (low, high) = unsafe {
            let high = _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(self.0)));
            (_mm512_castps512_ps256(self.0), high)
        };
        F32x8(low, self.1).add(F32x8(high, self.1)).sum()
    }
}
