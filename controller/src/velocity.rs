//! The outer loop of the cascade: a PID on the apex velocity, once an apex.
//!
//! The frozen actor brings the leg to a hop on the spot. Given `vx - u` in place of `vx`,
//! it brings the leg to the velocity `u` instead, up to its own steady-state error. This
//! loop finds the `u` for which the leg travels at the set-point (after section 2.2 of "Learning to stop", whose code
//! integrates and whose text asks for the other terms).
//!
//! ```text
//! e = set-point - vx
//! u = clamp(ff * set-point + kp * e + I - kd * (vx - vx of the last apex), -limit, limit)
//! I += ki * e, unless that drives u further out of its limit
//! ```
//!
//! Gains are interpolated linearly over density. The derivative acts on the
//! measurement, so that a step of the set-point gives no kick. The integral is
//! kept as an offset in m/s, so that a change of gains gives no bump.

use crate::policy::GainPoint;

/// The velocity loop and its memory. Velocities in m/s.
#[derive(Clone, Debug, Default)]
pub struct Cascade {
    integral_m_s: f32,
    last_vx_m_s: Option<f32>,
}

impl Cascade {
    /// Returns a loop with integral 0 and no last velocity.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Resets integral and derivative.
    pub fn reset(&mut self) {
        self.integral_m_s = 0.0;
        self.last_vx_m_s = None;
    }

    /// Updates the loop after an apex with velocity `vx_m_s`, under these gains ([`gains_at`]
    /// returns those of a medium); returns the offset `u`, m/s, to subtract from the
    /// observed velocity. Its magnitude is at most [`GainPoint::limit_m_s`].
    pub fn update(&mut self, gains: &GainPoint, set_point_m_s: f32, vx_m_s: f32) -> f32 {
        let limit = gains.limit_m_s;
        let error = set_point_m_s - vx_m_s;
        let slope = self.last_vx_m_s.map_or(0.0, |last| vx_m_s - last);
        self.last_vx_m_s = Some(vx_m_s);

        let direct = gains.feed_forward * set_point_m_s + gains.kp * error - gains.kd * slope;
        let before = self.integral_m_s;
        let wanted = direct + before + gains.ki * error;
        let winds_up = (wanted > limit && error > 0.0) || (wanted < -limit && error < 0.0);
        if !winds_up {
            self.integral_m_s = before + gains.ki * error;
        }
        clamp(direct + self.integral_m_s, limit)
    }
}

/// Returns a schedule's gains at a density: linear between points, held beyond the ends.
#[must_use]
pub fn gains_at(schedule: &[GainPoint], density_ratio: f32) -> GainPoint {
    let (Some(&first), Some(&last)) = (schedule.first(), schedule.last()) else {
        return GainPoint::default();
    };
    if density_ratio >= last.density_ratio {
        return last;
    }
    let below_and_above = schedule
        .iter()
        .zip(schedule.iter().skip(1))
        .find(|(a, b)| a.density_ratio <= density_ratio && density_ratio < b.density_ratio);
    let Some((a, b)) = below_and_above else {
        return first;
    };
    let part = (density_ratio - a.density_ratio) / (b.density_ratio - a.density_ratio);
    let mix = |from: f32, to: f32| from + (to - from) * part;
    GainPoint {
        density_ratio,
        kp: mix(a.kp, b.kp),
        ki: mix(a.ki, b.ki),
        kd: mix(a.kd, b.kd),
        feed_forward: mix(a.feed_forward, b.feed_forward),
        limit_m_s: mix(a.limit_m_s, b.limit_m_s),
    }
}

fn clamp(x: f32, limit: f32) -> f32 {
    if x > limit {
        limit
    } else if x >= -limit {
        x
    } else {
        -limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WATER: GainPoint = GainPoint {
        density_ratio: 1.0,
        kp: 0.1,
        ki: 0.7,
        kd: 0.3,
        feed_forward: 1.0,
        limit_m_s: 4.0,
    };
    const LAND: GainPoint = GainPoint {
        density_ratio: 0.0,
        kp: 0.0,
        ki: 0.2,
        kd: 0.0,
        feed_forward: 0.5,
        limit_m_s: 1.0,
    };

    #[test]
    fn gains_are_interpolated_and_held_beyond_the_ends() {
        let s = [LAND, WATER];
        assert_eq!(gains_at(&s, -0.1), LAND);
        assert_eq!(gains_at(&s, 1.2), WATER);
        let middle = gains_at(&s, 0.5);
        assert!((middle.ki - 0.45).abs() < 1e-6 && (middle.limit_m_s - 2.5).abs() < 1e-6);
    }

    #[test]
    fn each_term_does_its_part() {
        // What comes of set-points and velocities, one after the other.
        let offsets = |gains: GainPoint, apexes: [(f32, f32); 2]| {
            let gains = GainPoint { limit_m_s: 10.0, ..gains };
            let mut cascade = Cascade::new();
            apexes.map(|(set_point, vx)| cascade.update(&gains, set_point, vx))
        };
        let zero = GainPoint::default();
        let steady = [(1.0, 0.0); 2];
        assert_eq!(offsets(GainPoint { kp: 0.5, ..zero }, steady), [0.5, 0.5]);
        assert_eq!(offsets(GainPoint { ki: 0.25, ..zero }, steady), [0.25, 0.5]);
        let faster = [(0.0, 1.0), (5.0, 2.0)];
        assert_eq!(offsets(GainPoint { kd: 0.5, ..zero }, faster), [0.0, -0.5]);
        let ahead = [(1.5, 9.0), (0.5, 9.0)];
        assert_eq!(offsets(GainPoint { feed_forward: 2.0, ..zero }, ahead), [3.0, 1.0]);
    }

    #[test]
    fn the_integral_does_not_wind_up_behind_the_limit() {
        let mut cascade = Cascade::new();
        for _ in 0..1000 {
            assert_eq!(cascade.update(&LAND, 2.0, 0.0), 1.0);
        }
        // One apex too fast is enough to leave the limit again.
        assert!(cascade.update(&LAND, 0.0, 1.0) < 1.0);
    }

    proptest! {
        #[test]
        fn the_offset_is_always_bounded(
            steps in prop::collection::vec((-5.0_f32..5.0, -20.0_f32..20.0, 0.0_f32..1.0), 1..60)
        ) {
            let mut cascade = Cascade::new();
            for (set_point, vx, rho) in steps {
                let gains = gains_at(&[LAND, WATER], rho);
                let u = cascade.update(&gains, set_point, vx);
                prop_assert!(u.abs() <= gains.limit_m_s);
            }
        }
    }
}
