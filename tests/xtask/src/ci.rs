//! The whole check, in the order in which failures are cheapest to learn of.

use crate::{budget, chaos, hil, image, setup, step::Step};
use anyhow::Result;
use std::time::Instant;

/// Ticks of the shore that the emulated board plays in the check.
const HIL_TICKS: u64 = 10_000;

/// The firmware's own workspace.
const FIRMWARE: &str = "controller/firmware";

fn steps() -> Vec<Step> {
    let cargo = |name, args| Step::new(name, "cargo", args);
    vec![
        cargo("format", "fmt --all --check"),
        cargo(
            "controller without std",
            "clippy -p leg-control --target thumbv7em-none-eabihf -- -D warnings",
        ),
        cargo("controller on a Cortex-M0", "check -p leg-control --target thumbv6m-none-eabi"),
        cargo("controller on RISC-V", "check -p leg-control --target riscv32imac-unknown-none-elf"),
        cargo("format of the firmware", "fmt --check").within(FIRMWARE),
        // All targets: the benches too are compiled here.
        cargo("lints", "clippy --workspace --all-targets -- -D warnings"),
        cargo("lints of the firmware", "clippy --release -- -D warnings").within(FIRMWARE),
        cargo(
            "lints of the firmware on silicon",
            "clippy --release --no-default-features --features stm32f405 -- -D warnings",
        )
        .within(FIRMWARE),
        cargo("docs", "doc --workspace --no-deps").with_env("RUSTDOCFLAGS", "-D warnings"),
        cargo("tests", "test --workspace"),
        cargo("the main job", "run --release -- --json"),
    ]
}

/// Runs every step and prints how long each took.
pub(crate) fn run() -> Result<()> {
    setup::run()?;
    let mut times = Vec::new();
    for step in steps() {
        times.push((step.name, step.run()?));
    }
    let mut own = |name, run: &dyn Fn() -> Result<()>| -> Result<()> {
        println!("\n=== {name}");
        let start = Instant::now();
        run()?;
        times.push((name, start.elapsed()));
        Ok(())
    };
    own("chaos: cargo xtask chaos --kills 20", &|| chaos::run(&chaos::Args::short()))?;
    own("no way to panic: cargo xtask image", &image::run)?;
    own("budget: cargo xtask budget", &|| budget::run(&budget::Args::default()))?;
    own("hardware in the loop: cargo xtask hil --ticks 10000", &|| {
        hil::run(&hil::Args::emulated(HIL_TICKS))
    })?;

    println!("\nall passed");
    for (name, time) in times {
        println!("{:>7.1} s  {name}", time.as_secs_f64());
    }
    Ok(())
}
