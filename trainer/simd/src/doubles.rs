//! Vectors of `f64` with comparisons, for code with masks instead of branches.

use super::{Lanes, Pair, halves};

/// The results of a comparison, one a lane.
pub trait Mask: Copy {
    /// Returns the lanes that are true in both.
    #[must_use]
    fn and(self, other: Self) -> Self;
    /// Returns the lanes that are true in either.
    #[must_use]
    fn or(self, other: Self) -> Self;
    /// Returns the lanes that are false.
    #[must_use]
    fn not(self) -> Self;
    /// Number of lanes.
    const LANES: usize;
    /// Returns the lanes as bits, the first lane in the lowest.
    fn bits(self) -> u32;
}

/// A vector of `f64`.
///
/// Comparisons with NaN are false.
pub trait Doubles: Lanes<Number = f64> {
    /// The type of comparisons.
    type Mask: Mask;
    /// Returns the token of the vector.
    fn token(self) -> Self::Token;
    /// Returns the magnitude of `self` with the sign of `sign`.
    #[must_use]
    fn copysign(self, sign: Self) -> Self;
    /// Returns `-self`.
    #[must_use]
    fn neg(self) -> Self;
    /// Returns the larger number as [`f64::max`] does: of a NaN and a number, the number.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Returns the smaller number as [`f64::min`] does: of a NaN and a number, the number.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// Returns `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// Returns `self <= other`.
    fn le(self, other: Self) -> Self::Mask;
    /// Returns `self == other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// Returns `yes` where the mask is true, else `no`.
    #[must_use]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

impl<A: Mask, B: Mask> Mask for Pair<A, B> {
    const LANES: usize = A::LANES + B::LANES;

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(self.0.and(other.0), self.1.and(other.1))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(self.0.or(other.0), self.1.or(other.1))
    }
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.not(), self.1.not())
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits() | (self.1.bits() << A::LANES)
    }
}

/// Defines comparisons of both halves.
macro_rules! comparisons {
    ($($name:ident)*) => {$(
        #[inline(always)]
        fn $name(self, other: Self) -> Self::Mask {
            Pair(self.0.$name(other.0), self.1.$name(other.1))
        }
    )*};
}

impl<A: Doubles, B: Doubles<Token = A::Token>> Doubles for Pair<A, B> {
    type Mask = Pair<A::Mask, B::Mask>;

    #[inline(always)]
    fn token(self) -> Self::Token {
        self.0.token()
    }
    halves! {
        copysign(other);
        neg();
        max(other);
        min(other);
    }
    comparisons! { lt le eq }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(A::select(mask.0, yes.0, no.0), B::select(mask.1, yes.1, no.1))
    }
}

#[cfg(test)]
mod tests {
    use super::{Doubles, Mask};
    use crate::{Isa, Kernel, Pair, Simd, dispatch};

    /// Every operation on pairs of numbers: a list of the results, as bits, for each.
    struct Everything<'a>(&'a [f64]);

    type Results = [Vec<u64>; 16];

    impl Everything<'_> {
        #[inline(always)]
        fn of<V: Doubles>(&self, token: V::Token, results: &mut Results) {
            let mut lanes = [0.0; 16];
            for (a, b) in self.0.chunks_exact(16).zip(self.0[5..].chunks_exact(16)) {
                for from in (0..16).step_by(V::LANES) {
                    let (x, y) = (V::load(token, &a[from..]), V::load(token, &b[from..]));
                    let zero = V::splat(x.token(), 0.0);
                    let [lt, le, eq] = [x.lt(y), x.le(y), x.eq(y)];
                    let vectors = [
                        x.add(y),
                        x.sub(y),
                        x.mul(y),
                        x.div(y),
                        x.sqrt(),
                        x.copysign(y),
                        x.neg(),
                        // Of two zeros either is the larger.
                        x.max(y).add(zero),
                        x.min(y).add(zero),
                        V::select(lt, x, y),
                        V::splat(x.token(), a[3]),
                    ];
                    for (result, vector) in results.iter_mut().zip(vectors) {
                        vector.store(&mut lanes);
                        // The sign of a NaN depends on the order of the operands.
                        let bits = |x: &f64| if x.is_nan() { u64::MAX } else { x.to_bits() };
                        result.extend(lanes[..V::LANES].iter().map(bits));
                    }
                    let masks = [lt, le, eq, lt.or(eq), le.and(eq.not())];
                    for (result, mask) in results[11..].iter_mut().zip(masks) {
                        let bits = u64::from(mask.bits());
                        result.extend((0..V::LANES).map(|lane| bits >> lane & 1));
                    }
                }
            }
        }
    }

    impl Kernel for Everything<'_> {
        type Output = [Results; 2];
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> [Results; 2] {
            let mut all = [Results::default(), Results::default()];
            self.of::<S::Doubles>(simd, &mut all[0]);
            self.of::<Pair<S::Doubles, S::Doubles>>(simd, &mut all[1]);
            all
        }
    }

    #[test]
    fn every_instruction_set_gives_the_bits_of_plain_numbers() {
        let special = [0.0, -0.0, 1.0, -1.0, 5e-324, f64::MAX, f64::INFINITY, f64::NAN, -2.5];
        // Every pair, and some numbers between them.
        let numbers: Vec<f64> = (0..1600_u32)
            .map(|i| {
                if i % 3 == 0 {
                    f64::from(i) * 0.37 - 250.0
                } else {
                    special[i as usize % 7 + i as usize % 3]
                }
            })
            .collect();
        let [single, double] = dispatch(Isa::Baseline, Everything(&numbers));
        assert_eq!(single, double);
        let plain: [fn(f64, f64) -> f64; 10] = [
            |x, y| x + y,
            |x, y| x - y,
            |x, y| x * y,
            |x, y| x / y,
            |x, _| x.sqrt(),
            f64::copysign,
            |x, _| -x,
            |x, y| x.max(y) + 0.0,
            |x, y| x.min(y) + 0.0,
            |x, y| if x < y { x } else { y },
        ];
        for (found, of) in single.iter().zip(plain) {
            for (i, bits) in found.iter().enumerate() {
                let expected = of(numbers[i], numbers[i + 5]);
                assert_eq!(f64::from_bits(*bits).is_nan(), expected.is_nan());
                assert!(expected.is_nan() || expected.to_bits() == *bits);
            }
        }
        for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
            for results in dispatch(isa, Everything(&numbers)) {
                assert_eq!(results, single, "{isa:?}");
            }
        }
    }
}
