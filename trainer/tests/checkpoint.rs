//! A training that is resumed from a checkpoint equals one that was never interrupted.

use std::path::Path;
use trainer::Isa;
use trainer::config::{Config, Length};
use trainer::preset::Preset;
use trainer::run::checkpoint::{Checkpoint, CheckpointWriter};
use trainer::run::log::LogPosition;
use trainer::run::recent::RecentEpisodes;
use trainer::train::Training;

fn checkpoint(training: &Training) -> Checkpoint {
    let log = LogPosition { length: 7, crc32: 8 };
    Checkpoint::new(training, RecentEpisodes::default(), log, Path::new("p.csv"))
}

fn back(bytes: &[u8], isa: Isa) -> Training {
    let checkpoint = Checkpoint::from_bytes(bytes).unwrap();
    let config = checkpoint.config(Path::new("p.bin.checkpoint")).unwrap();
    Training::from_state(config, checkpoint.seed, isa, checkpoint.training).unwrap()
}

fn short(preset: Preset) -> Config {
    let mut config = preset.config();
    for stage in &mut config.stages {
        stage.length = Length::Steps(800);
    }
    // The buffer is full and overwrites transitions.
    config.learning.replay_capacity = 300;
    config.learning.random_steps = config.learning.random_steps.min(100);
    config.selection.evaluations = config.selection.evaluations.min(4);
    config.selection.starts = 20;
    config
}

#[test]
fn a_resumed_training_equals_an_uninterrupted_one() {
    let randomised = short(Preset::Robust)
        .with("randomisation.mass={ kind = \"uniform\", low = 0.8, high = 1.2 }")
        .and_then(|config| {
            config.with("randomisation.noise_vx_m_s={ kind = \"uniform\", low = -0.1, high = 0.1 }")
        })
        .unwrap();
    for config in [short(Preset::Robust), short(Preset::WaterToAir), randomised] {
        let preset = &config.preset;
        let mut alone = Training::new(config.clone(), 5, Isa::best());
        let mut resumed = Training::new(config.clone(), 5, Isa::Baseline);
        for episode in 0.. {
            if episode % 23 == 0 {
                let bytes = checkpoint(&resumed).to_bytes();
                resumed = back(&bytes, Isa::best());
                assert!(checkpoint(&resumed).to_bytes() == bytes, "{preset:?} at {episode}");
            }
            let record = alone.episode().unwrap();
            assert_eq!(resumed.episode().unwrap(), record, "{preset:?} at {episode}");
            if record.is_none() {
                break;
            }
        }
        assert_eq!(resumed.best_actor(), alone.best_actor());
    }
}

#[test]
fn refuses_the_state_of_another_configuration() {
    let state = Training::new(short(Preset::Robust), 5, Isa::best()).state();
    let other = Training::from_state(short(Preset::Air), 5, Isa::best(), state.clone());
    assert_eq!(
        other.err().unwrap().to_string(),
        "its state does not fit its configuration (networks)"
    );
    let mut config = short(Preset::Robust);
    config.selection.evaluations = 0;
    assert!(Training::from_state(config, 5, Isa::best(), state).is_err());
}

/// A checkpoint is written every 30 s: it must not grow beyond its replay buffer.
#[test]
fn a_checkpoint_has_forty_bytes_for_each_transition() {
    let mut config = Preset::Robust.config();
    config.learning.random_steps = 20_000;
    config.stages[0].length = Length::Steps(20_000);
    config.selection.evaluations = 0;
    let mut training = Training::new(config, 1, Isa::best());
    let empty = checkpoint(&training).to_bytes().len();
    // At the end of the stage the buffer is emptied.
    while training.total_steps() + 20 < 20_000 {
        training.episode().unwrap();
    }
    let bytes = checkpoint(&training).to_bytes();
    let transitions = 40 * training.total_steps() as usize;
    // The rest is counters of variable length and the failed starts, 2,000 at most.
    let rest = bytes.len() - empty - transitions;
    assert!(rest < 2_000 * 24 + 100, "{} bytes, {empty} when empty", bytes.len());
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("p.bin");
    let mut checkpoints = CheckpointWriter::new(&out, None);
    checkpoints.write(&checkpoint(&training)).unwrap();
    assert!(std::fs::read(trainer::run::checkpoint::path(&out)).unwrap() == bytes);
}
