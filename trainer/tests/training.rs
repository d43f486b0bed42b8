//! A training gives the same policy, bit for bit, on any CPU and number of threads.

use trainer::Isa;
use trainer::config::{Config, Length};
use trainer::policy::{PolicyInfo, blob};
use trainer::preset::Preset;
use trainer::train::{EpisodeRecord, Training};

fn short(preset: Preset, steps: u64) -> Config {
    let mut config = preset.config();
    for stage in &mut config.stages {
        stage.length = Length::Steps(steps);
    }
    if config.selection.evaluations > 0 {
        config.learning.random_steps = 300;
        config.selection.evaluations = 3;
        config.selection.starts = 40;
    }
    config
}

fn train(config: &Config, seed: u64, isa: Isa) -> (Vec<EpisodeRecord>, Vec<u8>) {
    let mut training = Training::new(config.clone(), seed, isa);
    let mut log = Vec::new();
    while let Some(record) = training.episode().unwrap() {
        log.push(record);
    }
    let (actor, score) = training.best_actor();
    assert_eq!(score.is_some(), config.selection.evaluations > 0);
    let gains = &Preset::Air.config().gains;
    let bytes = blob(
        &actor,
        &PolicyInfo {
            name: "test",
            preset: &config.preset,
            seed,
            steps: training.total_steps(),
            density_ratio: config.density_range(),
            gravity_m_s2: config.gravity_range_m_s2(),
            config: &config.to_toml(),
            gains,
        },
    );
    (log, bytes.unwrap().as_slice().to_vec())
}

#[test]
fn the_same_seed_gives_the_same_policy_on_any_cpu_and_number_of_threads() {
    for preset in [Preset::Robust, Preset::WaterToAir] {
        let config = short(preset, 1500);
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let first = alone.install(|| train(&config, 7, Isa::Baseline));
        let two = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let second = two.install(|| train(&config, 7, Isa::best()));
        assert!(first == second, "{preset:?} differs");
        let other = two.install(|| train(&config, 8, Isa::best()));
        assert!(first.1 != other.1, "{preset:?} ignores its seed");
    }
}

#[test]
fn a_transfer_trains_both_stages() {
    let config = short(Preset::WaterToAir, 400);
    let (log, _) = train(&config, 1, Isa::best());
    let mean = |stage: usize| {
        let densities: Vec<f64> =
            log.iter().filter(|r| r.stage == stage).map(|r| r.density_ratio).collect();
        densities.iter().sum::<f64>() / densities.len() as f64
    };
    assert!(mean(1) > 0.85 && mean(2) < 0.15);
    assert!(log.iter().all(|r| (1..=5).contains(&r.steps)));
    assert!(log.windows(2).all(|w| w[1].episode == w[0].episode + 1));
}

#[test]
fn the_water_preset_learns_to_stop() {
    let mut config = Preset::Water.config();
    config.stages[0].length = Length::Episodes(1500);
    let (log, _) = train(&config, 2, Isa::best());
    let mean =
        |part: &[EpisodeRecord]| part.iter().map(|r| r.reward).sum::<f64>() / part.len() as f64;
    let (early, late) = (mean(&log[..100]), mean(&log[1300..]));
    assert!(late > early + 1.0 && late > 2.0, "{early} then {late}");
}
