//! A controller process started by this one.

use std::ffi::OsString;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use leg_host::realtime::LoopReport;
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;

/// Time that a controller may take to end after its run.
const END_TIMEOUT: Duration = Duration::from_secs(5);
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Arguments of a controller process.
#[derive(Clone, Debug)]
pub struct ControllerArgs {
    /// The policy file; `None` for the shipped policy.
    pub policy: Option<PathBuf>,
    /// Ticks per second.
    pub rate_hz: u32,
    /// Gravity where the leg is, m/s2.
    pub gravity_m_s2: f32,
    /// The domain in which both processes connect.
    pub domain: String,
    /// Options of its control law.
    pub law: Vec<OsString>,
    /// Options of its loop in real time; empty in lock-step.
    pub real_time: Vec<OsString>,
}

impl ControllerArgs {
    /// Returns the command-line arguments for the `controller` program.
    #[must_use]
    pub fn arguments(&self) -> Vec<OsString> {
        let mut arguments: Vec<OsString> = vec!["--once".into(), "--json".into()];
        if let Some(policy) = &self.policy {
            arguments.extend(["--policy".into(), policy.into()]);
        }
        for (flag, value) in [
            ("--rate", self.rate_hz.to_string()),
            ("--gravity", self.gravity_m_s2.to_string()),
            ("--domain", self.domain.clone()),
        ] {
            arguments.extend([flag.into(), value.into()]);
        }
        arguments.extend(self.law.iter().chain(&self.real_time).cloned());
        arguments
    }
}

/// The part of the controller's final output that is used here.
#[derive(Debug, Deserialize)]
struct Summary {
    #[serde(rename = "loop")]
    real_time: Option<LoopReport>,
}

/// A running controller process. Dropping the value sends SIGTERM, after a second
/// SIGKILL, and reaps the process.
#[derive(Debug)]
pub struct ControllerChild {
    child: Child,
    status: Option<ExitStatus>,
}

impl ControllerChild {
    /// Starts this program with the subcommand `controller`. It shares this
    /// process's stderr.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub fn spawn(args: &ControllerArgs) -> io::Result<Self> {
        Self::spawn_program(&leg_process::program::current()?, args)
    }

    /// Like [`ControllerChild::spawn`], with the path of the `sim-host` program.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub fn spawn_program(program: &Path, args: &ControllerArgs) -> io::Result<Self> {
        let child = Command::new(program)
            .arg("controller")
            .args(args.arguments())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        Ok(Self { child, status: None })
    }

    /// Returns the process id.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Returns the exit status once the process has ended.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.child.try_wait().ok().flatten();
        }
        self.status
    }

    /// Waits until the controller ends, as it does after the run, and kills it
    /// after 5 s. Returns its exit status and, in real time, the report of its loop.
    ///
    /// # Errors
    /// If the process cannot be killed or waited for.
    pub fn finish(mut self) -> io::Result<(ExitStatus, Option<LoopReport>)> {
        if !self.wait(END_TIMEOUT) {
            self.child.kill()?;
        }
        // Returns the stored status if the process is reaped already.
        let status = self.child.wait()?;
        self.status = Some(status);
        // The output is smaller than a pipe's buffer, so the controller never blocks on it.
        let mut summary = String::new();
        if let Some(pipe) = &mut self.child.stdout {
            pipe.read_to_string(&mut summary)?;
        }
        let summary: Option<Summary> = serde_json::from_str(&summary).ok();
        Ok((status, summary.and_then(|summary| summary.real_time)))
    }

    /// Waits for the end; returns false after `timeout`.
    fn wait(&mut self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        while self.ended().is_none() {
            if Instant::now() >= deadline {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    }
}

impl Drop for ControllerChild {
    fn drop(&mut self) {
        if self.ended().is_some() {
            return;
        }
        // On SIGTERM it cleans up its shared memory.
        let signalled = i32::try_from(self.child.id())
            .ok()
            .and_then(Pid::from_raw)
            .is_some_and(|pid| kill_process(pid, Signal::TERM).is_ok());
        if !(signalled && self.wait(Duration::from_secs(1))) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}
