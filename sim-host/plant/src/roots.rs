//! Root finding: the instant at which an event happens.

/// Value and slope of a function at one argument.
pub(crate) type ValueSlope = (f64, f64);

/// Returns the first argument in `(0, width]` at which a smooth function changes its sign;
/// `start` and `end` are value and slope at 0 and at `width`.
///
/// A function that is exactly 0 at the start has just had its event, so its slope gives the sign
/// to leave. Two crossings leave equal signs at both ends; they are found if the slopes at the
/// ends show an extremum in between.
pub(crate) fn first_crossing(
    start: ValueSlope,
    end: ValueSlope,
    width: f64,
    mut f: impl FnMut(f64) -> ValueSlope,
) -> Option<f64> {
    let sign = if start.0 == 0.0 { start.1 } else { start.0 };
    if sign == 0.0 {
        return None;
    }
    let positive_first =
        |(value, slope): ValueSlope| (value.copysign(value * sign), slope * sign.signum());
    let (start, end) = (positive_first(start), positive_first(end));
    if end.0 <= 0.0 {
        let estimate = cubic_estimate(start, end, width);
        return Some(refine(|t| positive_first(f(t)), 0.0, width, estimate));
    }
    // Falling at the start and rising at the end: the minimum is about where the tangents meet.
    if start.1 < 0.0 && end.1 > 0.0 {
        let meet = (end.0 - start.0 - end.1 * width) / (start.1 - end.1);
        if start.0 + start.1 * meet > 0.0 {
            return None;
        }
        let (mut a, mut b) = (0.0, width);
        for _ in 0..50 {
            let t = 0.5 * (a + b);
            let (value, slope) = positive_first(f(t));
            if value <= 0.0 {
                return Some(refine(|t| positive_first(f(t)), a, t, 0.5 * (a + t)));
            }
            if slope < 0.0 {
                a = t;
            } else {
                b = t;
            }
        }
    }
    None
}

/// Estimates the root by the cubic through both ends.
fn cubic_estimate(start: ValueSlope, end: ValueSlope, width: f64) -> f64 {
    let (d0, d1) = (start.1 * width, end.1 * width);
    let rise = end.0 - start.0;
    let (square, cube) = (3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise);
    let mut part = if start.0 == 0.0 { 0.75 } else { -start.0 / rise };
    for _ in 0..3 {
        let value = ((cube * part + square) * part + d0) * part + start.0;
        let slope = (3.0 * cube * part + 2.0 * square) * part + d0;
        part -= value / slope;
    }
    part * width
}

/// Returns the root in `[a, b]` of a function that is above 0 just after `a` and not at `b`, by
/// Newton's method with bisection where a step leaves the bracket.
fn refine(mut f: impl FnMut(f64) -> ValueSlope, mut a: f64, mut b: f64, estimate: f64) -> f64 {
    let accuracy = 1e-9 * (b - a);
    let mut t = estimate;
    for _ in 0..100 {
        if !(t > a && t < b) {
            t = 0.5 * (a + b);
        }
        let (value, slope) = f(t);
        if value > 0.0 {
            a = t;
        } else {
            b = t;
        }
        let step = value / slope;
        // The next error is about the square of this step.
        if step.abs() <= accuracy || b - a <= 2.0 * f64::EPSILON * b {
            return (t - step).clamp(a, b);
        }
        t -= step;
    }
    t
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
    use super::*;

    /// (t - 0.3)(t - 0.35)(t - 0.9)
    fn cubic(t: f64) -> ValueSlope {
        (((t - 1.55) * t + 0.69) * t - 0.0945, (3.0 * t - 3.1) * t + 0.69)
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
