//! `cargo xtask hil`: hardware in the loop. The shore scenario runs with the firmware as
//! the controller.
//!
//! The board is emulated unless `--serial` names a port. All states and commands must be
//! those of the same scenario with the controller in the simulator's own process.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use harness::board::{BOARDS, Board};
use harness::checkout;
use harness::emulator::Emulator;
use serde_json::Value;

use crate::programs::{Programs, Running};
use crate::{Misuse, setup};

/// Run the shore with the firmware as the controller, emulated unless --serial names a port.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// Board to emulate.
    #[arg(long, value_name = "BOARD", default_value = BOARDS[0].name, value_parser = Board::named)]
    board: Board,
    /// Number of ticks to run [default: to the end of the scenario, about 78,000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    ticks: Option<u64>,
    /// Policy for slot A of the emulated board [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Serial port of a real board that is already flashed.
    #[arg(long, value_name = "PORT", conflicts_with = "policy")]
    serial: Option<PathBuf>,
}

impl Args {
    /// Returns the arguments for a number of ticks on the default board in the emulator.
    pub(crate) fn emulated(ticks: u64) -> Self {
        Self { board: BOARDS[0], ticks: Some(ticks), policy: None, serial: None }
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let shipped = checkout().join("controller/policies/robust.bin");
    let policy = args.policy.as_ref().unwrap_or(&shipped);
    if !policy.is_file() {
        return Err(Misuse::of(format!("no policy at {}; --policy names one", policy.display())));
    }
    let programs = Programs::build()?;

    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    let target = match &args.serial {
        Some(port) => Target::Real(port.clone()),
        None => Target::emulated(args.board, policy, folder.path())?,
    };
    println!("{} ({target}): the shore over its serial line\n", args.board.name);

    let domain = format!("hil-{}", std::process::id());
    let mut bridge = Running::start(
        programs.sim_host().arg("bridge").args(target.port()).args(["--domain", &domain]),
    )?;
    let over_the_line = programs.shore(args.ticks, &["--domain", &domain])?;
    let line = bridge.output("the bridge")?;
    let policy = policy.display().to_string();
    let here = programs.shore(args.ticks, &["--in-process", "--policy", &policy])?;
    report(&over_the_line, &here);
    print!("\n{line}");

    ensure!(
        args.serial.is_some() || over_the_line["state_hash"] == here["state_hash"],
        "the run with the firmware differs from the run on the host: state hash {} against {}",
        over_the_line["state_hash"],
        here["state_hash"]
    );
    Ok(())
}

/// The board that runs the firmware.
enum Target {
    Emulated(Emulator),
    Real(PathBuf),
}

impl Target {
    fn emulated(board: Board, policy: &Path, folder: &Path) -> Result<Self> {
        setup::emulation()?;
        Ok(Self::Emulated(Emulator::start(&board.build()?, Some(policy), folder)?))
    }

    /// Returns the option of `sim-host bridge` that names the board.
    fn port(&self) -> [&Path; 2] {
        match self {
            Self::Emulated(emulator) => [Path::new("--unix"), emulator.uart()],
            Self::Real(port) => [Path::new("--serial"), port],
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Emulated(_) => f.write_str("emulated"),
            Self::Real(port) => write!(f, "{}", port.display()),
        }
    }
}

fn report(run: &Value, here: &Value) {
    let number = |value: &Value| value.as_f64().map_or("-".into(), |x| format!("{x}"));
    println!("{:>24}  {:>18}  {:>18}", "", "firmware", "host");
    for key in ["ticks", "sim_time_s", "distance_m", "hops", "falls", "safe_ticks", "rejected"] {
        println!("{key:>24}  {:>18}  {:>18}", number(&run[key]), number(&here[key]));
    }
    let text = |value: &Value| value.as_str().unwrap_or("-").to_owned();
    let hash = "state_hash";
    println!("{hash:>24}  {:>18}  {:>18}", text(&run[hash]), text(&here[hash]));
}
