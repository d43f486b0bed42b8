//! Tracking of a set-point under the velocity cascade, and the highest speed.

use super::{DENSITIES, act, hop, hopper};
use leg_control::actor::Actor;
use leg_control::policy::GainSchedule;
use leg_control::velocity::{Cascade, gains_at};
use leg_plant::{Apex, Hopper};
use rayon::prelude::*;
use serde::Serialize;

/// Set-points of every evaluation, m/s.
pub const SET_POINTS: [f64; 6] = [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];
/// Number of hops of a tracking run.
const HOPS: usize = 100;
/// Number of hops at the end of a run that are judged.
const JUDGED: usize = 20;
/// First apex of every run.
pub const START: Apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
/// Largest error of the mean of a tracked set-point, relative to it.
const MOST_ERROR: f64 = 0.02;
/// Largest oscillation around a tracked set-point, relative to it.
const MOST_OSCILLATION: f64 = 0.05;
/// Number of hops at each target of the ramp.
const RAMP_HOPS: usize = 10;
/// Step from one target of the ramp to the next, m/s.
const RAMP_STEP_M_S: f64 = 0.05;
/// Last target of the ramp, m/s.
pub const RAMP_CAP_M_S: f64 = 30.0;
/// The ramp also ends where the target is this far above the best speed, m/s: the velocity
/// offset is then at its bound and the leg gets no faster.
pub const RAMP_LAG_LIMIT_M_S: f64 = 10.0;

/// Highest speed of a steady gait with every apex at or above 1 m, by density ratio, m/s.
/// These are lower bounds, from a search over touchdown angle and elongation speed for
/// period-1 gaits of the plant, without any agent.
pub const STEADY_GAIT_M_S: [(f64, f64); 8] = [
    (0.0, 16.0),
    (0.05, 6.7),
    (0.1, 5.1),
    (0.3, 3.1),
    (0.5, 2.3),
    (0.7, 1.75),
    (0.9, 1.25),
    (1.0, 1.0),
];

/// Whether a steady gait of this speed is known at a density ratio of the table.
#[must_use]
pub fn possible(rho: f64, set_point: f64) -> bool {
    STEADY_GAIT_M_S.iter().any(|&(known, limit)| known == rho && set_point.abs() <= limit)
}

/// How one set-point is tracked at one density ratio.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// Density ratio.
    pub rho: f64,
    /// Set-point, m/s.
    pub set_point: f64,
    /// Mean apex velocity over the last 20 of 100 hops, m/s; `None` after a fall.
    pub mean_v: Option<f64>,
    /// Half the range of the apex velocity over the same hops, m/s; `None` after a fall.
    pub oscillation: Option<f64>,
    /// Coefficient of friction that the ground must have over the same hops, the largest
    /// horizontal over vertical force on the foot; `None` after a fall or where nobody asked.
    pub friction: Option<f64>,
    /// Whether the leg fell: there was no next apex.
    pub fell: bool,
}

impl Tracking {
    /// Whether a steady gait of this speed is known.
    #[must_use]
    pub fn possible(&self) -> bool {
        possible(self.rho, self.set_point)
    }

    /// Whether mean and oscillation are within 2 % and 5 % of the set-point.
    #[must_use]
    pub fn tracked(&self) -> bool {
        let limit = self.set_point.abs();
        let mean = self.mean_v.map(|v| (v - self.set_point).abs() <= MOST_ERROR * limit);
        let oscillation = self.oscillation.map(|o| o <= MOST_OSCILLATION * limit);
        mean == Some(true) && oscillation == Some(true)
    }
}

/// Runs one set-point at one density ratio.
#[must_use]
pub fn track(actor: &Actor<'_>, gains: &GainSchedule, rho: f64, set_point: f64) -> Tracking {
    let hopper = hopper(rho);
    let mut cascade = Cascade::new();
    let mut apex = START;
    let mut judged = Vec::with_capacity(JUDGED);
    let mut friction: f64 = 0.0;
    for done in 1..=HOPS {
        let u = cascade.update(&gains_at(gains, rho as f32), set_point as f32, apex.vx_m_s as f32);
        let action = act(actor, rho, apex, u);
        let Some(next) = hopper.hop(apex, action).outcome.next() else {
            let (mean_v, oscillation, friction) = (None, None, None);
            return Tracking { rho, set_point, mean_v, oscillation, friction, fell: true };
        };
        if done > HOPS - JUDGED {
            friction =
                hopper.friction(apex, action).map_or(friction, |needed| friction.max(needed));
            judged.push(next.vx_m_s);
        }
        apex = next;
    }
    let lowest = judged.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = judged.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Tracking {
        rho,
        set_point,
        mean_v: Some(judged.iter().sum::<f64>() / JUDGED as f64),
        oscillation: Some((highest - lowest) / 2.0),
        friction: Some(friction),
        fell: false,
    }
}

