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
