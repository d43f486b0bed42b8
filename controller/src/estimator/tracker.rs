//! When an apex has passed, once a hop, however noisy the velocity is.

/// Vertical velocity, m/s, and standard deviations, squared, beyond both of which the leg
/// rises or falls for certain.
const CERTAIN_M_S: f32 = 0.02;
const CERTAIN: f32 = 3.0 * 3.0;
/// Standard deviations below 0, squared, at which the apex counts as passed.
const PASSED: f32 = 1.0;

/// Where in a hop the leg is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hop {
    /// The apex is ahead.
    Rising,
    /// The apex has passed, perhaps only just.
    Passed,
    /// The leg falls for certain, or stands.
    Falling,
}

/// Finds the apexes.
#[derive(Clone, Copy, Debug)]
pub(super) struct ApexTracker(Hop);

impl ApexTracker {
    /// Returns a tracker of a leg that starts in flight: its apex is where it starts, or
    /// ahead.
    pub(super) fn new() -> Self {
        Self(Hop::Rising)
    }

    /// Takes the vertical velocity, m/s, with its variance, and whether the foot is on the
    /// ground where that has changed; returns whether an apex has passed.
    ///
    /// It has when the velocity is below 0 by its standard deviation, or at touchdown. The
    /// next one can only come after a lift-off or, in stance and where no contact is sensed,
    /// after a velocity that was certainly downwards and then certainly upwards: noise alone
    /// gives no second apex.
    pub(super) fn update(&mut self, [vy_m_s, variance]: [f32; 2], contact: Option<bool>) -> bool {
        let square = vy_m_s * vy_m_s;
        let is_certain = vy_m_s.abs() > CERTAIN_M_S && square > CERTAIN * variance;
        let is_falling = vy_m_s < 0.0 && square > PASSED * variance;
        let lands = contact == Some(true);
        let passed = self.0 == Hop::Rising && (is_falling || lands);
        self.0 = match self.0 {
            _ if contact == Some(false) => Hop::Rising,
            _ if lands || (is_certain && vy_m_s < 0.0) => Hop::Falling,
            Hop::Rising if passed => Hop::Passed,
            Hop::Falling if is_certain => Hop::Rising,
            hop => hop,
        };
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::random::Random;

    /// Returns how many apexes pass in 4.7 s, of which there are five, where the velocity is known
    /// up to this deviation.
    fn apexes(deviation: f32, contact_is_sensed: bool) -> u32 {
        let mut random = Random::new();
        let mut tracker = ApexTracker::new();
        let mut apexes = 0;
        for tick in 0..4_700_u32 {
            // From an apex: 0.45 s of fall, 0.1 s of stance, 0.45 s of rise.
            let t = 1e-3 * f32::from((tick % 1_000) as u16);
            let vy = if t < 0.45 {
                -9.0 * t
            } else if t < 0.55 {
                -4.05 + 81.0 * (t - 0.45)
            } else {
                9.0 * (1.0 - t)
            };
            let edge = match tick % 1_000 {
                450 => Some(true),
                550 => Some(false),
                _ => None,
            };
            let contact = edge.filter(|_| contact_is_sensed);
            let seen = vy + deviation * random.normal();
            apexes += u32::from(tracker.update([seen, deviation * deviation], contact));
        }
        apexes
    }

    #[test]
    fn passes_one_apex_a_hop_under_any_noise() {
        for deviation in [0.0, 0.01, 0.1, 0.5] {
            assert_eq!(apexes(deviation, true), 5, "{deviation} m/s");
            assert_eq!(apexes(deviation, false), 5, "{deviation} m/s, no contact sensed");
        }
    }

    #[test]
    fn an_apex_that_noise_hides_passes_at_touchdown() {
        let mut tracker = ApexTracker::new();
        assert!(!tracker.update([-1.0, 4.0], None));
        assert!(tracker.update([-1.0, 4.0], Some(true)));
        assert!(!tracker.update([-3.0, 1.0], None));
    }
}
