//! The actuator: the spring's rest length over time.

use crate::real::{Mask, Real};

/// A rest length that is linear in time: `length_m + rate_m_s * t`, with `t` in seconds from
/// the instant for which the ramp was computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ramp<L = f64> {
    pub(crate) length_m: L,
    pub(crate) rate_m_s: L,
}

/// Tolerance on the instant at which a ramp leaves its end stop. A caller that starts a ramp at
/// touchdown knows that instant only up to rounding. Without the tolerance the rounding would
/// decide whether the leg already lengthens at touchdown, and so whether the foot holds.
const START_TOLERANCE_S: f64 = 1e-9;

/// The rest length over time: `rest_length_m + clamp(start_m + rate_m_s * t, 0, max_m)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elongation<L = f64> {
    pub(crate) rest_length_m: L,
    pub(crate) max_m: L,
    pub(crate) start_m: L,
    pub(crate) rate_m_s: L,
}

impl<L: Real> Elongation<L> {
    /// Returns the ramp that holds from `t_s` on, and the time of the corner that ends it
    /// (infinity if none does).
    #[inline(always)]
    pub(crate) fn ramp(&self, t_s: L) -> (Ramp<L>, L) {
        let Self { rest_length_m, max_m, start_m, rate_m_s } = *self;
        let (zero, never) = (t_s.splat(0.0), t_s.splat(f64::INFINITY));
        let still = rate_m_s.eq(zero);
        let held = Ramp { length_m: rest_length_m + start_m.clamp(zero, max_m), rate_m_s: zero };
        if !(!still).any() {
            return (held, never);
        }
        let grows = zero.lt(rate_m_s);
        let first_stop_m = L::select(grows, zero, max_m);
        let last_stop_m = L::select(grows, max_m, zero);
        let starts_s = (first_stop_m - start_m) / rate_m_s;
        let ends_s = (last_stop_m - start_m) / rate_m_s;
        let waits = !still & (t_s + t_s.splat(START_TOLERANCE_S)).lt(starts_s);
        let moves = !still & !waits & t_s.lt(ends_s);
        let elongation_m = (start_m + rate_m_s * t_s).clamp(zero, max_m);
        let stop_m = L::select(waits, first_stop_m, last_stop_m);
        let length_m = rest_length_m + L::select(moves, elongation_m, stop_m);
        let ramp = Ramp {
            length_m: L::select(still, held.length_m, length_m),
            rate_m_s: L::select(moves, rate_m_s, zero),
        };
        let until_s = L::select(moves, ends_s, never);
        (ramp, L::select(waits, starts_s, until_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn has_a_corner_at_each_end_stop() {
        let elongation =
            Elongation { rest_length_m: 1.0, max_m: 0.25, start_m: -0.5, rate_m_s: 1.0 };
        let (waiting, until_s) = elongation.ramp(0.0);
        assert_eq!((waiting.length_m, waiting.rate_m_s, until_s), (1.0, 0.0, 0.5));
        let (growing, until_s) = elongation.ramp(0.5);
        assert_eq!((growing.length_m, growing.rate_m_s, until_s), (1.0, 1.0, 0.75));
        let (stopped, until_s) = elongation.ramp(0.75);
        assert_eq!((stopped.length_m, stopped.rate_m_s), (1.25, 0.0));
        assert_eq!(until_s, f64::INFINITY);
    }

    #[test]
    fn shrinks_down_to_the_lower_end_stop() {
        let elongation =
            Elongation { rest_length_m: 1.0, max_m: 0.25, start_m: 0.5, rate_m_s: -1.0 };
        assert_eq!(elongation.ramp(0.0).0.length_m, 1.25);
        assert_eq!(elongation.ramp(0.25).0.rate_m_s, -1.0);
        assert_eq!(elongation.ramp(0.5).0.length_m, 1.0);
    }
}
