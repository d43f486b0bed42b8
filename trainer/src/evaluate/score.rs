//! The score of cascade gains at one density ratio.

use super::tracking::{SET_POINTS, possible, track};
use super::{hop, hopper};
use leg_control::actor::Actor;
use leg_control::policy::{GainPoint, GainSchedule};
use leg_control::velocity::{Cascade, gains_at};
use leg_plant::Apex;

/// Integral gains that the searches try.
pub(super) const KI: [f32; 5] = [0.05, 0.1, 0.2, 0.4, 0.7];
/// Set-points of [`error_when_switched`], m/s.
const JUMPS_M_S: [f32; 8] = [0.5, 1.0, -2.0, 0.5, 2.0, -1.0, 1.0, 0.0];
/// Hops at each of them.
const HOPS: u32 = 25;

/// The score of gains at one density ratio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GainScore {
    falls: usize,
    tracked: usize,
}

impl GainScore {
    /// Returns a key that is higher for better gains: fewer falls first, then more
    /// set-points tracked.
    pub(super) fn rank(self) -> (std::cmp::Reverse<usize>, usize) {
        (std::cmp::Reverse(self.falls), self.tracked)
    }
}

/// Returns a schedule with the same gains at every density ratio.
pub(super) fn schedule(gains: GainPoint) -> GainSchedule {
    [gains].into_iter().collect()
}

/// Returns the sum of the velocity errors while the set-point jumps, m/s; `None` if the
/// leg falls. Set-points without a known gait do not count, but their effect on the next
/// set-point does.
pub(super) fn error_when_switched(
    actor: &Actor<'_>,
    gains: &GainSchedule,
    rho: f64,
) -> Option<f64> {
    let hopper = hopper(rho);
    let mut cascade = Cascade::new();
    let mut apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
    let mut sum = 0.0;
    for set_point in JUMPS_M_S {
        let counts = possible(rho, f64::from(set_point));
        for _ in 0..HOPS {
            let u = cascade.update(&gains_at(gains, rho as f32), set_point, apex.vx_m_s as f32);
            apex = hop(actor, &hopper, rho, apex, u)?;
            if counts {
                sum += (apex.vx_m_s - f64::from(set_point)).abs();
            }
        }
    }
    Some(sum)
}

/// Scores gains at one density ratio, over all set-points and their jumps.
pub(super) fn score(actor: &Actor<'_>, gains: GainPoint, rho: f64) -> GainScore {
    let schedule = schedule(gains);
    let runs = SET_POINTS.map(|v| track(actor, &schedule, rho, v));
    GainScore {
        falls: runs.iter().filter(|t| t.fell).count()
            + usize::from(error_when_switched(actor, &schedule, rho).is_none()),
        tracked: runs.iter().filter(|t| t.possible() && t.tracked()).count(),
    }
}
