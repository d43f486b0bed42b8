//! Taylor polynomials of one step, and their roots: how events are found.

/// Value at `t` of the polynomial whose coefficients rise with the power.
pub(super) fn value(p: &[f64], t: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, &c| sum * t + c)
}

/// Value and slope at `t`.
pub(super) fn value_and_slope(p: &[f64], t: f64) -> (f64, f64) {
    p.iter().rev().fold((0.0, 0.0), |(sum, slope), &c| {
        (sum * t + c, slope * t + sum)
    })
}

/// Sub-intervals that are looked at when a root cannot be excluded at once.
const SAMPLES: usize = 8;

/// Where the polynomial first changes its sign in `(0, end]`.
///
/// A polynomial that starts at exactly 0 has just had its event: that root is divided out.
/// What cannot be excluded by the size of the coefficients is sampled; between samples of
/// one sign a pair of roots is looked for at the extremum, where the slopes betray one.
pub(super) fn first_root(p: &[f64], end: f64) -> Option<f64> {
    let mut p = p;
    while let [0.0, rest @ ..] = p {
        p = rest;
    }
    let (&first, rest) = p.split_first()?;
    let swing = rest.iter().rev().fold(0.0, |sum, &c| (sum + c.abs()) * end);
    if first.abs() > swing {
        return None;
    }
    let step = end / SAMPLES as f64;
    let (mut a, mut at_a) = (0.0, value_and_slope(p, 0.0));
    for i in 1..=SAMPLES {
        let b = if i == SAMPLES { end } else { i as f64 * step };
        let at_b = value_and_slope(p, b);
        if first * at_b.0 <= 0.0 {
            return Some(bracketed_root(|t| value_and_slope(p, t), a, b, first));
        }
        if first * at_a.1 < 0.0 && first * at_b.1 > 0.0 {
            let turn = bracketed_root(|t| slope_and_bend(p, t), a, b, -first);
            if first * value(p, turn) <= 0.0 {
                return Some(bracketed_root(|t| value_and_slope(p, t), a, turn, first));
            }
        }
        (a, at_a) = (b, at_b);
    }
    None
}

/// First and second derivative at `t`.
fn slope_and_bend(p: &[f64], t: f64) -> (f64, f64) {
    let (_, slope, half_bend) = p
        .iter()
        .rev()
        .fold((0.0, 0.0, 0.0), |(sum, slope, half_bend), &c| {
            (sum * t + c, slope * t + sum, half_bend * t + slope)
        });
    (slope, 2.0 * half_bend)
}

/// The root in `[a, b]` of a function that has the sign of `sign_a` at `a` and another at `b`:
/// Newton's method, with bisection where it leaves the bracket.
pub(super) fn bracketed_root(
    f: impl Fn(f64) -> (f64, f64),
    mut a: f64,
    mut b: f64,
    sign_a: f64,
) -> f64 {
    let mut t = 0.5 * (a + b);
    for _ in 0..80 {
        let (value, slope) = f(t);
        if value == 0.0 {
            return t;
        }
        if value * sign_a > 0.0 {
            a = t;
        } else {
            b = t;
        }
        let newton = t - value / slope;
        let next = if newton > a && newton < b {
            newton
        } else {
            0.5 * (a + b)
        };
        if (next - t).abs() <= 4.0 * f64::EPSILON * b.abs() {
            return next;
        }
        t = next;
    }
    t
}

/// The root in `[a, b]` of a continuous function that is above 0 at `a` and not at `b`: false
/// position in the Illinois variant, with a bisection whenever it stalls.
pub(super) fn falling_root(f: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
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
        let t = if round % 8 == 7 || !(secant > a && secant < b) {
            a + 0.5 * width
        } else {
            secant
        };
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

    #[test]
    fn finds_the_first_of_several_roots() {
        // (t - 0.3)(t - 0.35)(t - 0.9)
        let p = [-0.0945, 0.69, -1.55, 1.0];
        assert!((first_root(&p, 1.0).unwrap() - 0.3).abs() < 1e-14);
        // The pair alone changes no sign at any sample of [0, 0.8].
        assert!((first_root(&p, 0.8).unwrap() - 0.3).abs() < 1e-14);
        assert_eq!(first_root(&p, 0.29), None);
    }

    #[test]
    fn a_root_at_the_start_has_been() {
        assert_eq!(first_root(&[0.0, 1.0, 0.1], 5.0), None);
        assert_eq!(first_root(&[0.0, 1.0, -0.5], 5.0), Some(2.0));
        assert_eq!(first_root(&[0.0, 0.0], 5.0), None);
    }

    #[test]
    fn falling_roots_are_found_to_the_last_bits() {
        let root = falling_root(|t| 2.0 - t * t * t, 0.0, 10.0);
        assert!((root - 2f64.cbrt()).abs() < 1e-15);
        assert_eq!(falling_root(|_| -1.0, 0.5, 1.0), 0.5);
    }
}
