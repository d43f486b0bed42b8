//! What the checks need beside cargo, and how to get it.

use crate::step::{Step, output_of};
use anyhow::Result;

/// A microcontroller target: proves that the controller needs no std.
pub(crate) const CORTEX_M4F: &str = "thumbv7em-none-eabihf";

/// Installs what is missing.
pub(crate) fn run() -> Result<()> {
    let components = output_of("rustup", &["component", "list", "--installed"]).unwrap_or_default();
    for (component, install) in [
        ("rustfmt", Step::new("rustfmt", "rustup", "component add rustfmt")),
        ("clippy", Step::new("clippy", "rustup", "component add clippy")),
    ] {
        if !components.lines().any(|line| line.starts_with(component)) {
            install.run()?;
        }
    }
    let targets = output_of("rustup", &["target", "list", "--installed"]).unwrap_or_default();
    if !targets.lines().any(|line| line == CORTEX_M4F) {
        Step::new("Cortex-M4F target", "rustup", "target add thumbv7em-none-eabihf").run()?;
    }
    println!("setup: rustfmt, clippy and the target {CORTEX_M4F} are there");
    Ok(())
}
