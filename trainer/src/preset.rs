//! The named configurations of trainings.
//!
//! The paper's are those of "Learning to stop: a unifying principle for legged locomotion in
//! varying environments". Parameters that its text leaves open are taken from its data (doi
//! 10.5281/zenodo.4607469) where these show them.

use crate::config::{
    Config, Distribution, Episode, Exploration, InitialWeights, Learning, Length, MediumDraw,
    Network, Randomisation, Reward, Selection, Stage, Tolerance,
};
use leg_control::policy::GainPoint;
use leg_ddpg::Critic;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_3, PI};

/// A named configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Preset {
    /// The paper's agent, in water.
    Water,
    /// The paper's agent, on land.
    Air,
    /// The paper's transfer: in water first, then on land.
    WaterToAir,
    /// The paper's universal controller: water and air in turn.
    Universal,
    /// One actor for every density ratio; the shipped policy's preset.
    Robust,
    /// An experiment: `robust` in randomised bodies and on slippery ground.
    Field,
}

/// Lowest action of the leg: touchdown angle in rad, elongation speed in m/s.
pub const ACTION_LOW: [f32; 2] = [PI / 10.0, 0.0];
/// Highest action of the leg: touchdown angle in rad, elongation speed in m/s.
pub const ACTION_HIGH: [f32; 2] = [PI / 1.2, 2.0];

impl Preset {
    /// Returns the configuration of the preset.
    #[must_use]
    pub fn config(self) -> Config {
        let water = stage(MediumDraw::Water, 3_000);
        let land = stage(MediumDraw::Land, 5_000);
        match self {
            Self::Water => paper("water", 5, vec![water]),
            Self::Air => paper("air", 5, vec![land]),
            Self::WaterToAir => paper("water-to-air", 5, vec![water, land]),
            Self::Universal => paper("universal", 10, vec![stage(MediumDraw::WaterAndAir, 10_000)]),
            Self::Robust => robust(),
            Self::Field => field(),
        }
    }
}

fn stage(medium: MediumDraw, episodes: u64) -> Stage {
    Stage { medium, length: Length::Episodes(episodes) }
}

fn paper(name: &str, max_steps: u32, stages: Vec<Stage>) -> Config {
    Config {
        preset: name.into(),
        network: Network {
            critic: Critic::ActionAtSecondLayer,
            initial_weights: InitialWeights::Glorot,
            actor_last_layer: 1.0,
            symmetric_actor: false,
            observation_offset: [0.0; 3],
            observation_scale: [1.0; 3],
            action_offset: [0.0; 2],
            action_scale: [1.0; 2],
            // The published actors have the same gain for both outputs.
            output_gain: [PI / 1.2; 2],
            output_bound: f32::INFINITY,
            action_low: ACTION_LOW,
            action_high: ACTION_HIGH,
        },
        learning: Learning {
            batch: 32,
            // The published code has 0.6, the text 0.5.
            discount: 0.6,
            target_smoothing: 1e-3,
            actor_learning_rate: 1e-3,
            critic_learning_rate: 1e-2,
            final_learning_rate: 1.0,
            max_gradient_norm: 10.0,
            replay_capacity: 1_000_000,
            random_steps: 0,
            steps_per_update: 1,
            mirror: false,
            actor_averaging: 0.0,
        },
        // Three other readings of the paper do not reproduce the early advantage of its
        // transfer: noise carried over between episodes, 0.6 as a variance, and clipped actions
        // in the replay buffer. In the last case many seeds learn nothing, because the actor
        // has no offset and starts with its angle on the bound.
        exploration: Exploration::OrnsteinUhlenbeck {
            attraction: 0.15,
            deviation: 0.6,
            decay: 1e-3,
            keep_unclipped: true,
        },
        reward: Reward {
            cap: f64::INFINITY,
            elongation: 0.0,
            height: 0.0,
            height_m: 1.8,
            fall: 0.0,
            // The data reward a last apex below 1 m, the text does not.
            low_is_fall: false,
        },
        episode: Episode {
            max_steps,
            spread: 3.0,
            low_share: 0.0,
            uniform_share: 0.0,
            retry_share: 0.0,
            led_share: [0.0; 2],
            led_from: [0.65, 0.85],
            lead_m_s: 0.0,
            tolerance: Tolerance::Training,
        },
        stages,
        selection: Selection { evaluations: 0, starts: 0, tracking: 0.0 },
        randomisation: None,
        // The published code has an integral gain only.
        gains: vec![GainPoint {
            density_ratio: 0.0,
            kp: 0.0,
            ki: 0.05,
            kd: 0.0,
            feed_forward: 1.0,
            limit_m_s: 10.0,
        }],
    }
}

