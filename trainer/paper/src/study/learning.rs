//! Learning curves of many seeds: what figures 3 and 4 share.

use crate::agents::{Episode, Learnt, Paper};
use crate::reference::Reference;
use crate::{FiguresError, Workshop};
use trainer::evaluate::survival::quantile;

/// Episodes that a curve is a mean over, as drawn.
pub(crate) const WINDOW: usize = 200;

/// The paper's three cases, over all seeds.
pub(crate) struct Cases {
    /// Of the transferred agent, the stage in water.
    pub(crate) water: Vec<Vec<Episode>>,
    /// On land alone.
    pub(crate) air: Vec<Vec<Episode>>,
    /// The transferred agent on land.
    pub(crate) after_water: Vec<Vec<Episode>>,
}

impl Cases {
    pub(crate) fn of(shop: &Workshop) -> Result<Self, FiguresError> {
        let stage = |all: &[Learnt], stage: usize| -> Vec<Vec<Episode>> {
            all.iter().map(|learnt| learnt.stages[stage].episodes.clone()).collect()
        };
        let transferred = shop.trainings(Paper::WaterToAir)?;
        Ok(Self {
            water: stage(&transferred, 0),
            after_water: stage(&transferred, 1),
            air: stage(&shop.trainings(Paper::Air)?, 0),
        })
    }
}

/// The authors' run of a case on land, where it is at hand.
pub(crate) fn authors(
    reference: Option<&Reference>,
    agent: &str,
) -> Result<Option<Vec<Episode>>, FiguresError> {
    let Some(reference) = reference else { return Ok(None) };
    let episodes = reference.learning(agent)?;
    let ours = episodes.iter().map(|e| Episode { reward: e.reward, steps: e.steps });
    Ok(Some(ours.collect()))
}

/// Mean reward over some episodes.
pub(crate) fn mean_reward(episodes: &[Episode]) -> f64 {
    episodes.iter().map(|e| e.reward).sum::<f64>() / episodes.len().max(1) as f64
}

/// Share of some episodes that were full.
pub(crate) fn full_share(episodes: &[Episode], full: u32) -> f64 {
    episodes.iter().filter(|e| e.steps >= full).count() as f64 / episodes.len().max(1) as f64
}

/// Mean reward over every whole window: episode at its end, mean.
pub(crate) fn smooth(episodes: &[Episode]) -> Vec<(f64, f64)> {
    let windows = episodes.chunks_exact(WINDOW).enumerate();
    windows.map(|(i, window)| (((i + 1) * WINDOW) as f64, mean_reward(window))).collect()
}

/// Over seeds: place, lower quartile, median, upper quartile.
pub(crate) fn spread(curves: &[Vec<(f64, f64)>]) -> Vec<(f64, [f64; 3])> {
    let points = curves.iter().map(Vec::len).min().unwrap_or(0);
    (0..points)
        .map(|i| {
            let mut values: Vec<f64> = curves.iter().map(|curve| curve[i].1).collect();
            (curves[0][i].0, quartiles(&mut values))
        })
        .collect()
}

/// Lower quartile, median, upper quartile.
pub(crate) fn quartiles(values: &mut [f64]) -> [f64; 3] {
    values.sort_unstable_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|share| quantile(values, share).unwrap_or(f64::NAN))
}
