//! `controller swap` and `controller status`: what a running controller is told
//! and asked.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant, UNIX_EPOCH};
use std::{fmt, io};

use serde::de::DeserializeOwned;

use super::{Meeting, say};
use crate::Role;
use crate::TimeMode;
use crate::desk::requests::{Activity, Moment, Request, Status, Swapping};
use crate::desk::{self, AskError};
use crate::discovery::DomainError;
use leg_process::policy_file::{PolicyFile, PolicyFileError};
use leg_process::stdout;

/// Between two looks whether a swap is in force.
const LOOK: Duration = Duration::from_millis(10);

/// Has a running controller go on with another policy, from the leg's next apex.
#[derive(Clone, Debug, clap::Args)]
pub struct SwapArgs {
    /// The policy blob; the controller checks it before anything changes.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Which controller, and how long to wait for the apex.
    #[command(flatten)]
    meeting: Meeting,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Shows how a running controller is doing.
#[derive(Clone, Debug, clap::Args)]
pub struct StatusArgs {
    /// Which controller, and how long to wait for its answer.
    #[command(flatten)]
    meeting: Meeting,
    /// Print all of it as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Why an order came to nothing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OrderError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] PolicyFileError),
    /// The controller cannot be asked, or will not.
    #[error(transparent)]
    Ask(#[from] AskError),
    /// The result cannot be printed.
    #[error("cannot print the result: {0}")]
    Json(#[from] serde_json::Error),
    /// The result cannot be printed.
    #[error("cannot print the result: {0}")]
    Print(#[from] io::Error),
}

impl OrderError {
    fn is_misuse(&self) -> bool {
        matches!(
            self,
            Self::File(_)
                | Self::Ask(AskError::Refused(_) | AskError::Domain(DomainError::Name(_)))
        )
    }
}

fn report(done: Result<(), OrderError>) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&error);
            ExitCode::from(if error.is_misuse() { 2 } else { 1 })
        }
    }
}

fn ask<R: DeserializeOwned>(meeting: &Meeting, request: &Request) -> Result<R, AskError> {
    desk::ask(meeting.domain(), Role::Controller, request, meeting.timeout())
}

/// `controller swap`; gives the exit status.
pub(super) fn swap(args: &SwapArgs) -> ExitCode {
    report(try_swap(args))
}

fn try_swap(args: &SwapArgs) -> Result<(), OrderError> {
    let SwapArgs { file, meeting, json } = args;
    let blob = PolicyFile::read(file)?.as_slice().to_vec();
    let begun = Instant::now();
    let file = file.display().to_string();
    let swapping: Swapping = ask(meeting, &Request::Swap { file, blob })?;
    let status = loop {
        let status: Status = ask(meeting, &Request::Status)?;
        // Without a leg there is nothing to wait for.
        if status.swaps >= swapping.number
            || status.activity == Activity::Waiting
            || begun.elapsed() >= meeting.timeout()
        {
            break status;
        }
        std::thread::sleep(LOOK);
    };
    if *json {
        stdout::print_line(serde_json::to_string(&status)?)?;
        return Ok(());
    }
    let Swapping { policy, instead_of, .. } = &swapping;
    let outcome = if status.swaps >= swapping.number {
        let at = status.since.map_or_else(String::new, |at| format!(" from {}", Tick(at)));
        format!("runs{at}, instead of {} ({})", instead_of.name, instead_of.crc32)
    } else if status.activity == Activity::Waiting {
        "is taken, and runs as soon as a leg comes".to_owned()
    } else {
        let waited_s = begun.elapsed().as_secs_f64();
        format!("is taken, and still waits for an apex after {waited_s:.1} s")
    };
    stdout::print_line(format_args!("the policy {} ({}) {outcome}", policy.name, policy.crc32))?;
    Ok(())
}

/// `controller status`; gives the exit status.
pub(super) fn status(args: &StatusArgs) -> ExitCode {
    report(try_status(args))
}

fn try_status(args: &StatusArgs) -> Result<(), OrderError> {
    let status: Status = ask(&args.meeting, &Request::Status)?;
    if args.json {
        stdout::print_line(serde_json::to_string(&status)?)?;
    } else {
        stdout::print_line(Table(&status))?;
    }
    Ok(())
}

/// A moment in words.
struct Tick(Moment);

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {} of run {}", self.0.seq, self.0.run_id)
    }
}

/// A status in lines.
struct Table<'a>(&'a Status);

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = self.0;
        let pace = if s.pace == TimeMode::RealTime { "in real time" } else { "in lock-step" };
        writeln!(
            f,
            "controller  process {}, {} Hz {pace}, {} m/s2",
            s.pid, s.rate_hz, s.gravity_m_s2
        )?;
        let activity = match s.activity {
            Activity::Waiting => "waits for a leg",
            Activity::Safe => "in its safe state",
            Activity::Running => "runs",
        };
        let peer = s.peer.pid.map_or_else(String::new, |pid| format!(", process {pid}"));
        writeln!(
            f,
            "state       {activity}{peer}; legs met {}, lost {}",
            s.peer.connections, s.peer.losses
        )?;
        let p = &s.policy;
        writeln!(f, "policy      {} ({}), from {}", p.name, p.crc32, p.file)?;
        writeln!(f, "            {}", p.provenance)?;
        let ago_s = UNIX_EPOCH.elapsed().unwrap_or_default().as_secs_f64() - s.since_unix_s;
        write!(f, "since       {ago_s:.1} s")?;
        match s.since {
            Some(at) => writeln!(f, ", {}; swaps {}", Tick(at), s.swaps)?,
            None => writeln!(f, ", no tick yet; swaps {}", s.swaps)?,
        }
        if let Some(next) = &s.pending {
            writeln!(f, "next        {} ({}), at the next apex", next.name, next.crc32)?;
        }
        if let Some(last) = s.last {
            let ticks = s.ticks;
            writeln!(f, "ticks       {ticks}, the last {}; apexes {}", Tick(last), s.apexes)?;
        }
        let r = &s.rejected;
        writeln!(
            f,
            "rejected    {}, of these missing {}, stale {}; safe state entered {} times",
            r.ticks, r.missing, r.stale, r.safe_entered
        )?;
        if let Some(report) = &s.timing {
            writeln!(f, "loop        {}", report.line())?;
        }
        Ok(())
    }
}
