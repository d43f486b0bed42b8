//! Root finding: the instant at which an event happens.

use crate::real::{Mask, Real};

/// Value and slope of a function at one argument.
pub(crate) type ValueSlope<L = f64> = (L, L);

/// A smooth function, whose value and slope can be evaluated at any argument.
pub(crate) trait Curve<L> {
    /// Evaluates the function.
    fn at(&mut self, t: L) -> ValueSlope<L>;
}

/// What the ends of a smooth function show of its first change of sign in `(0, width]`.
///
/// A function that is exactly 0 at the start has just had its event, so its slope gives the sign
/// to leave. Two crossings leave equal signs at both ends; they are found if the slopes at the
/// ends show an extremum in between.
#[derive(Clone, Copy)]
pub(crate) struct Crossing<L: Real> {
    sign: L,
    start: ValueSlope<L>,
    end: ValueSlope<L>,
    width: L,
    /// The lanes in which the signs at the ends differ.
    crosses: L::Mask,
    /// The lanes in which the function may cross twice.
    dips: L::Mask,
}

impl<L: Real> Crossing<L> {
    /// Looks for a crossing in the lanes `among`; `start` and `end` are value and slope at 0 and
    /// at `width`.
    #[inline(always)]
    pub(crate) fn between(
        among: L::Mask,
        start: ValueSlope<L>,
        end: ValueSlope<L>,
        width: L,
    ) -> Self {
        let zero = width.splat(0.0);
        let sign = L::select(start.0.eq(zero), start.1, start.0);
        let (start, end) = (positive_first(start, sign), positive_first(end, sign));
        let among = among & !sign.eq(zero);
        let crosses = among & end.0.le(zero);
        // Falling at the start and rising at the end: the minimum is about where the tangents meet.
        let mut dips = among & !end.0.le(zero) & start.1.lt(zero) & zero.lt(end.1);
        if dips.any() {
            let meet = (end.0 - start.0 - end.1 * width) / (start.1 - end.1);
            dips = dips & !zero.lt(start.0 + start.1 * meet);
        }
        Self { sign, start, end, width, crosses, dips }
    }

    /// Returns the lanes in which [`Self::first`] may find a crossing.
    #[inline(always)]
    pub(crate) fn likely(&self) -> L::Mask {
        self.crosses | self.dips
    }

    /// Returns the values of `yes` where the mask is true, else those of `no`.
    #[inline(always)]
    pub(crate) fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            sign: L::select(mask, yes.sign, no.sign),
            start: select(mask, yes.start, no.start),
            end: select(mask, yes.end, no.end),
            width: L::select(mask, yes.width, no.width),
            crosses: (mask & yes.crosses) | (!mask & no.crosses),
            dips: (mask & yes.dips) | (!mask & no.dips),
        }
    }

    /// Returns the first argument at which the function changes its sign, and the lanes in which
    /// there is one. The last evaluation of `curve` is close to the root.
    #[inline(always)]
    pub(crate) fn first(&self, curve: &mut impl Curve<L>) -> (L::Mask, L) {
        let Self { sign, start, end, width, crosses, dips } = *self;
        let zero = width.splat(0.0);
        let half = width.splat(0.5);
        let (mut found, mut a, mut b, mut estimate) = (crosses, zero, width, width);
        if dips.any() {
            let mut searched = dips;
            for _ in 0..50 {
                let t = half * (a + b);
                let (value, slope) = positive_first(curve.at(t), sign);
                let below = searched & value.le(zero);
                let falls = slope.lt(zero);
                found = found | below;
                b = L::select(below | (searched & !falls), t, b);
                estimate = L::select(below, half * (a + t), estimate);
                searched = searched & !below;
                a = L::select(searched & falls, t, a);
                if !searched.any() {
                    break;
                }
            }
            if !found.any() {
                return (found, width);
            }
        }
        if crosses.any() {
            estimate = L::select(crosses, cubic_estimate(start, end, width), estimate);
        }
        (found, refine(found, sign, curve, a, b, estimate))
    }
}

// These are functions because a closure need not be inlined.
#[inline(always)]
pub(crate) fn select<L: Real>(
    mask: L::Mask,
    yes: ValueSlope<L>,
    no: ValueSlope<L>,
) -> ValueSlope<L> {
    (L::select(mask, yes.0, no.0), L::select(mask, yes.1, no.1))
}

/// Turns the sign of a function so that it is above 0 at the start, where it has the sign of
/// `sign`.
#[inline(always)]
fn positive_first<L: Real>((value, slope): ValueSlope<L>, sign: L) -> ValueSlope<L> {
    (value.copysign(value * sign), slope * sign.signum())
}

