//! From a training that is over to the policy that it leaves.

use crate::evaluate::gains::search;
use crate::evaluate::selection::Standing;
use crate::policy::{About, Frozen, blob};
use crate::train::Training;
use leg_control::policy::{GainPoint, WriteError};
use leg_process::policy_file::AlignedBytes;

/// The actor that a training kept, with all that its policy file needs.
#[derive(Clone, Debug)]
pub struct Finished {
    frozen: Frozen,
    gains: Vec<GainPoint>,
    preset: String,
    config: String,
    density_ratio: [f32; 2],
    seed: u64,
    steps: u64,
    /// How the selection saw the actor, where there was one.
    pub standing: Option<Standing>,
}

impl Finished {
    /// Takes what `training` kept. Where its configuration has no gains, the search
    /// for them runs here, for seconds, on all threads of the pool it is called in.
    #[must_use]
    pub fn new(training: &Training) -> Self {
        let config = training.config();
        let (frozen, standing) = training.kept();
        let gains =
            if config.gains.is_empty() { search(&frozen.actor()) } else { config.gains.clone() };
        Self {
            frozen,
            gains,
            preset: config.preset.clone(),
            config: config.to_toml(),
            density_ratio: config.density_range(),
            seed: training.seed(),
            steps: standing.map_or(training.total_steps(), |s| s.steps),
            standing,
        }
    }

    /// The policy file.
    ///
    /// # Errors
    /// [`WriteError`] when the controller would refuse it.
    pub fn blob(&self) -> Result<AlignedBytes, WriteError> {
        blob(
            &self.frozen,
            &About {
                name: &self.preset,
                preset: &self.preset,
                seed: self.seed,
                steps: self.steps,
                density_ratio: self.density_ratio,
                config: &self.config,
                gains: &self.gains,
            },
        )
    }
}
