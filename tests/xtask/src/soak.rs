//! The tests of the flashed controller, at length: too long for every check.

use anyhow::Result;

use crate::setup;
use crate::step::Step;

/// The tests of the flashed controller, long.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Ticks that host and firmware are compared over; the other tests go by it too.
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    ticks: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    setup::emulation()?;
    let time = Step::new("soak", "cargo", "test --release --package end-to-end --test flashed")
        .with("-- --nocapture --test-threads 1")
        .with_env("LEG_HIL_TICKS", args.ticks.to_string())
        .run()?;
    println!("soak: {:.0} s", time.as_secs_f64());
    Ok(())
}