/// Estimates the root by the cubic through both ends.
#[inline(always)]
fn cubic_estimate<L: Real>(start: ValueSlope<L>, end: ValueSlope<L>, width: L) -> L {
    let (two, three) = (width.splat(2.0), width.splat(3.0));
    let (d0, d1) = (start.1 * width, end.1 * width);
    let rise = end.0 - start.0;
    let (square, cube) = (three * rise - two * d0 - d1, d0 + d1 - two * rise);
    let left = start.0.eq(width.splat(0.0));
    let mut part = L::select(left, width.splat(0.75), -start.0 / rise);
    for _ in 0..3 {
        let value = ((cube * part + square) * part + d0) * part + start.0;
        let slope = (three * cube * part + two * square) * part + d0;
        part = part - value / slope;
    }
    part * width
}

/// Returns the root in `[a, b]` of a function that is above 0 just after `a` and not at `b`, by
/// Newton's method with bisection where a step leaves the bracket. Only the lanes `among` count.
#[inline(always)]
fn refine<L: Real>(
    among: L::Mask,
    sign: L,
    curve: &mut impl Curve<L>,
    mut a: L,
    mut b: L,
    estimate: L,
) -> L {
    let zero = estimate.splat(0.0);
    let accuracy = estimate.splat(1e-9) * (b - a);
    let (mut searched, mut t, mut root) = (among, estimate, estimate);
    for _ in 0..100 {
        let within = a.lt(t) & t.lt(b);
        t = L::select(searched & !within, t.splat(0.5) * (a + b), t);
        // A lane that has found its root evaluates once more where it did last.
        let (value, slope) = positive_first(curve.at(t), sign);
        let above = zero.lt(value);
        a = L::select(above, t, a);
        b = L::select(above, b, t);
        let step = value / slope;
        let narrow = (b - a).le(t.splat(2.0 * f64::EPSILON) * b);
        // The next error is about the square of this step.
        let found = searched & (step.abs().le(accuracy) | narrow);
        root = L::select(found, (t - step).clamp(a, b), root);
        searched = searched & !found;
        if !searched.any() {
            return root;
        }
        t = L::select(searched, t - step, t);
    }
    L::select(searched, t, root)
}

/// Returns the root in `[a, b]` of a continuous function that is above 0 at `a` and not at `b`,
/// by false position (Illinois variant) with a bisection every eighth round.
pub(crate) fn falling_root(f: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    let (mut at_a, mut at_b) = (f(a), f(b));
    if at_a <= 0.0 {
        return a;
    }
    for round in 0..200 {
        let width = b - a;
        if at_b == 0.0 || width <= 2.0 * f64::EPSILON * b.abs() {
            break;
        }
        let secant = b - at_b * width / (at_b - at_a);
        let t =
            if round % 8 == 7 || !(secant > a && secant < b) { a + 0.5 * width } else { secant };
        if t <= a || t >= b {
            break;
        }
        let at_t = f(t);
        if at_t > 0.0 {
            (a, at_a) = (t, at_t);
            at_b *= 0.5;
        } else {
            (b, at_b) = (t, at_t);
            at_a *= 0.5;
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::{Crossing, Curve, ValueSlope, falling_root};

    /// (t - 0.3)(t - 0.35)(t - 0.9)
    fn cubic(t: f64) -> ValueSlope {
        (((t - 1.55) * t + 0.69) * t - 0.0945, (3.0 * t - 3.1) * t + 0.69)
    }

    impl<F: FnMut(f64) -> ValueSlope> Curve<f64> for F {
        fn at(&mut self, t: f64) -> ValueSlope {
            self(t)
        }
    }

    fn first_crossing(
        start: ValueSlope,
        end: ValueSlope,
        width: f64,
        mut curve: impl FnMut(f64) -> ValueSlope,
    ) -> Option<f64> {
        let crossing = Crossing::between(true, start, end, width);
        if !crossing.likely() {
            return None;
        }
        let (found, t) = crossing.first(&mut curve);
        found.then_some(t)
    }

    fn first_of_cubic(width: f64) -> Option<f64> {
        first_crossing(cubic(0.0), cubic(width), width, cubic)
    }

    #[test]
    fn finds_the_first_of_several_roots() {
        assert!((first_of_cubic(0.32).unwrap() - 0.3).abs() < 1e-14);
        // The signs at both ends are equal here.
        assert!((first_of_cubic(0.4).unwrap() - 0.3).abs() < 1e-14);
        assert_eq!(first_of_cubic(0.29), None);
    }

    #[test]
    fn ignores_a_root_at_the_start() {
        let hump = |t: f64| (t - 0.5 * t * t, 1.0 - t);
        let root = first_crossing(hump(0.0), hump(5.0), 5.0, hump).unwrap();
        assert!((root - 2.0).abs() < 1e-14);
        assert_eq!(first_crossing(hump(0.0), hump(1.9), 1.9, hump), None);
        assert_eq!(first_crossing((0.0, 0.0), (0.0, 0.0), 1.0, |_| (0.0, 0.0)), None);
    }

    #[test]
    fn finds_a_falling_root_to_the_last_bits() {
        let root = falling_root(|t| 2.0 - t * t * t, 0.0, 10.0);
        assert!((root - 2f64.cbrt()).abs() < 1e-15);
        assert_eq!(falling_root(|_| -1.0, 0.5, 1.0), 0.5);
    }
}