fn robust() -> Config {
    let mut config = paper("robust", 20, Vec::new());
    config.network = Network {
        critic: Critic::Joint100,
        initial_weights: InitialWeights::FanIn,
        actor_last_layer: 0.1,
        // The mirror image of a hop is a hop. A symmetric actor stops at exactly zero speed, and
        // learns both directions from the steps of one.
        symmetric_actor: true,
        observation_offset: [0.0, 2.5, 0.5],
        observation_scale: [1.0 / 3.0, 0.4, 2.0],
        action_offset: [FRAC_PI_2, 1.0],
        action_scale: [FRAC_PI_3, 1.0],
        // The range of the elongation speed exceeds its bounds, so that the actor can reach
        // exactly 0. In a vacuum, where elongation only adds energy, no other value gives a
        // steady gait.
        output_gain: [1.0, 1.5],
        output_bound: 1.0,
        ..config.network
    };
    config.learning = Learning {
        batch: 64,
        target_smoothing: 5e-3,
        actor_learning_rate: 1e-3,
        critic_learning_rate: 2e-3,
        final_learning_rate: 0.02,
        random_steps: 5_000,
        steps_per_update: 2,
        mirror: true,
        actor_averaging: 1e-3,
        ..config.learning
    };
    config.exploration = Exploration::Gaussian { deviation: [0.003, 0.4] };
    config.reward = Reward {
        cap: 2.0,
        elongation: 0.2,
        height: 0.5,
        height_m: 1.8,
        fall: -0.5,
        low_is_fall: true,
    };
    config.episode.spread = 3.3;
    config.episode.low_share = 0.15;
    config.episode.uniform_share = 0.1;
    // On land the actor soon masters nearly all starts, so failed starts are replayed.
    config.episode.retry_share = 0.5;
    // In water 1 m/s needs nearly all of the leg's power; without a bias it is not reached.
    config.episode.led_share = [0.25, 0.5];
    config.episode.lead_m_s = 3.0;
    config.stages = vec![Stage {
        medium: MediumDraw::Mixed { air: 0.3, thin: 0.2, thin_to: 0.1, water: 0.1 },
        length: Length::Steps(400_000),
    }];
    config.selection = Selection { evaluations: 60, starts: 4000, tracking: 1e-3 };
    config.gains.clear();
    config
}

fn field() -> Config {
    let mut config = robust();
    config.preset = "field".into();
    // The exact episodes are as many as 0.75 of those of `robust`.
    config.stages[0].length = Length::Steps(500_000);
    let uniform = |low, high| Some(Distribution::Uniform { low, high });
    config.randomisation = Some(Randomisation {
        share: 0.4,
        mass: uniform(0.8, 1.2),
        stiffness: uniform(0.8, 1.2),
        damping_n_s_m: uniform(0.0, 50.0),
        foot_mass_kg: uniform(0.0, 2.0),
        friction: Some(Distribution::LogUniform { low: 0.5, high: 1.2 }),
        ..Randomisation::default()
    });
    config
}

#[cfg(test)]
mod tests {
    use super::Preset;
    use crate::config::Config;
    use clap::ValueEnum;

    #[test]
    fn every_preset_is_valid_and_round_trips_through_toml() {
        for preset in Preset::value_variants() {
            let config = preset.config();
            config.check().unwrap();
            let text = config.to_toml();
            assert_eq!(toml::from_str::<Config>(&text).unwrap(), config, "{text}");
            let typo = text.replace("discount", "discuont");
            assert!(toml::from_str::<Config>(&typo).unwrap_err().to_string().contains("discuont"));
        }
    }
}
