//! A step of a check: a command that is printed, run and timed.

use anyhow::{Context, Result, bail};
use std::io::{Read, Seek};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use harness::checkout;

/// A named command line.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    pub(crate) name: &'static str,
    program: String,
    args: String,
    folder: &'static str,
    env: Vec<(&'static str, String)>,
}

/// What became of a step.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) time: Duration,
    /// The standard output and the standard error, in the order in which they were written.
    pub(crate) output: String,
    pub(crate) result: Result<()>,
}

impl Step {
    pub(crate) fn new(name: &'static str, program: impl Into<String>, args: &str) -> Self {
        let (program, args) = (program.into(), args.to_owned());
        Self { name, program, args, folder: ".", env: Vec::new() }
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

    /// Returns the line that is printed above the output of the command.
    pub(crate) fn title(&self) -> String {
        // A copy of this program is called by its name.
        let program = self.program.rsplit('/').next().unwrap_or_default();
        let program = if program == "xtask" { "cargo xtask" } else { program };
        format!("=== {}: {program} {}", self.name, self.args)
    }

    /// Runs the command and returns how long it took.
    pub(crate) fn run(&self) -> Result<Duration> {
        println!("\n{}", self.title());
        let start = Instant::now();
        self.end(&mut self.command(&self.program, &[]))?;
        Ok(start.elapsed())
    }

    /// Runs the command at a low priority and collects what it writes.
    pub(crate) fn run_beside(&self) -> Ended {
        let start = Instant::now();
        let (output, result) = match self.collect() {
            Ok((output, result)) => (output, result),
            Err(error) => (String::new(), Err(error)),
        };
        Ended { time: start.elapsed(), output, result }
    }

    fn collect(&self) -> Result<(String, Result<()>)> {
        let file = || tempfile::tempfile().context("cannot create a temporary file");
        let mut written = file()?;
        let mut command = self.command("nice", &["-n", "10", &self.program]);
        command.stdin(Stdio::null()).stdout(written.try_clone()?).stderr(written.try_clone()?);
        let result = self.end(&mut command);
        written.rewind()?;
        let mut bytes = Vec::new();
        written.read_to_end(&mut bytes)?;
        Ok((String::from_utf8_lossy(&bytes).into_owned(), result))
    }

    fn command(&self, program: &str, before: &[&str]) -> Command {
        let mut command = Command::new(program);
        command
            .args(before)
            .args(self.args.split_whitespace())
            .envs(self.env.clone())
            .current_dir(checkout().join(self.folder));
        command
    }

    fn end(&self, command: &mut Command) -> Result<()> {
        let Self { name, program, args, .. } = self;
        let status = command
            .status()
            .with_context(|| format!("cannot start `{program}`; is it installed?"))?;
        if !status.success() {
            bail!("{name}: `{program} {args}` ended with {status}");
        }
        Ok(())
    }
}

/// Returns the standard output of a command, `None` if it fails.
pub(crate) fn output_of(program: &str, args: &[&str]) -> Option<String> {
    let output = Command::new(program).args(args).current_dir(checkout()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}
