//! Gains for the way from one medium into another.
//!
//! Gains that are best at each density by itself need not be so in between: what the
//! integral has learnt in one medium is wrong in the next. So the feed-forward and the
//! integral gain of each point of a schedule are tried again, on legs that walk out of
//! the water and back in.

use super::gains::{KI, error_when_switched, schedule, score};
use super::tracking::highest_speed;
use super::{hop, hopper};
use leg_control::actor::Actor;
use leg_control::policy::{GainPoint, GainSchedule};
use leg_control::velocity::{Cascade, gains_at};
use leg_plant::Apex;
use rayon::prelude::*;

/// Set-points of the walks, m/s.
const SPEEDS: [f32; 2] = [0.5, 1.0];
/// Hops to settle, which do not count; then from one end to the other; then beyond.
const SETTLING: u32 = 10;
const CROSSING: u32 = 30;
const BEYOND: u32 = 10;
/// What is added to a feed-forward.
const MORE: [f32; 8] = [-1.0, -0.5, -0.25, -0.125, 0.125, 0.25, 0.5, 1.0];
/// Rounds over all points.
const ROUNDS: usize = 2;
/// What jumps of the set-point count beside the walks.
const JUMPS: f64 = 0.2;
/// Share of the highest speed that must be left.
const AS_FAST: f64 = 0.9;

/// The sum of errors, m/s, on the way from density ratio 1 to 0 and back, at each
/// speed; `None` if the leg falls.
fn error_when_crossing(actor: &Actor<'_>, gains: &GainSchedule) -> Option<f64> {
    let walk = |speed: f32, out: bool| {
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
    SPEEDS.iter().try_fold(0.0, |sum, &speed| Some(sum + walk(speed, true)? + walk(speed, false)?))
}

/// The sum that is made small: walks, and jumps at the density of point `at`.
fn error(actor: &Actor<'_>, gains: &[GainPoint], at: usize) -> f64 {
    let rho = f64::from(gains[at].density_ratio);
    let walks = error_when_crossing(actor, &gains.iter().copied().collect());
    let jumps = error_when_switched(actor, &schedule(gains[at]), rho);
    walks.zip(jumps).map_or(f64::INFINITY, |(walks, jumps)| walks + JUMPS * jumps)
}

/// The schedule made better for crossings, without fewer set-points tracked, more falls
/// or much less speed at any of its densities.
pub(super) fn smoothed(
    actor: &Actor<'_>,
    mut gains: Vec<GainPoint>,
    rho: &[f64],
) -> Vec<GainPoint> {
    let before: Vec<_> = gains.iter().zip(rho).map(|(g, &rho)| score(actor, *g, rho)).collect();
    let speed = |g: GainPoint, rho: f64| highest_speed(actor, &schedule(g), rho);
    let fast: Vec<f64> =
        gains.par_iter().zip(rho).map(|(g, &rho)| AS_FAST * speed(*g, rho)).collect();
    for at in (0..ROUNDS).flat_map(|_| (0..rho.len()).rev()) {
        let now = gains[at];
        let forward = MORE.map(|m| GainPoint { feed_forward: now.feed_forward + m, ..now });
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
