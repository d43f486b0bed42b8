//! `cargo xtask soak`: the tests of the firmware over more ticks than `cargo xtask ci` runs.

use anyhow::Result;

use crate::setup;
use crate::step::Step;

/// Run the tests of the firmware over many ticks.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Ticks over which host and firmware are compared; scales the other tests too.
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    ticks: u64,
    /// Run only the tests whose name contains this, such as `host_and_firmware`.
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    setup::emulation()?;
    let time = Step::new("soak", "cargo", "test --release --package end-to-end --test flashed")
        .with(&format!("-- {} --nocapture --test-threads 1", args.only.as_deref().unwrap_or("")))
        .with_env("LEG_HIL_TICKS", args.ticks.to_string())
        // Without the emulator the tests would be skipped, and nothing compared.
        .with_env("LEG_REQUIRE", "qemu")
        .run()?;
    println!("soak: {:.0} s", time.as_secs_f64());
    Ok(())
}
