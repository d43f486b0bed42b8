//! A checkpoint holds everything: what goes on from it cannot be told from what
//! never stopped.

use std::path::Path;
use std::time::Instant;
use trainer::config::{Config, Length};
use trainer::preset::Preset;
use trainer::run::checkpoint::{Checkpoint, CheckpointWriter};
use trainer::run::log::LogPosition;
use trainer::run::recent::RecentEpisodes;
use trainer::simd::Isa;
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
    // Full and turning over.
    config.learning.replay_capacity = 300;
    config.learning.random_steps = config.learning.random_steps.min(100);
    config.selection.evaluations = config.selection.evaluations.min(4);
    config.selection.starts = 20;
    config
}

#[test]
fn it_goes_on_as_if_it_had_never_stopped() {
    for preset in [Preset::Robust, Preset::WaterToAir] {
        let mut alone = Training::new(short(preset), 5, Isa::best());
        let mut resumed = Training::new(short(preset), 5, Isa::Baseline);
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
fn the_state_of_another_training_is_refused() {
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

#[test]
#[ignore = "a measurement: run with --release -- --ignored --nocapture"]
fn size_and_time() {
    let folder = tempfile::tempdir().unwrap();
    for steps in [300_000, 1_000_000] {
        let mut config = Preset::Robust.config();
        config.learning.random_steps = steps;
        config.stages[0].length = Length::Steps(steps);
        config.selection.evaluations = 0;
        let mut training = Training::new(config, 1, Isa::best());
        // All but the last episode: at the end of a stage the buffer is emptied.
        while training.total_steps() + 20 < steps {
            training.episode().unwrap();
        }
        let mut checkpoints = CheckpointWriter::new(&folder.path().join("p.bin"), None);
        for _ in 0..3 {
            let began = Instant::now();
            let bytes = checkpoint(&training).to_bytes();
            let encoded = began.elapsed();
            checkpoints.write(&checkpoint(&training)).unwrap();
            let both = began.elapsed();
            let began = Instant::now();
            back(&bytes, Isa::best());
            println!(
                "{steps} transitions: {:.1} MB, {encoded:.1?} to encode, {both:.1?} to encode twice and write, \
                 {:.1?} to read back",
                bytes.len() as f64 / 1e6,
                began.elapsed()
            );
        }
    }
}