/// Runs every set-point at every density ratio.
#[must_use]
pub fn tracking_table(actor: &Actor<'_>, gains: &GainSchedule) -> Vec<Tracking> {
    let pairs: Vec<(f64, f64)> =
        DENSITIES.iter().flat_map(|&rho| SET_POINTS.map(|v| (rho, v))).collect();
    pairs.into_par_iter().map(|(rho, v)| track(actor, gains, rho, v)).collect()
}

/// Returns the highest speed, m/s. The target rises by 0.05 m/s every 10 hops until the leg
/// falls, reaches [`RAMP_CAP_M_S`], or lags [`RAMP_LAG_LIMIT_M_S`] behind. The highest mean
/// over the 10 hops of a target counts, but not above the target.
#[must_use]
pub fn highest_speed(actor: &Actor<'_>, gains: &GainSchedule, rho: f64) -> f64 {
    highest_speed_of(actor, gains, rho, &hopper(rho))
}

/// Returns the [`highest_speed`] with another plant.
#[must_use]
pub fn highest_speed_of(actor: &Actor<'_>, gains: &GainSchedule, rho: f64, hopper: &Hopper) -> f64 {
    let mut cascade = Cascade::new();
    let mut apex = START;
    let mut best: f64 = 0.0;
    let stages = (RAMP_CAP_M_S / RAMP_STEP_M_S) as usize;
    for target in (1..=stages).map(|i| i as f64 * RAMP_STEP_M_S) {
        let mut sum = 0.0;
        for _ in 0..RAMP_HOPS {
            let u = cascade.update(&gains_at(gains, rho as f32), target as f32, apex.vx_m_s as f32);
            let Some(next) = hop(actor, hopper, rho, apex, u) else { return best };
            apex = next;
            sum += apex.vx_m_s;
        }
        let mean = sum / RAMP_HOPS as f64;
        // An overshoot is not a speed that the cascade controls.
        best = best.max(mean.min(target));
        if target - best > RAMP_LAG_LIMIT_M_S {
            break;
        }
    }
    best
}

/// Returns every density ratio of [`DENSITIES`] with its [`highest_speed`].
#[must_use]
pub fn highest_speeds(actor: &Actor<'_>, gains: &GainSchedule) -> Vec<(f64, f64)> {
    DENSITIES.par_iter().map(|&rho| (rho, highest_speed(actor, gains, rho))).collect()
}

#[cfg(test)]
mod tests {
    use super::{SET_POINTS, STEADY_GAIT_M_S, Tracking};
    use crate::evaluate::DENSITIES;

    fn at(rho: f64, set_point: f64, mean_v: f64, oscillation: f64) -> Tracking {
        let (mean_v, oscillation) = (Some(mean_v), Some(oscillation));
        Tracking { rho, set_point, mean_v, oscillation, friction: Some(0.3), fell: false }
    }

    #[test]
    fn a_steady_gait_is_known_for_forty_two_set_points() {
        let all = DENSITIES.iter().flat_map(|&rho| SET_POINTS.map(|v| at(rho, v, v, 0.0)));
        assert_eq!(all.filter(Tracking::possible).count(), 42);
        assert_eq!(STEADY_GAIT_M_S.map(|(rho, _)| rho), DENSITIES);
    }

    #[test]
    fn tracked_means_within_two_percent_and_oscillating_by_at_most_five() {
        assert!(at(0.0, -2.0, -2.0399, 0.0999).tracked());
        assert!(!at(0.0, -2.0, -2.041, 0.0).tracked());
        assert!(!at(0.0, -2.0, -2.0, 0.101).tracked());
        let fell =
            Tracking { mean_v: None, oscillation: None, fell: true, ..at(0.0, 1.0, 1.0, 0.0) };
        assert!(!fell.tracked());
    }
}
