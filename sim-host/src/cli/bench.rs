//! `sim-host bench`.

use std::process::{Command, ExitCode, Stdio};

use leg_host::Domain;
use leg_process::stdout;

use crate::bench::{self, Size};

/// The benchmarks.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Bench {
    /// Time the lock-step loop between two processes and its transport alone.
    Loop(LoopArgs),
    /// Run the second process of `bench loop`.
    #[command(hide = true)]
    Echo(EchoArgs),
}

/// Measures in turn, between two processes: a round trip through bare shared
/// memory, one through bare iceoryx2, and a full tick in lock-step (sample, guard,
/// gait, cascade, command, plant).
#[derive(Debug, clap::Args)]
pub(super) struct LoopArgs {
    #[command(flatten)]
    size: Size,
    /// Print the result as one JSON object: `raw_shm_us`, `raw_iceoryx2_us`,
    /// `full_tick_us`, each {p50, p99, `p99_9`, max}, and `ticks_per_s`.
    #[arg(long)]
    json: bool,
}

/// Options of the second process.
#[derive(Debug, clap::Args)]
pub(super) struct EchoArgs {
    #[arg(long)]
    domain: String,
    #[command(flatten)]
    size: Size,
}

pub(super) fn main(bench: &Bench) -> anyhow::Result<ExitCode> {
    match bench {
        Bench::Loop(args) => measure(args)?,
        Bench::Echo(args) => bench::echo(&Domain::join(&args.domain)?, args.size)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn measure(args: &LoopArgs) -> anyhow::Result<()> {
    let name = format!("bench-{}", std::process::id());
    let domain = Domain::join(&name)?;
    let mut echo = Command::new(leg_process::program::current()?)
        .args(["bench", "echo", "--domain", &name])
        .args(["--rounds", &args.size.rounds.to_string()])
        .args(["--exchanges", &args.size.exchanges.to_string()])
        .stdin(Stdio::null())
        .spawn()?;
    let report = bench::measure(&domain, args.size);
    if report.is_err() {
        // It may wait for messages that will not arrive.
        let _ = echo.kill();
    }
    let ended = echo.wait()?;
    let report = report?;
    anyhow::ensure!(ended.success(), "the second process failed ({ended}); its message is above");
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(report)?;
    }
    Ok(())
}
