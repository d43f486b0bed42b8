//! The cascade's gains for an actor: a search at each density.

use super::tracking::{SET_POINTS, highest_speed, track};
use super::{DENSITIES, hop, hopper};
use controller::actor::Actor;
use controller::policy::{GainPoint, GainSchedule};
use controller::velocity::Cascade;
use rayon::prelude::*;
use sim_host::plant::Apex;

/// What is tried, each with each. The paper's code integrates; its text names
/// derivative and feed-forward. (A proportional term gained nothing beside them.)
const KI: [f32; 5] = [0.05, 0.1, 0.2, 0.4, 0.7];
const KD: [f32; 2] = [0.0, 0.3];
const FEED_FORWARD: [f32; 4] = [0.0, 0.5, 1.0, 1.5];
const LIMIT_M_S: [f32; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];
/// Of the candidates that track the most, those this near to the fastest are
/// held to be as fast, and the one that follows jumps best is taken.
const AS_FAST: f64 = 0.95;

/// How gains do at one density.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Score {
    falls: usize,
    tracked: usize,
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

fn schedule(gains: GainPoint) -> GainSchedule {
    [gains].into_iter().collect()
}

/// The sum of errors, m/s, while the set-point jumps to and fro; `None` if the
/// leg falls. Set-points that no gait reaches count too: they must do no harm.
fn error_when_switched(actor: &Actor<'_>, gains: &GainSchedule, rho: f64) -> Option<f64> {
    let hopper = hopper(rho);
    let mut cascade = Cascade::new(gains.clone());
    let mut apex = Apex { vx_m_s: 0.0, y_m: 2.0 };
    let mut sum = 0.0;
    for set_point in [0.5, 1.0, -2.0, 0.5, 2.0, -1.0, 1.0, 0.0] {
        for _ in 0..25 {
            let u = cascade.update(set_point, apex.vx_m_s as f32, rho as f32);
            apex = hop(actor, &hopper, rho, apex, u)?;
            sum += (apex.vx_m_s - f64::from(set_point)).abs();
        }
    }
    Some(sum)
}

fn score(actor: &Actor<'_>, gains: GainPoint, rho: f64) -> Score {
    let schedule = schedule(gains);
    let runs = SET_POINTS.map(|v| track(actor, &schedule, rho, v));
    Score {
        falls: runs.iter().filter(|t| t.fell).count()
            + usize::from(error_when_switched(actor, &schedule, rho).is_none()),
        tracked: runs.iter().filter(|t| t.possible() && t.tracked()).count(),
    }
}

fn best_at(actor: &Actor<'_>, rho: f64) -> GainPoint {
    let all: Vec<(GainPoint, Score)> = candidates(rho as f32)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|gains| (gains, score(actor, gains, rho)))
        .collect();
    let rank = |s: &Score| (std::cmp::Reverse(s.falls), s.tracked);
    let highest = all.iter().map(|(_, s)| rank(s)).max();
    let equals: Vec<(GainPoint, f64, f64)> = all
        .into_par_iter()
        .filter(|(_, s)| Some(rank(s)) == highest)
        .map(|(g, _)| {
            let s = schedule(g);
            let error = error_when_switched(actor, &s, rho).unwrap_or(f64::INFINITY);
            (g, error, highest_speed(actor, &s, rho))
        })
        .collect();
    let fastest = equals.iter().map(|&(_, _, speed)| speed).fold(0.0, f64::max);
    let fast = equals.iter().filter(|&&(_, _, speed)| speed >= AS_FAST * fastest);
    let best = fast.min_by(|a, b| a.1.total_cmp(&b.1));
    best.expect("one of the candidates is the fastest").0
}

/// The best gains at every density: those with the fewest falls, of these the ones
/// that track the most set-points, of these the fastest, of these the one that
/// follows jumps of the set-point best.
#[must_use]
pub fn search(actor: &Actor<'_>) -> Vec<GainPoint> {
    DENSITIES.iter().map(|&rho| best_at(actor, rho)).collect()
}
