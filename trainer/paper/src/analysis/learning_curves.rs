//! Learning curves of many seeds, for figures 3 and 4.

use crate::agents::{Episode, PaperAgent, TrainedAgent};
use crate::reference::Reference;
use crate::{FigureContext, FiguresError};
use trainer::evaluate::survival::quantile;

/// Number of episodes that a point of a curve is the mean of.
pub(crate) const WINDOW: usize = 200;

/// The episodes of the paper's three cases: one list for each seed.
pub(crate) struct Cases {
    /// The transferred agent's stage in water.
    pub(crate) water: Vec<Vec<Episode>>,
    /// The agent that is trained on land only.
    pub(crate) air: Vec<Vec<Episode>>,
    /// The transferred agent's stage on land.
    pub(crate) after_water: Vec<Vec<Episode>>,
}

impl Cases {
    pub(crate) fn of(ctx: &FigureContext) -> Result<Self, FiguresError> {
        let stage = |all: &[TrainedAgent], stage: usize| -> Vec<Vec<Episode>> {
            all.iter().map(|agent| agent.stages[stage].episodes.clone()).collect()
        };
        let transferred = ctx.trainings(PaperAgent::WaterToAir)?;
        Ok(Self {
            water: stage(&transferred, 0),
            after_water: stage(&transferred, 1),
            air: stage(&ctx.trainings(PaperAgent::Air)?, 0),
        })
    }
}

/// Reads the authors' training of a case on land, if their data was found.
pub(crate) fn authors(
    reference: Option<&Reference>,
    agent: &str,
) -> Result<Option<Vec<Episode>>, FiguresError> {
    reference.map(|reference| reference.learning(agent)).transpose()
}

/// Returns the mean reward of some episodes.
pub(crate) fn mean_reward(episodes: &[Episode]) -> f64 {
    episodes.iter().map(|e| e.reward).sum::<f64>() / episodes.len().max(1) as f64
}

/// Returns the share of episodes with at least `full` steps.
pub(crate) fn full_share(episodes: &[Episode], full: u32) -> f64 {
    episodes.iter().filter(|e| e.steps >= full).count() as f64 / episodes.len().max(1) as f64
}

/// Returns the mean reward of every whole window: the episode at its end, and the mean.
pub(crate) fn smooth(episodes: &[Episode]) -> Vec<(f64, f64)> {
    let windows = episodes.chunks_exact(WINDOW).enumerate();
    windows.map(|(i, window)| (((i + 1) * WINDOW) as f64, mean_reward(window))).collect()
}

/// Returns the quartiles over seeds at each point: place, and lower quartile, median,
/// upper quartile.
pub(crate) fn spread(curves: &[Vec<(f64, f64)>]) -> Vec<(f64, [f64; 3])> {
    let points = curves.iter().map(Vec::len).min().unwrap_or(0);
    (0..points)
        .map(|i| {
            let mut values: Vec<f64> = curves.iter().map(|curve| curve[i].1).collect();
            (curves[0][i].0, quartiles(&mut values))
        })
        .collect()
}

/// Returns lower quartile, median and upper quartile; NaN without values.
pub(crate) fn quartiles(values: &mut [f64]) -> [f64; 3] {
    values.sort_unstable_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|share| quantile(values, share).unwrap_or(f64::NAN))
}
