//! A step of a check: a command that is printed, run and timed.

use anyhow::{Context, Result, bail};
use std::process::Command;
use std::time::{Duration, Instant};

use harness::checkout;

/// A named command line.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    pub(crate) name: &'static str,
    program: &'static str,
    args: String,
    folder: &'static str,
    env: Vec<(&'static str, String)>,
}

impl Step {
    pub(crate) fn new(name: &'static str, program: &'static str, args: &str) -> Self {
        Self { name, program, args: args.to_owned(), folder: ".", env: Vec::new() }
    }

    /// Adds arguments.
    pub(crate) fn with(mut self, more: &str) -> Self {
        self.args = format!("{} {more}", self.args);
        self
    }

    /// Runs the command in this folder of the repository instead of the root.
    pub(crate) fn within(mut self, folder: &'static str) -> Self {
        self.folder = folder;
        self
    }

    pub(crate) fn with_env(mut self, key: &'static str, value: impl Into<String>) -> Self {
        self.env.push((key, value.into()));
        self
    }

    /// Runs the command and returns how long it took.
    pub(crate) fn run(&self) -> Result<Duration> {
        let Self { name, program, args, .. } = self;
        println!("\n=== {name}: {program} {args}");
        let start = Instant::now();
        let status = Command::new(program)
            .args(args.split_whitespace())
            .envs(self.env.clone())
            .current_dir(checkout().join(self.folder))
            .status()
            .with_context(|| format!("cannot start `{program}`; is it installed?"))?;
        if !status.success() {
            bail!("{name}: `{program} {args}` ended with {status}");
        }
        Ok(start.elapsed())
    }
}

/// Returns the standard output of a command, `None` if it fails.
pub(crate) fn output_of(program: &str, args: &[&str]) -> Option<String> {
    let output = Command::new(program).args(args).current_dir(checkout()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}
