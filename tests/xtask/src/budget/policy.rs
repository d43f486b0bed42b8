//! `cargo xtask budget --policy FILE`: what an inference of a policy costs on a Cortex-M4F.

use super::emulator;
use anyhow::{Context, Result, ensure};
use harness::firmware::Build;
use std::path::Path;

/// Bytes of a policy slot of the boards here, `controller/firmware/memory`.
const SLOT: u64 = 16 * 1024;
/// Clock of the STM32F405.
const CLOCK_HZ: f64 = 168e6;

/// Builds the policy into an image, runs it in the emulator and prints the cost of its costliest
/// inference.
pub(super) fn print(policy: &Path) -> Result<()> {
    let path =
        policy.canonicalize().with_context(|| format!("cannot read {}", policy.display()))?;
    let bytes = path.metadata().with_context(|| format!("cannot read {}", policy.display()))?.len();
    let image = Build {
        name: "bench-policy",
        features: "mps2-an386,bench-policy",
        programs: &["policy"],
        flags: None,
        policy: Some(&path),
    }
    .run()?
    .join("policy");
    let profiles = emulator::profiles(&image).with_context(|| {
        format!("{} does not run on the board; `trainer inspect` tells why", policy.display())
    })?;
    let profile = profiles.get("inference").context("the image has no inference")?;
    ensure!(profile.instructions > 0, "the inference was not traced");
    println!("{}, on a Cortex-M4F", policy.display());
    println!("inference         {:>9} instructions", profile.instructions);
    let time_us = 1e6 * profile.cycles as f64 / CLOCK_HZ;
    println!(
        "                  {:>9} cycles, estimated: {time_us:.0} us at 168 MHz without wait states",
        profile.cycles
    );
    let fits = if bytes <= SLOT { "fits" } else { "does not fit" };
    println!("file              {bytes:>9} bytes: {fits} a slot of the boards here ({SLOT})");
    Ok(())
}
