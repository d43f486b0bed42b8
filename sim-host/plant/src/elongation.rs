//! The actuator: the spring's rest length over time.

/// A rest length that is linear in time: `length_m + rate_m_s * t`, with `t` in seconds from
/// the instant for which the ramp was computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ramp {
    pub(crate) length_m: f64,
    pub(crate) rate_m_s: f64,
}

/// Tolerance on the instant at which a ramp leaves its end stop. A caller that starts a ramp at
/// touchdown knows that instant only up to rounding. Without the tolerance the rounding would
/// decide whether the leg already lengthens at touchdown, and so whether the foot holds.
const START_TOLERANCE_S: f64 = 1e-9;

/// The rest length over time: `rest_length_m + clamp(start_m + rate_m_s * t, 0, max_m)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elongation {
    pub(crate) rest_length_m: f64,
    pub(crate) max_m: f64,
    pub(crate) start_m: f64,
    pub(crate) rate_m_s: f64,
}

impl Elongation {
    /// Returns the ramp that holds from `t_s` on, and the time of the corner that ends it
    /// (infinity if none does).
    pub(crate) fn ramp(&self, t_s: f64) -> (Ramp, f64) {
        let Self { rest_length_m, max_m, start_m, rate_m_s } = *self;
        let constant =
            |elongation_m: f64| Ramp { length_m: rest_length_m + elongation_m, rate_m_s: 0.0 };
        if rate_m_s == 0.0 {
            return (constant(start_m.clamp(0.0, max_m)), f64::INFINITY);
        }
        let (first_stop_m, last_stop_m) = if rate_m_s > 0.0 { (0.0, max_m) } else { (max_m, 0.0) };
        let starts_s = (first_stop_m - start_m) / rate_m_s;
        let ends_s = (last_stop_m - start_m) / rate_m_s;
        if t_s + START_TOLERANCE_S < starts_s {
            (constant(first_stop_m), starts_s)
        } else if t_s < ends_s {
            let elongation_m = (start_m + rate_m_s * t_s).clamp(0.0, max_m);
            let ramp = Ramp { length_m: rest_length_m + elongation_m, rate_m_s };
            (ramp, ends_s)
        } else {
            (constant(last_stop_m), f64::INFINITY)
        }
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
