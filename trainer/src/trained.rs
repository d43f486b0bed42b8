//! From a completed training to its policy file.

use crate::evaluate::gains::search;
use crate::evaluate::selection::Score;
use crate::policy::{PackedActor, PolicyInfo, blob};
use crate::train::Training;
use leg_control::policy::{GainPoint, WriteError};
use leg_process::policy_file::AlignedBytes;

/// The best actor of a training, with everything that its policy file states.
#[derive(Clone, Debug)]
pub struct TrainedPolicy {
    /// The actor.
    pub actor: PackedActor,
    /// Gains of the velocity cascade, by ascending density ratio.
    pub gains: Vec<GainPoint>,
    preset: String,
    config: String,
    density_ratio: [f32; 2],
    gravity_m_s2: [f32; 2],
    seed: u64,
    steps: u64,
    /// Score of the actor in the selection; `None` where the configuration has none.
    pub score: Option<Score>,
}

impl TrainedPolicy {
    /// Takes the best actor of `training`. Where its configuration has no gains, this
    /// searches them, which takes seconds on all threads of the current pool.
    #[must_use]
    pub fn new(training: &Training) -> Self {
        let config = training.config();
        let (actor, score) = training.best_actor();
        let gains =
            if config.gains.is_empty() { search(&actor.actor()) } else { config.gains.clone() };
        Self {
            actor,
            gains,
            preset: config.preset.clone(),
            config: config.to_toml(),
            density_ratio: config.density_range(),
            gravity_m_s2: config.gravity_range_m_s2(),
            seed: training.seed(),
            steps: score.map_or(training.total_steps(), |s| s.steps),
            score,
        }
    }

    /// Writes the policy blob, named after the preset.
    ///
    /// # Errors
    /// [`WriteError`] when the controller would refuse the blob.
    pub fn blob(&self) -> Result<AlignedBytes, WriteError> {
        blob(
            &self.actor,
            &PolicyInfo {
                name: &self.preset,
                preset: &self.preset,
                seed: self.seed,
                steps: self.steps,
                density_ratio: self.density_ratio,
                gravity_m_s2: self.gravity_m_s2,
                config: &self.config,
                gains: &self.gains,
            },
        )
    }
}
