//! The search for the velocity cascade's gains for an actor, at each density ratio.

use super::DENSITIES;
use super::crossing::refine_for_crossings;
use super::score::{GainScore, KI, error_when_switched, schedule, score};
use super::tracking::highest_speed;
use leg_control::actor::Actor;
use leg_control::policy::GainPoint;
use rayon::prelude::*;

/// Derivative gains and feed-forwards that are tried with every integral gain. The paper's
/// code integrates only; its text names these two. A proportional term beside them gained
/// nothing.
const KD: [f32; 2] = [0.0, 0.3];
const FEED_FORWARD: [f32; 6] = [0.0, 0.5, 1.0, 1.5, 2.5, 4.0];
/// Steps from the best feed-forward that are tried next. The closer the feed-forward is to
/// what a speed needs, the less error the integral carries into the next medium.
const FINER: [f32; 10] = [-0.75, -0.5, -0.375, -0.25, -0.125, 0.125, 0.25, 0.375, 0.5, 0.75];
/// Bounds of the velocity offset that are tried, m/s.
const LIMIT_M_S: [f32; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];
/// Share of the highest speed from which a candidate counts as equally fast. Of those the
/// one with the smallest error after jumps of the set-point is taken.
const AS_FAST: f64 = 0.9;

/// Returns every combination of the gains that are tried first.
fn candidates(density_ratio: f32) -> impl Iterator<Item = GainPoint> {
    KI.into_iter().flat_map(move |ki| {
        KD.into_iter().flat_map(move |kd| {
            FEED_FORWARD.into_iter().flat_map(move |feed_forward| {
                LIMIT_M_S.into_iter().map(move |limit_m_s| GainPoint {
                    density_ratio,
                    kp: 0.0,
                    ki,
                    kd,
                    feed_forward,
                    limit_m_s,
                })
            })
        })
    })
}

/// Gains with everything that ranks them.
#[derive(Clone, Copy, Debug)]
struct Ranked {
    gains: GainPoint,
    score: GainScore,
    error: f64,
    speed: f64,
}

impl Ranked {
    fn new(actor: &Actor<'_>, rho: f64, gains: GainPoint, score: GainScore) -> Self {
        let schedule = schedule(gains);
        Self {
            gains,
            score,
            error: error_when_switched(actor, &schedule, rho).unwrap_or(f64::INFINITY),
            speed: highest_speed(actor, &schedule, rho),
        }
    }
}

/// Returns the best gains at one density ratio.
fn best_at(actor: &Actor<'_>, rho: f64) -> GainPoint {
    let scored = |gains: GainPoint| (gains, score(actor, gains, rho));
    let all: Vec<(GainPoint, GainScore)> =
        candidates(rho as f32).collect::<Vec<_>>().into_par_iter().map(scored).collect();
    let highest = all.iter().map(|(_, s)| s.rank()).max();
    let equals: Vec<Ranked> = all
        .into_par_iter()
        .filter(|(_, s)| Some(s.rank()) == highest)
        .map(|(gains, score)| Ranked::new(actor, rho, gains, score))
        .collect();
    let fastest = equals.iter().map(|r| r.speed).fold(0.0, f64::max);
    let fast_enough = |r: &Ranked| r.speed >= AS_FAST * fastest;
    let steadier = |a: &Ranked, b: &Ranked| a.error.total_cmp(&b.error);
    let coarse = equals.into_iter().filter(fast_enough).min_by(steadier);
    let coarse = coarse.expect("one of the candidates is the fastest");
    let finer: Vec<Ranked> = FINER
        .into_par_iter()
        .map(|more| GainPoint { feed_forward: coarse.gains.feed_forward + more, ..coarse.gains })
        .map(scored)
        .filter(|(_, s)| s.rank() >= coarse.score.rank())
        .map(|(gains, score)| Ranked::new(actor, rho, gains, score))
        .collect();
    let finer = finer.into_iter().filter(fast_enough);
    finer.chain([coarse]).min_by(steadier).expect("at least the coarse one").gains
}

/// Searches the best gains at every density ratio.
///
/// At each density ratio the search takes the gains with the fewest falls, of these the
/// ones that track the most set-points, of these the fastest, and of these the one with the
/// smallest error after jumps of the set-point. It then refines their feed-forward. At the
/// end it refines the whole schedule for the way from one medium into another. The search
/// takes seconds on all threads of the current pool; its result does not depend on them.
#[must_use]
pub fn search(actor: &Actor<'_>) -> Vec<GainPoint> {
    let each = DENSITIES.iter().map(|&rho| best_at(actor, rho)).collect();
    refine_for_crossings(actor, each, &DENSITIES)
}
