//! A process under test, and what it reports on the standard error.

use std::fmt;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use rustix::process::{Pid, Signal, kill_process};

use super::injection::Kind;

/// In the report that the peer sends nothing any more.
const SILENT: &str = "no message from the ";
/// In the report that the peer has ended its run.
const RUN_OVER: &str = "is over: safe command until the next begins";
/// In the report that the peer sends again.
const BACK: &str = "sends again after";

/// What a process plays in the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Leg,
    Controller,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leg => "leg",
            Self::Controller => "controller",
        })
    }
}

/// A line on the standard error.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) at: Instant,
    pub(super) text: String,
}

/// What a process has reported of its peer.
#[derive(Clone, Debug)]
pub(super) enum PeerReport {
    Lost(Line),
    /// Without a line before the first report.
    Present(Option<Line>),
}

impl PeerReport {
    fn from_line(line: &Line) -> Option<Self> {
        if line.text.contains(SILENT) || line.text.contains(RUN_OVER) {
            Some(Self::Lost(line.clone()))
        } else if line.text.contains(BACK) {
            Some(Self::Present(Some(line.clone())))
        } else {
            None
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        matches!(self, Self::Lost(_))
    }

    /// Returns the number of ticks until the safe state: zero when the peer announced
    /// the end of its run, `None` when the report has no number.
    pub(super) fn ticks_until_safe(&self) -> Option<u64> {
        let text = self.to_string();
        if text.contains(RUN_OVER) { Some(0) } else { number_before(&text, " ticks") }
    }
}

impl fmt::Display for PeerReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(line) | Self::Present(Some(line)) => f.write_str(&line.text),
            Self::Present(None) => f.write_str("none"),
        }
    }
}

/// Returns the whole number that stands right before `unit`.
fn number_before(text: &str, unit: &str) -> Option<u64> {
    text.split(unit).next()?.rsplit(' ').next()?.parse().ok()
}

type Lines = Arc<Mutex<Vec<Line>>>;

/// A process that is killed when its value is dropped.
pub(super) struct Process {
    role: Role,
    child: Child,
    lines: Lines,
}

impl Process {
    pub(super) fn start(mut command: Command, role: Role) -> Result<Self> {
        let lines = Lines::default();
        let child = spawn(&mut command, &lines)?;
        Ok(Self { role, child, lines })
    }

    pub(super) fn role(&self) -> Role {
        self.role
    }

    fn lines(&self) -> MutexGuard<'_, Vec<Line>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the last report on the peer; an error if it was made twice in a row.
    fn last_report(&self) -> Result<PeerReport> {
        let mut last = PeerReport::Present(None);
        for line in self.lines().iter() {
            last = match (&last, PeerReport::from_line(line)) {
                (_, None) => continue,
                // A peer that a busy machine keeps from running may end its run next.
                (PeerReport::Lost(silent), Some(PeerReport::Lost(over)))
                    if silent.text.contains(SILENT) && over.text.contains(RUN_OVER) =>
                {
                    PeerReport::Lost(over)
                }
                (PeerReport::Lost(_), Some(PeerReport::Lost(_)))
                | (PeerReport::Present(Some(_)), Some(PeerReport::Present(_))) => {
                    bail!("the {} has reported twice: {}", self.role, line.text)
                }
                (_, Some(next)) => next,
            };
        }
        Ok(last)
    }

    /// Waits until the last report is as wanted and returns it.
    pub(super) fn wait_for_report(
        &self,
        wanted: impl Fn(&PeerReport) -> bool,
        patience: Duration,
    ) -> Result<PeerReport> {
        let begun = Instant::now();
        loop {
            let report = self.last_report()?;
            if wanted(&report) {
                return Ok(report);
            }
            ensure!(begun.elapsed() < patience, "the {}'s last report is: {report}", self.role);
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Returns how often the process has reported that its peer is lost.
    pub(super) fn losses(&self) -> usize {
        let reports = self.lines();
        let reports = reports.iter().filter_map(PeerReport::from_line);
        reports.filter(PeerReport::is_lost).count()
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        kill_process(pid.context("no process")?, signal).context("cannot send the signal")
    }

    /// Injects a failure. A process that ends has ended on return. One that is killed while
    /// it ends is killed so long `after` SIGTERM.
    pub(super) fn inject(&mut self, kind: Kind, after: Duration) -> Result<()> {
        match kind {
            Kind::Stop => return self.signal(Signal::STOP),
            Kind::Kill => self.signal(Signal::KILL)?,
            // A SIGHUP that is ignored here, as under `nohup`, is ignored by the child too.
            Kind::HangUp if hang_up_is_ignored() => self.signal(Signal::TERM)?,
            Kind::HangUp => self.signal(Signal::HUP)?,
            Kind::KillAtEnd => {
                self.signal(Signal::TERM)?;
                std::thread::sleep(after);
                self.signal(Signal::KILL)?;
            }
        }
        ensure!(self.wait(Duration::from_secs(10))?, "the {} does not end", self.role);
        Ok(())
    }

    /// Continues a stopped process; returns when.
    pub(super) fn resume(&self) -> Result<Instant> {
        let now = Instant::now();
        self.signal(Signal::CONT)?;
        Ok(now)
    }

    /// Starts the process again; returns when.
    pub(super) fn restart(&mut self, mut command: Command) -> Result<Instant> {
        let now = Instant::now();
        self.child = spawn(&mut command, &self.lines)?;
        Ok(now)
    }

    /// Fails if the process has ended.
    pub(super) fn ensure_runs(&mut self) -> Result<()> {
        if let Some(status) = self.child.try_wait()? {
            bail!("the {} has ended ({status})", self.role);
        }
        Ok(())
    }

    fn wait(&mut self, patience: Duration) -> Result<bool> {
        let begun = Instant::now();
        while self.child.try_wait()?.is_none() {
            if begun.elapsed() > patience {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        Ok(true)
    }

    /// Sends SIGTERM; returns whether the process has ended in time.
    pub(super) fn end(mut self, patience: Duration) -> Result<bool> {
        self.signal(Signal::TERM)?;
        self.wait(patience)
    }

    /// Returns the last lines of the standard error.
    pub(super) fn tail(&self) -> String {
        let lines = self.lines();
        let texts: Vec<_> = lines.iter().rev().take(12).rev().map(|l| l.text.as_str()).collect();
        format!("last messages of the {}:\n  {}", self.role, texts.join("\n  "))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Returns whether this process ignores SIGHUP.
pub(super) fn hang_up_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & 1 == 1)
}

fn spawn(command: &mut Command, lines: &Lines) -> Result<Child> {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {command:?}"))?;
    let stderr = child.stderr.take().context("no stderr")?;
    let lines = Arc::clone(lines);
    // The thread ends with the process, which closes the pipe.
    std::thread::spawn(move || collect(stderr, &lines));
    Ok(child)
}

fn collect(stderr: impl Read, lines: &Lines) {
    for text in BufReader::new(stderr).lines().map_while(std::io::Result::ok) {
        let line = Line { at: Instant::now(), text };
        lines.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }
}
