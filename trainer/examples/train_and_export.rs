//! Trains a small policy, evaluates it, and exports it: the trainer as a library.
//!
//! ```console
//! $ cargo run --release -p trainer --example train_and_export -- out
//! ```
//!
//! writes `policy.bin`, `actor.safetensors` and `actor.onnx` into the folder `out`. The
//! training has 4,000 steps instead of the preset's 5,000 episodes, so the policy is no good.

use leg_control::actor::Observation;
use leg_control::policy::Policy;
use std::error::Error;
use std::fs;
use std::path::PathBuf;
use trainer::Isa;
use trainer::bridge::{onnx, safetensors};
use trainer::config::Length;
use trainer::evaluate::report::Report;
use trainer::preset::Preset;
use trainer::train::Training;
use trainer::trained::TrainedPolicy;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| "out".into()));
    fs::create_dir_all(&folder)?;

    // A preset with some parameters changed. `check` names a parameter that is out of range.
    let mut config = Preset::Air.config();
    config.stages[0].length = Length::Steps(4_000);
    config.learning.batch = 64;
    config.check()?;

    // One seed determines everything random, whatever the instruction set.
    let mut training = Training::new(config, 7, Isa::best());
    while let Some(episode) = training.episode()? {
        if episode.episode % 500 == 0 {
            println!(
                "episode {}: {} steps, reward {:.2}",
                episode.episode, episode.steps, episode.reward
            );
        }
    }

    // The policy file is what the controller runs. Other tools read the exports.
    let trained = TrainedPolicy::new(&training);
    let blob = trained.blob()?;
    let policy = Policy::parse(blob.as_slice())?;
    fs::write(folder.join("policy.bin"), blob.as_slice())?;
    fs::write(folder.join("actor.safetensors"), safetensors::export(&policy))?;
    fs::write(folder.join("actor.onnx"), onnx::export(&policy))?;

    let observation = Observation { apex_vx_m_s: 0.5, apex_y_m: 1.5, density_ratio: 0.0 };
    let action = policy.actor().act(observation);
    println!(
        "At 0.5 m/s and 1.5 m on land: touchdown angle {:.3} rad, elongation speed {:.3} m/s.",
        action.touchdown_angle_rad, action.elongation_speed_m_s
    );
    // 20 random starts; the program `trainer eval` takes 5,000.
    let report = Report::new(&policy, 20, 1);
    let (rho, survival) = &report.survival[0];
    println!("Survival over 30 hops at density ratio {rho}: {:.2}.", survival.survive30);
    println!("Written: policy.bin, actor.safetensors and actor.onnx in {}.", folder.display());
    Ok(())
}
