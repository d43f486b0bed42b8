//! Release builds of the workspace's programs: building, starting, reading their results.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, ensure};
use harness::checkout;
use serde_json::Value;

/// Tick rate of the shore scenario.
const RATE_HZ: u64 = 1_000;

/// Returns the folder that cargo builds into.
pub(crate) fn target_folder() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| checkout().join("target"), PathBuf::from)
}

/// The release builds of `sim-host` and `controller`.
#[derive(Debug)]
pub(crate) struct Programs {
    folder: PathBuf,
}

impl Programs {
    pub(crate) fn build() -> Result<Self> {
        let status = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--release", "--package", "sim-host", "--bin", "sim-host"])
            .args(["--package", "leg-host", "--bin", "controller"])
            .current_dir(checkout())
            .status()
            .context("cannot start cargo")?;
        ensure!(status.success(), "the programs do not build ({status})");
        Ok(Self::of(target_folder().join("release")))
    }

    /// Uses the programs in a folder.
    pub(crate) fn of(folder: PathBuf) -> Self {
        Self { folder }
    }

    pub(crate) fn sim_host(&self) -> Command {
        Command::new(self.folder.join("sim-host"))
    }

    pub(crate) fn controller(&self) -> Command {
        Command::new(self.folder.join("controller"))
    }

    /// Runs the shore scenario, or its first ticks, and returns the JSON summary.
    pub(crate) fn shore(&self, ticks: Option<u64>, more: &[&str]) -> Result<Value> {
        let mut command = self.sim_host();
        command.args(["run", "--json", "--scenario"]);
        command.arg(checkout().join("sim-host/scenarios/shore.toml")).args(more);
        if let Some(ticks) = ticks {
            command.args(["--duration", &(ticks as f64 / RATE_HZ as f64).to_string()]);
        }
        Running::start(&mut command)?.result("the simulator")
    }
}

/// A running program whose output is read; killed when dropped.
#[derive(Debug)]
pub(crate) struct Running(Option<Child>);

impl Running {
    pub(crate) fn start(command: &mut Command) -> Result<Self> {
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {command:?}"))?;
        Ok(Self(Some(child)))
    }

    /// Waits for the end of the program and returns its standard output.
    pub(crate) fn output(&mut self, who: &str) -> Result<String> {
        let child = self.0.take().context("its output has been taken before")?;
        let output = child.wait_with_output().with_context(|| format!("cannot wait for {who}"))?;
        ensure!(output.status.success(), "{who} ended with {}", output.status);
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// Waits for the end of the program and parses its standard output as JSON.
    pub(crate) fn result(&mut self, who: &str) -> Result<Value> {
        let text = self.output(who)?;
        serde_json::from_str(&text).with_context(|| format!("no result of {who} in `{text}`"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
