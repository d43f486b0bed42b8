//! `cargo xtask hil`: hardware in the loop. The shore scenario runs with the firmware as
//! the controller.
//!
//! The board is emulated unless `--serial` names a port. All states and commands must be
//! those of the same scenario with the controller in the simulator's own process. With the
//! sensors `imu` the firmware has its state estimator.

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
    /// Sensors of the leg; with `imu` the firmware must have the feature `estimator`.
    #[arg(long, value_enum, default_value_t)]
    sensors: Sensors,
    /// Number of ticks to run [default: to the end of the scenario, about 80,000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    ticks: Option<u64>,
    /// Policy for slot A of the emulated board [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Serial port of a real board that is already flashed.
    #[arg(long, value_name = "PORT", conflicts_with = "policy")]
    serial: Option<PathBuf>,
}

/// Sensors of the leg.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Sensors {
    /// Its state itself, exact.
    #[default]
    Ideal,
    /// Accelerometer, encoders and contact; the controller estimates the state.
    Imu,
}

impl Sensors {
    /// Returns the features that the firmware needs for them.
    fn features(self) -> &'static str {
        match self {
            Self::Ideal => "",
            Self::Imu => "estimator",
        }
    }

    /// Returns the options of the simulator.
    fn of_leg(self) -> &'static [&'static str] {
        match self {
            Self::Ideal => &[],
            Self::Imu => &["--sensors", "imu"],
        }
    }

    /// Returns the options of a controller. They state a noise so that each program takes the
    /// same: by itself the simulator states that of its sensors.
    fn of_controller(self) -> &'static [&'static str] {
        match self {
            Self::Ideal => &[],
            Self::Imu => &["--estimator", "inertial", "--estimator-noise", "leg-length=0.001"],
        }
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
        None => Target::emulated(args.board, args.sensors, policy, folder.path())?,
    };
    println!("{} ({target}): the shore over its serial line\n", args.board.name);
    let (of_leg, of_controller) = (args.sensors.of_leg(), args.sensors.of_controller());

    let domain = format!("hil-{}", std::process::id());
    let mut bridge = Running::start(
        programs
            .sim_host()
            .arg("bridge")
            .args(target.port())
            .args(["--domain", &domain])
            .args(of_controller),
    )?;
    let over_the_line = programs.shore(args.ticks, &[&["--domain", &domain], of_leg].concat())?;
    let line = bridge.output("the bridge")?;
    let policy = policy.display().to_string();
    let in_process = ["--in-process", "--policy", &policy];
    let here = programs.shore(args.ticks, &[&in_process, of_leg, of_controller].concat())?;
    report(&over_the_line, &here);
    print!("\n{line}");

    match compare(&over_the_line, &here) {
        Ok(ticks) => println!("\n{ticks} ticks compared: the same, bit for bit"),
        // It may have another policy than the host's run.
        Err(cause) if args.serial.is_some() => println!("\nwith the board's policy: {cause}"),
        Err(cause) => return Err(cause),
    }
    Ok(())
}

/// Compares the states and commands of two runs by their hashes; returns the number of ticks.
fn compare(run: &Value, here: &Value) -> Result<u64> {
    let of = |run: &Value| {
        let ticks = run["ticks"].as_u64().context("a run without a number of ticks")?;
        let hash = run["state_hash"].as_str().context("a run without a state hash")?;
        anyhow::Ok((ticks, hash.to_owned()))
    };
    let ((ticks, hash), (expected_ticks, expected)) = (of(run)?, of(here)?);
    ensure!(ticks > 0, "the run with the firmware has no tick, so nothing was compared");
    ensure!(
        (ticks, &hash) == (expected_ticks, &expected),
        "the run with the firmware differs from the run on the host: {ticks} ticks, state hash \
         {hash} against {expected_ticks}, {expected}"
    );
    Ok(ticks)
}

/// The board that runs the firmware.
enum Target {
    Emulated(Emulator),
    Real(PathBuf),
}

impl Target {
    fn emulated(board: Board, sensors: Sensors, policy: &Path, folder: &Path) -> Result<Self> {
        setup::emulation()?;
        let image = board.build_with(sensors.features())?;
        Ok(Self::Emulated(Emulator::start(&image, Some(policy), folder)?))
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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_comparison_of_nothing_or_of_different_runs_fails() {
        let run = json!({ "ticks": 10, "state_hash": "ab" });
        assert_eq!(compare(&run, &run).unwrap(), 10);
        for other in [
            json!({ "ticks": 10, "state_hash": "ac" }),
            json!({ "ticks": 11, "state_hash": "ab" }),
            json!({ "ticks": 10 }),
            json!({}),
        ] {
            assert!(compare(&run, &other).is_err(), "{other}");
        }
        let empty = json!({ "ticks": 0, "state_hash": "ab" });
        assert!(compare(&empty, &empty).unwrap_err().to_string().contains("nothing was compared"));
        assert!(compare(&json!({}), &json!({})).is_err(), "two missing hashes are not equal ones");
    }
}
