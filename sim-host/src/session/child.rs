//! A controller in a process of its own, started by this one.

use std::ffi::OsString;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use leg_host::realtime::LoopReport;
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;

/// How long a controller may take to end after its run.
const PATIENCE: Duration = Duration::from_secs(5);
const LOOK: Duration = Duration::from_millis(2);

/// What a controller is started with.
#[derive(Clone, Debug)]
pub struct ControllerCall {
    /// The policy blob; the controller's own choice when none.
    pub policy: Option<PathBuf>,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Gravity where the leg is, m/s2.
    pub gravity_m_s2: f32,
    /// The domain to meet in.
    pub domain: String,
    /// Its patience with this process.
    pub timeout: Duration,
    /// The options of a loop in real time; none in lock-step.
    pub real_time: Vec<OsString>,
}

impl ControllerCall {
    /// The arguments of the `controller` program that say this.
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
            ("--timeout", self.timeout.as_secs_f64().to_string()),
        ] {
            arguments.extend([flag.into(), value.into()]);
        }
        arguments.extend(self.real_time.iter().cloned());
        arguments
    }
}

/// What a controller prints at its end, as far as it is of use here.
#[derive(Debug, Deserialize)]
struct Summary {
    #[serde(rename = "loop")]
    real_time: Option<LoopReport>,
}

/// A running controller process. It never outlives this value: when dropped,
/// it is asked to end, then made to, and always reaped.
#[derive(Debug)]
pub struct ControllerChild {
    child: Child,
    status: Option<ExitStatus>,
}

impl ControllerChild {
    /// Starts this program again, as `… controller <arguments>`. Its errors go
    /// to this process's stderr, its summary to [`ControllerChild::finish`].
    ///
    /// # Errors
    /// When the program cannot be started.
    pub fn spawn(call: &ControllerCall) -> io::Result<Self> {
        Self::spawn_program(&std::env::current_exe()?, call)
    }

    /// As [`ControllerChild::spawn`], of a `sim-host` at a given place.
    ///
    /// # Errors
    /// When the program cannot be started.
    pub fn spawn_program(program: &Path, call: &ControllerCall) -> io::Result<Self> {
        let child = Command::new(program)
            .arg("controller")
            .args(call.arguments())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        Ok(Self { child, status: None })
    }

    /// Its process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.child.try_wait().ok().flatten();
        }
        self.status
    }

    /// Waits for it to end by itself, as it does when the run is over; after
    /// some seconds it is made to. How it ended, and in real time the figures of
    /// its loop.
    ///
    /// # Errors
    /// When the system cannot tell.
    pub fn finish(mut self) -> io::Result<(ExitStatus, Option<LoopReport>)> {
        if !self.wait(PATIENCE) {
            self.child.kill()?;
        }
        // Reaped already, this only says again how it ended.
        let status = self.child.wait()?;
        self.status = Some(status);
        // Small beside what a pipe holds: it need not be read while the controller runs.
        let mut summary = String::new();
        if let Some(pipe) = &mut self.child.stdout {
            pipe.read_to_string(&mut summary)?;
        }
        let summary: Option<Summary> = serde_json::from_str(&summary).ok();
        Ok((status, summary.and_then(|summary| summary.real_time)))
    }

    /// Whether it has ended within `patience`.
    fn wait(&mut self, patience: Duration) -> bool {
        let deadline = Instant::now() + patience;
        while self.ended().is_none() {
            if Instant::now() >= deadline {
                return false;
            }
            std::thread::sleep(LOOK);
        }
        true
    }
}

impl Drop for ControllerChild {
    fn drop(&mut self) {
        if self.ended().is_some() {
            return;
        }
        // Politely first: it then leaves the shared memory in order.
        let asked = i32::try_from(self.child.id())
            .ok()
            .and_then(Pid::from_raw)
            .is_some_and(|pid| kill_process(pid, Signal::TERM).is_ok());
        if !(asked && self.wait(Duration::from_secs(1))) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}
