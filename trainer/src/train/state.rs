//! The state of a training between two episodes, from which it can be resumed.

use super::Training;
use crate::evaluate::selection::{Selector, SelectorState};
use crate::explore::NoiseState;
use crate::failed_starts::FailedStarts;
use crate::{config::Config, explore::Noise};
use leg_ddpg::AgentState;
use leg_ddpg::{Replay, ReplayState};
use leg_simd::Isa;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// All of a [`Training`] that does not follow from its configuration and its seed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainingState {
    agent: AgentState,
    replay: ReplayState,
    noise: NoiseState,
    failed_starts: FailedStarts,
    environment_rng: Pcg64,
    noise_rng: Pcg64,
    batch_rng: Pcg64,
    selector: Option<SelectorState>,
    stage: usize,
    steps: u64,
    episodes: u64,
    total_steps: u64,
    total_episodes: u64,
    total_updates: u64,
}

/// A state that does not fit the configuration. The text names the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its state does not fit its configuration ({0})")]
pub struct StateError(&'static str);

impl Training {
    /// Returns the state between two episodes.
    #[must_use]
    pub fn state(&self) -> TrainingState {
        TrainingState {
            agent: self.agent.state(),
            replay: self.replay.state(),
            noise: self.noise.state(),
            failed_starts: self.failed_starts.clone(),
            environment_rng: self.environment_rng.clone(),
            noise_rng: self.noise_rng.clone(),
            batch_rng: self.batch_rng.clone(),
            selector: self.selector.as_ref().map(Selector::state),
            stage: self.stage,
            steps: self.steps,
            episodes: self.episodes,
            total_steps: self.total_steps,
            total_episodes: self.total_episodes,
            total_updates: self.total_updates,
        }
    }

    /// Resumes a training. All that follows has the same bits as without the interruption.
    ///
    /// # Errors
    /// [`StateError`] when the state is not one of a training with this configuration.
    pub fn from_state(
        config: Config,
        seed: u64,
        isa: Isa,
        state: TrainingState,
    ) -> Result<Self, StateError> {
        let mut training = Self::new(config, seed, isa);
        let config = &training.config;
        if state.stage > config.stages.len() {
            return Err(StateError("stage"));
        }
        if !training.agent.restore(&state.agent) {
            return Err(StateError("networks"));
        }
        match (&mut training.selector, &state.selector) {
            (None, None) => {}
            (Some(selector), Some(there)) => {
                let like =
                    crate::policy::PackedActor::trained(config, &training.agent.actor(false));
                if !selector.restore(there, &like) {
                    return Err(StateError("best actor"));
                }
            }
            _ => return Err(StateError("selection")),
        }
        training.replay = Replay::from_state(config.learning.replay_capacity, &state.replay)
            .ok_or(StateError("replay buffer"))?;
        training.noise = Noise::from_state(&config.exploration, state.noise);
        Ok(Self {
            failed_starts: state.failed_starts,
            environment_rng: state.environment_rng,
            noise_rng: state.noise_rng,
            batch_rng: state.batch_rng,
            stage: state.stage,
            steps: state.steps,
            episodes: state.episodes,
            total_steps: state.total_steps,
            total_episodes: state.total_episodes,
            total_updates: state.total_updates,
            ..training
        })
    }
}
