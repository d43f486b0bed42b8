//! One step of a check: a command, said before it runs, timed, failing loudly.

use anyhow::{Context, Result, bail};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// The repository's root, from which every step runs.
pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A named command line.
pub(crate) struct Step {
    pub(crate) name: &'static str,
    program: &'static str,
    args: &'static str,
    env: Option<(&'static str, &'static str)>,
}

impl Step {
    pub(crate) const fn new(name: &'static str, program: &'static str, args: &'static str) -> Self {
        Self { name, program, args, env: None }
    }

    pub(crate) const fn with_env(mut self, key: &'static str, value: &'static str) -> Self {
        self.env = Some((key, value));
        self
    }

    /// Runs it and returns how long it took.
    pub(crate) fn run(&self) -> Result<Duration> {
        println!("\n=== {}: {} {}", self.name, self.program, self.args);
        let start = Instant::now();
        let status = Command::new(self.program)
            .args(self.args.split_whitespace())
            .envs(self.env)
            .current_dir(root())
            .status()
            .with_context(|| format!("cannot start `{}`; is it installed?", self.program))?;
        if !status.success() {
            bail!("{}: `{} {}` ended with {status}", self.name, self.program, self.args);
        }
        Ok(start.elapsed())
    }
}

/// Whether a command line runs and succeeds, and what it prints.
pub(crate) fn output_of(program: &str, args: &[&str]) -> Option<String> {
    let output = Command::new(program).args(args).current_dir(root()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}
