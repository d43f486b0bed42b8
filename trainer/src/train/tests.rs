//! What a training keeps of its falls.

use super::Training;
use crate::config::{Config, Length};
use crate::failed_starts::FailedStarts;
use crate::preset::Preset;
use leg_simd::Isa;

/// Trains for a few hundred steps and returns the failed starts.
fn failed_starts(config: Config) -> FailedStarts {
    let mut training = Training::new(config, 1, Isa::best());
    while training.share_of_stage() < 0.5 && training.episode().unwrap().is_some() {}
    training.failed_starts
}

#[test]
fn a_fall_in_a_randomised_world_is_not_tried_again() {
    let mut config = Preset::Robust.config();
    config.stages[0].length = Length::Steps(1200);
    config.learning.random_steps = 100;
    config.selection.evaluations = 0;
    assert!(failed_starts(config.clone()) != FailedStarts::default());
    let slippery = r#"randomisation.friction={ kind = "uniform", low = 0.1, high = 0.2 }"#;
    assert_eq!(failed_starts(config.with(slippery).unwrap()), FailedStarts::default());
}
