//! The command `trainer bench`.

use super::output::print;
use super::{Failure, IsaArgument, failed};
use crate::config::Length;
use crate::environment::{Environment, Start};
use crate::evaluate::survival::quantile;
use crate::preset::Preset;
use crate::train::{DivergenceError, NotFinite, Training};
use clap::Args;
use leg_simd::Isa;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;
use std::time::Instant;

/// Number of updates or steps in a timed batch.
const TOGETHER: usize = 20;
/// Number of timed batches.
const BATCHES: usize = 500;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Instruction set to use
    #[arg(long, value_enum, default_value = "best")]
    isa: IsaArgument,
}

/// Quantiles of the mean time over short batches, us.
#[derive(Serialize)]
struct Quantiles {
    p10: f64,
    p50: f64,
    p90: f64,
}

#[derive(Serialize)]
struct Measurements {
    /// One update of both networks and targets of the paper's agent, batch 32.
    update_us: Quantiles,
    /// One update with the preset `robust`: critic 100 wide, batch 64.
    update_robust_us: Quantiles,
    /// One environment step: observation, hop, reward.
    env_step_us: Quantiles,
    /// Wall time of 20,000 steps of the preset `air`, each with its update.
    steps_20000_s: f64,
    isa: &'static str,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let isa = arguments.isa.isa()?;
    let measurements = measure(isa).map_err(failed)?;
    if arguments.json {
        return print(&serde_json::to_string(&measurements).map_err(failed)?);
    }
    let row = |name: &str, q: &Quantiles| {
        format!("{name:34} {:>8.2} {:>8.2} {:>8.2}\n", q.p10, q.p50, q.p90)
    };
    print(&format!(
        "Wall time on one core, {}; quantiles over {BATCHES} batches of {TOGETHER}, us\n\
         {:34} {:>8} {:>8} {:>8}\n{}{}{}20,000 steps with their updates: {:.3} s",
        measurements.isa,
        "",
        "p10",
        "p50",
        "p90",
        row("update, paper's agent, batch 32", &measurements.update_us),
        row("update, robust, batch 64", &measurements.update_robust_us),
        row("environment step", &measurements.env_step_us),
        measurements.steps_20000_s
    ))
}

fn measure(isa: Isa) -> Result<Measurements, DivergenceError> {
    let mut config = Preset::Air.config();
    config.stages[0].length = Length::Steps(20_000);
    let began = Instant::now();
    let mut training = Training::new(config, 1, isa);
    while training.episode()?.is_some() {}
    let steps_20000_s = began.elapsed().as_secs_f64();
    Ok(Measurements {
        update_us: updates(Preset::Air, isa)?,
        update_robust_us: updates(Preset::Robust, isa)?,
        env_step_us: environment_steps(),
        steps_20000_s,
        isa: isa.name(),
    })
}

/// Times updates on a replay buffer of 20,000 real transitions.
fn updates(preset: Preset, isa: Isa) -> Result<Quantiles, DivergenceError> {
    let mut config = preset.config();
    config.learning.random_steps = 20_000;
    config.stages.truncate(1);
    config.stages[0].length = Length::Steps(40_000);
    let mut training = Training::new(config, 1, isa);
    while training.total_steps() < 20_000 {
        training.episode()?;
    }
    let mut value = None;
    let quantiles = timed(|| value = value.or(NotFinite::of(&training.update())));
    let step = training.total_steps();
    value.map_or(Ok(quantiles), |value| Err(DivergenceError { step, value }))
}

fn environment_steps() -> Quantiles {
    let config = Preset::Robust.config();
    let mut rng = Pcg64::seed_from_u64(1);
    let medium = &config.stages[0].medium;
    let mut environment = Environment::new(&config, Start::draw(&config, medium, 0, &mut rng));
    let mut sum = 0.0;
    let quantiles = timed(|| {
        sum += environment.observation()[0];
        let outcome = environment.step([rng.random_range(-0.2..0.2), rng.random_range(-1.0..1.0)]);
        sum += outcome.reward as f32;
        if outcome.ended {
            environment = Environment::new(&config, Start::draw(&config, medium, 0, &mut rng));
        }
    });
    std::hint::black_box(sum);
    quantiles
}

fn timed(mut work: impl FnMut()) -> Quantiles {
    (0..10 * TOGETHER).for_each(|_| work());
    let mut batches: Vec<f64> = (0..BATCHES)
        .map(|_| {
            let began = Instant::now();
            (0..TOGETHER).for_each(|_| work());
            began.elapsed().as_secs_f64() * 1e6 / TOGETHER as f64
        })
        .collect();
    batches.sort_by(f64::total_cmp);
    let at = |share| quantile(&batches, share).unwrap_or(f64::NAN);
    Quantiles { p10: at(0.1), p50: at(0.5), p90: at(0.9) }
}
