//! The deepest stack of the firmware.

use anyhow::{Context, Result};
use harness::board::Board;
use harness::checkout;
use harness::emulator::Emulator;

use crate::programs::{Programs, Running};
use crate::setup;

/// Ticks of the shore in lock-step: from its start beyond the first apex.
const TICKS: u64 = 500;

/// Feature of the firmware.
pub(super) const ESTIMATOR: &str = "estimator";

/// Returns the deepest stack in bytes over a power-up with a policy, the upload of a policy
/// that is then swapped in, and a run in lock-step.
///
/// Nothing is sent before the board sleeps: the interrupt of a byte during power-up would
/// sometimes add to the stack. Later frames are handled after their last byte, when no
/// other byte is under way.
///
/// With the feature `estimator` the law runs by its estimate.
pub(super) fn deepest(board: Board, features: &str) -> Result<u64> {
    setup::emulation()?;
    let programs = Programs::build()?;
    let policy = checkout().join("controller/policies/robust.bin");
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let mut emulator = Emulator::start(&board.build_with(features)?, Some(&policy), folder.path())?;
    emulator.wait_until_asleep()?;

    let mut upload = programs.controller();
    upload.args(["policy", "upload", "--json", "--unix"]).arg(emulator.uart()).arg(&policy);
    Running::start(&mut upload)?.output("the upload")?;

    let domain = format!("stack-{}", std::process::id());
    let mut bridge = programs.sim_host();
    bridge.args(["bridge", "--json", "--domain", &domain, "--unix"]).arg(emulator.uart());
    if features == ESTIMATOR {
        bridge.args(["--estimator", "state"]);
    }
    let mut bridge = Running::start(&mut bridge)?;
    programs.shore(Some(TICKS), &["--domain", &domain])?;
    let line = bridge.result("the bridge")?;
    line["controller"]["stack_used"].as_u64().context("the bridge does not report the stack")
}
