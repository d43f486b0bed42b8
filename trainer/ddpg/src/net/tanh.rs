//! tanh by a rational function of multiplications, additions and one division, so that every
//! instruction set rounds it alike.

use leg_simd::Vector;

/// Argument from which tanh is 1 in `f32`.
const SATURATION: f32 = 7.905_311;
/// Coefficients of the odd numerator, highest power first (the minimax fit of Eigen's `ptanh`).
const NUMERATOR: [f32; 7] = [
    -2.760_768_5e-16,
    2.000_188e-13,
    -8.604_672e-11,
    5.122_297_1e-8,
    1.485_722_4e-5,
    6.372_619_3e-4,
    4.893_524_6e-3,
];
/// Coefficients of the even denominator, highest power first.
const DENOMINATOR: [f32; 4] = [1.198_258_4e-6, 1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3];

/// Returns tanh of each lane, within 5e-7.
#[inline(always)]
pub(crate) fn tanh<V: Vector>(token: V::Token, x: V) -> V {
    let limit = V::splat(token, SATURATION);
    let x = x.max(V::splat(token, -SATURATION)).min(limit);
    let square = x.mul(x);
    let numerator = x.mul(horner(token, square, &NUMERATOR));
    let ratio = numerator.div(horner(token, square, &DENOMINATOR));
    let one = V::splat(token, 1.0);
    ratio.min(one).max(V::splat(token, -1.0))
}

// This is a function because a closure need not be inlined, see `Kernel::run`.
#[inline(always)]
fn horner<V: Vector>(token: V::Token, x: V, coefficients: &[f32]) -> V {
    let mut sum = V::splat(token, coefficients[0]);
    for &c in &coefficients[1..] {
        sum = sum.mul(x).add(V::splat(token, c));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::tanh;
    use leg_simd::{Isa, Kernel, Lanes, Simd, dispatch};

    struct Worst;

    impl Kernel for Worst {
        type Output = f64;
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> f64 {
            let mut worst: f64 = 0.0;
            let mut y = [0.0; 8];
            for i in -120_000..=120_000 {
                let x = i as f32 * 1e-4;
                tanh(simd, S::V8::splat(simd, x)).store(&mut y);
                worst = worst.max((f64::from(y[0]) - f64::from(x).tanh()).abs());
            }
            worst
        }
    }

    #[test]
    fn the_approximation_is_within_5e_7_of_tanh() {
        let worst = dispatch(Isa::best(), Worst);
        assert!(worst < 5e-7, "{worst}");
    }
}
