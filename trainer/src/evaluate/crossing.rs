//! Refinement of a gain schedule for the way from one medium into another.
//!
//! Gains that are best at each density ratio alone need not be best in between, because the
//! integral of one medium is wrong in the next. So this module tries the feed-forward and
//! the integral gain of each point of a schedule again, with a leg that hops out of the
//! water and back in.

use super::score::{KI, error_when_switched, schedule, score};
use super::tracking::highest_speed;
use super::{hop, hopper};
use leg_control::actor::Actor;
use leg_control::policy::{GainPoint, GainSchedule};
use leg_control::velocity::{Cascade, gains_at};
use leg_plant::Apex;
use rayon::prelude::*;

/// Set-points of the crossings, m/s.
const SPEEDS: [f32; 2] = [0.5, 1.0];
/// Hops to settle, whose errors do not count.
const SETTLING: u32 = 10;
/// Hops from one medium to the other.
const CROSSING: u32 = 30;
/// Hops after the crossing.
const BEYOND: u32 = 10;
/// Steps from a feed-forward that are tried.
const FEED_FORWARD_STEPS: [f32; 8] = [-1.0, -0.5, -0.25, -0.125, 0.125, 0.25, 0.5, 1.0];
/// Rounds over all points.
const ROUNDS: usize = 2;
/// Weight of the jumps of the set-point beside the crossings.
const JUMP_WEIGHT: f64 = 0.2;
/// Share of the highest speed that every point must still reach.
const LEAST_SPEED: f64 = 0.9;

/// Returns the sum of the velocity errors on the way from density ratio 1 to 0 and back, at
/// each set-point, m/s; `None` if the leg falls.
fn error_when_crossing(actor: &Actor<'_>, gains: &GainSchedule) -> Option<f64> {
    let crossing = |speed: f32, out: bool| {
        let mut cascade = Cascade::new();
        let mut apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
        let mut sum = 0.0;
        for done in 0..SETTLING + CROSSING + BEYOND {
            let way = f64::from(done.saturating_sub(SETTLING).min(CROSSING)) / f64::from(CROSSING);
            let rho = if out { 1.0 - way } else { way };
            let u = cascade.update(&gains_at(gains, rho as f32), speed, apex.vx_m_s as f32);
            apex = hop(actor, &hopper(rho), rho, apex, u)?;
            if done >= SETTLING {
                sum += (apex.vx_m_s - f64::from(speed)).abs();
            }
        }
        Some(sum)
    };
    SPEEDS
        .iter()
        .try_fold(0.0, |sum, &speed| Some(sum + crossing(speed, true)? + crossing(speed, false)?))
}

/// Returns the error that is minimised: crossings, and jumps at the density of point `at`.
fn error(actor: &Actor<'_>, gains: &[GainPoint], at: usize) -> f64 {
    let rho = f64::from(gains[at].density_ratio);
    let crossings = error_when_crossing(actor, &gains.iter().copied().collect());
    let jumps = error_when_switched(actor, &schedule(gains[at]), rho);
    crossings.zip(jumps).map_or(f64::INFINITY, |(crossings, jumps)| crossings + JUMP_WEIGHT * jumps)
}

/// Refines a schedule for crossings. No point may lose a tracked set-point, gain a fall or
/// fall below [`LEAST_SPEED`] of its highest speed.
pub(super) fn refine_for_crossings(
    actor: &Actor<'_>,
    mut gains: Vec<GainPoint>,
    rho: &[f64],
) -> Vec<GainPoint> {
    let before: Vec<_> = gains.iter().zip(rho).map(|(g, &rho)| score(actor, *g, rho)).collect();
    let speed = |g: GainPoint, rho: f64| highest_speed(actor, &schedule(g), rho);
    let fast: Vec<f64> =
        gains.par_iter().zip(rho).map(|(g, &rho)| LEAST_SPEED * speed(*g, rho)).collect();
    for at in (0..ROUNDS).flat_map(|_| (0..rho.len()).rev()) {
        let now = gains[at];
        let forward =
            FEED_FORWARD_STEPS.map(|m| GainPoint { feed_forward: now.feed_forward + m, ..now });
        let integral = KI.map(|ki| GainPoint { ki, ..now });
        let tried: Vec<(f64, GainPoint)> = forward
            .into_iter()
            .chain(integral)
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|candidate| {
                let mut all = gains.clone();
                all[at] = candidate;
                (error(actor, &all, at), candidate)
            })
            .collect();
        let mut least = error(actor, &gains, at);
        for (e, candidate) in tried {
            if e < least
                && score(actor, candidate, rho[at]).rank() >= before[at].rank()
                && speed(candidate, rho[at]) >= fast[at]
            {
                least = e;
                gains[at] = candidate;
            }
        }
    }
    gains
}
