//! Hardware in the loop: the shore, played to a flashed controller.
//!
//! The board is emulated unless a port says otherwise. The run must be, state
//! by state and command by command, the one that the same scenario gives with
//! the controller in the simulator's own process.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde_json::Value;
use tests::board::{BOARDS, Board};
use tests::emulator::Emulator;
use tests::root;

use crate::{Misuse, setup};

/// Ticks a second of the shore.
const RATE_HZ: u64 = 1_000;

/// Plays the shore to a flashed controller; the board is emulated unless --serial names a port.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// The board.
    #[arg(long, value_name = "BOARD", default_value = BOARDS[0].name, value_parser = Board::named)]
    board: Board,
    /// Stop after so many ticks [default: all the way, some 78,000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    ticks: Option<u64>,
    /// The policy for slot A of the emulated board [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// The serial port of a real board that is flashed already.
    #[arg(long, value_name = "PORT", conflicts_with = "policy")]
    serial: Option<PathBuf>,
}

impl Args {
    /// The default board in the emulator, for so many ticks.
    pub(crate) fn emulated(ticks: u64) -> Self {
        Self { board: BOARDS[0], ticks: Some(ticks), policy: None, serial: None }
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let shipped = root().join("controller/policies/robust.bin");
    let policy = args.policy.as_ref().unwrap_or(&shipped);
    if !policy.is_file() {
        return Err(Misuse::of(format!("no policy at {}; --policy names one", policy.display())));
    }
    let sim_host = build_sim_host()?;

    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let target = match &args.serial {
        Some(port) => Target::Real(port.clone()),
        None => Target::emulated(args.board, policy, folder.path())?,
    };
    println!("{} ({target}), the shore over its serial line\n", args.board.name);

    let domain = format!("hil-{}", std::process::id());
    let mut bridge = Running::start(
        Command::new(&sim_host).arg("bridge").args(target.port()).args(["--domain", &domain]),
    )?;
    let over_the_line = scenario(&sim_host, args.ticks, &["--domain", &domain])?;
    let line = bridge.output("the bridge")?;
    let policy = policy.display().to_string();
    let here = scenario(&sim_host, args.ticks, &["--in-process", "--policy", &policy])?;
    report(&over_the_line, &here);
    print!("\n{line}");

    ensure!(
        args.serial.is_some() || over_the_line["state_hash"] == here["state_hash"],
        "the flashed controller's run is another than the host's: state hash {} against {}",
        over_the_line["state_hash"],
        here["state_hash"]
    );
    Ok(())
}

/// Deepest stack of the default board, bytes: the least of three short runs, for
/// interrupts come when they come and put theirs on top.
pub(crate) fn deepest_stack() -> Result<u64> {
    const TICKS: u64 = 500;
    let sim_host = build_sim_host()?;
    let policy = root().join("controller/policies/robust.bin");
    let mut least = u64::MAX;
    for run in 0..3 {
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let target = Target::emulated(BOARDS[0], &policy, folder.path())?;
        let domain = format!("stack-{}-{run}", std::process::id());
        let mut bridge = Command::new(&sim_host);
        bridge.arg("bridge").args(target.port()).args(["--domain", &domain, "--json"]);
        let mut bridge = Running::start(&mut bridge)?;
        scenario(&sim_host, Some(TICKS), &["--domain", &domain])?;
        let line = object(&bridge.output("the bridge")?)?;
        let used = line["controller"]["stack_used"].as_u64();
        least = least.min(used.context("the bridge does not tell the stack")?);
    }
    Ok(least)
}

/// A flashed controller.
enum Target {
    Emulated(Emulator),
    Real(PathBuf),
}

impl Target {
    fn emulated(board: Board, policy: &Path, folder: &Path) -> Result<Self> {
        setup::emulation()?;
        Ok(Self::Emulated(Emulator::start(&board.build()?, Some(policy), folder)?))
    }

    /// Where the bridge finds it.
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

fn build_sim_host() -> Result<PathBuf> {
    let status = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--release", "--package", "sim-host"])
        .current_dir(root())
        .status()
        .context("cannot start cargo")?;
    ensure!(status.success(), "sim-host does not build ({status})");
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from);
    Ok(target.join("release/sim-host"))
}

/// Plays the shore; what came of it.
fn scenario(sim_host: &Path, ticks: Option<u64>, more: &[&str]) -> Result<Value> {
    let mut command = Command::new(sim_host);
    command.args(["run", "--json", "--scenario"]);
    command.arg(root().join("sim-host/scenarios/shore.toml")).args(more);
    if let Some(ticks) = ticks {
        command.args(["--duration", &(ticks as f64 / RATE_HZ as f64).to_string()]);
    }
    object(&Running::start(&mut command)?.output("the simulator")?)
}

/// A program whose result is wanted; ended when dropped.
struct Running(Option<Child>);

impl Running {
    fn start(command: &mut Command) -> Result<Self> {
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {command:?}"))?;
        Ok(Self(Some(child)))
    }

    /// Waits for its end; what it printed.
    fn output(&mut self, who: &str) -> Result<String> {
        let child = self.0.take().context("asked twice")?;
        let output = child.wait_with_output().with_context(|| format!("cannot wait for {who}"))?;
        ensure!(output.status.success(), "{who} ended with {}", output.status);
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

/// The one object that a program printed.
fn object(text: &str) -> Result<Value> {
    serde_json::from_str(text).with_context(|| format!("no result in `{text}`"))
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn report(run: &Value, here: &Value) {
    let number = |value: &Value| value.as_f64().map_or("-".into(), |x| format!("{x}"));
    println!("{:>24}  {:>18}  {:>18}", "", "flashed controller", "in one process");
    for key in ["ticks", "sim_time_s", "distance_m", "hops", "falls", "safe_ticks", "rejected"] {
        println!("{key:>24}  {:>18}  {:>18}", number(&run[key]), number(&here[key]));
    }
    let text = |value: &Value| value.as_str().unwrap_or("-").to_owned();
    let hash = "state_hash";
    println!("{hash:>24}  {:>18}  {:>18}", text(&run[hash]), text(&here[hash]));
}
