//! The cascade's gains for an actor: a search at each density.

use super::crossing::smoothed;
use super::tracking::{SET_POINTS, highest_speed, possible, track};
use super::{DENSITIES, hop, hopper};
use leg_control::actor::Actor;
use leg_control::policy::{GainPoint, GainSchedule};
use leg_control::velocity::{Cascade, gains_at};
use leg_plant::Apex;
use rayon::prelude::*;

/// What is tried, each with each. The paper's code integrates; its text names
/// derivative and feed-forward. (A proportional term gained nothing beside them.)
pub(super) const KI: [f32; 5] = [0.05, 0.1, 0.2, 0.4, 0.7];
const KD: [f32; 2] = [0.0, 0.3];
const FEED_FORWARD: [f32; 6] = [0.0, 0.5, 1.0, 1.5, 2.5, 4.0];
/// What is then added to the best feed-forward: the nearer it comes to what a speed
/// takes, the less is left for the integral to find out, and to carry into a medium
/// where it is no longer so.
const FINER: [f32; 10] = [-0.75, -0.5, -0.375, -0.25, -0.125, 0.125, 0.25, 0.375, 0.5, 0.75];
const LIMIT_M_S: [f32; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];
/// Of the candidates that track the most, those this near to the fastest are
/// held to be as fast, and the one that follows jumps best is taken.
const AS_FAST: f64 = 0.9;

/// How gains do at one density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Score {
    falls: usize,
    tracked: usize,
}

impl Score {
    /// The higher, the better: first of all no falls.
    pub(super) fn rank(self) -> (std::cmp::Reverse<usize>, usize) {
        (std::cmp::Reverse(self.falls), self.tracked)
    }
}

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

pub(super) fn schedule(gains: GainPoint) -> GainSchedule {
    [gains].into_iter().collect()
}

/// The sum of errors, m/s, while the set-point jumps to and fro; `None` if the
/// leg falls. Set-points that no gait reaches count by what they leave behind.
pub(super) fn error_when_switched(
    actor: &Actor<'_>,
    gains: &GainSchedule,
    rho: f64,
) -> Option<f64> {
    let hopper = hopper(rho);
    let mut cascade = Cascade::new();
    let mut apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
    let mut sum = 0.0;
    for set_point in [0.5, 1.0, -2.0, 0.5, 2.0, -1.0, 1.0, 0.0] {
        let counts = possible(rho, f64::from(set_point));
        for _ in 0..25 {
            let u = cascade.update(&gains_at(gains, rho as f32), set_point, apex.vx_m_s as f32);
            apex = hop(actor, &hopper, rho, apex, u)?;
            if counts {
                sum += (apex.vx_m_s - f64::from(set_point)).abs();
            }
        }
    }
    Some(sum)
}

pub(super) fn score(actor: &Actor<'_>, gains: GainPoint, rho: f64) -> Score {
    let schedule = schedule(gains);
    let runs = SET_POINTS.map(|v| track(actor, &schedule, rho, v));
    Score {
        falls: runs.iter().filter(|t| t.fell).count()
            + usize::from(error_when_switched(actor, &schedule, rho).is_none()),
        tracked: runs.iter().filter(|t| t.possible() && t.tracked()).count(),
    }
}

/// Gains with all that they are ranked by.
#[derive(Clone, Copy, Debug)]
struct Ranked {
    gains: GainPoint,
    score: Score,
    error: f64,
    speed: f64,
}

impl Ranked {
    fn new(actor: &Actor<'_>, rho: f64, gains: GainPoint, score: Score) -> Self {
        let schedule = schedule(gains);
        Self {
            gains,
            score,
            error: error_when_switched(actor, &schedule, rho).unwrap_or(f64::INFINITY),
            speed: highest_speed(actor, &schedule, rho),
        }
    }
}

fn best_at(actor: &Actor<'_>, rho: f64) -> GainPoint {
    let scored = |gains: GainPoint| (gains, score(actor, gains, rho));
    let all: Vec<(GainPoint, Score)> =
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

/// The best gains at every density: those with the fewest falls, of these the ones
/// that track the most set-points, of these the fastest, of these the one that
/// follows jumps of the set-point best, its feed-forward then made finer; and then
/// all together for the way from one medium into another.
#[must_use]
pub fn search(actor: &Actor<'_>) -> Vec<GainPoint> {
    let each = DENSITIES.iter().map(|&rho| best_at(actor, rho)).collect();
    smoothed(actor, each, &DENSITIES)
}
