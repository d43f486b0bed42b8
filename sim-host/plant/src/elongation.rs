//! The actuator: how the spring's rest length grows.

/// A stretch of time over which the rest length is linear: `length + rate * t`, `t` counted
/// from the start of the stretch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramp {
    pub(super) length_m: f64,
    pub(super) rate_m_s: f64,
}

/// A ramp that leaves its stop this soon has left it. Whoever times a ramp to begin with the
/// touchdown knows that moment only up to rounding, and a foot whose leg is lengthening holds
/// or slips by which of the two comes first.
const SOON_S: f64 = 1e-9;

/// The rest length over time: `rest + clamp(start + rate * t, 0, max)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Elongation {
    pub(super) rest_length_m: f64,
    pub(super) max_m: f64,
    pub(super) start_m: f64,
    pub(super) rate_m_s: f64,
}

impl Elongation {
    /// The linear stretch that begins at `t_s`, and the time of the kink that ends it.
    pub(super) fn ramp(&self, t_s: f64) -> (Ramp, f64) {
        let Self { rest_length_m, max_m, start_m, rate_m_s } = *self;
        let still =
            |elongation_m: f64| Ramp { length_m: rest_length_m + elongation_m, rate_m_s: 0.0 };
        if rate_m_s == 0.0 {
            return (still(start_m.clamp(0.0, max_m)), f64::INFINITY);
        }
        let (low, high) = if rate_m_s > 0.0 { (0.0, max_m) } else { (max_m, 0.0) };
        let leaves_s = (low - start_m) / rate_m_s;
        let stops_s = (high - start_m) / rate_m_s;
        if t_s + SOON_S < leaves_s {
            (still(low), leaves_s)
        } else if t_s < stops_s {
            let elongation_m = (start_m + rate_m_s * t_s).clamp(0.0, max_m);
            let ramp = Ramp { length_m: rest_length_m + elongation_m, rate_m_s };
            (ramp, stops_s)
        } else {
            (still(high), f64::INFINITY)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn has_a_kink_at_either_stop() {
        let elongation =
            Elongation { rest_length_m: 1.0, max_m: 0.25, start_m: -0.5, rate_m_s: 1.0 };
        let (waits, until_s) = elongation.ramp(0.0);
        assert_eq!((waits.length_m, waits.rate_m_s, until_s), (1.0, 0.0, 0.5));
        let (grows, until_s) = elongation.ramp(0.5);
        assert_eq!((grows.length_m, grows.rate_m_s, until_s), (1.0, 1.0, 0.75));
        let (stands, until_s) = elongation.ramp(0.75);
        assert_eq!((stands.length_m, stands.rate_m_s), (1.25, 0.0));
        assert_eq!(until_s, f64::INFINITY);
    }

    #[test]
    fn shrinks_down_to_its_lower_stop() {
        let elongation =
            Elongation { rest_length_m: 1.0, max_m: 0.25, start_m: 0.5, rate_m_s: -1.0 };
        assert_eq!(elongation.ramp(0.0).0.length_m, 1.25);
        assert_eq!(elongation.ramp(0.25).0.rate_m_s, -1.0);
        assert_eq!(elongation.ramp(0.5).0.length_m, 1.0);
    }
}
