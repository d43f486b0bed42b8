//! The options of `sim-host run`.

use std::ffi::OsString;
use std::path::PathBuf;

use leg_host::cli::Meeting;
use leg_host::realtime::args::{RealTimeArgs, parse_cpu};

use crate::cli::recording::RecordArgs;
use crate::scenario::Settings;
use crate::session::real_time::{OnFall, Options};

/// Plays a scenario with a controller, in lock-step or in real time.
///
/// Of the result: hops are touchdowns. Apexes are those of the leg's path; the controller also
/// counts the start, if the leg falls from it, and not one in the last tick, so that its count may
/// differ by one. Ticks in the safe state are those before the first apex, when the leg waits
/// upright for the controller's first decision, and those without a valid message for 10 ms.
/// Rejected samples are those that the controller's guard did not use: missing, stale (the same
/// again) or not plausible.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Read the scenario from this TOML file; options override its values.
    #[arg(long, value_name = "FILE")]
    pub(super) scenario: Option<PathBuf>,
    #[command(flatten)]
    pub(super) settings: Settings,
    #[command(flatten)]
    pub(super) meeting: Meeting,
    /// Start the controller too, in its own process; without --domain, in a domain of its own.
    #[arg(long, conflicts_with = "in_process")]
    pub(super) spawn: bool,
    /// Run the controller in this process, without shared memory.
    #[arg(long)]
    pub(super) in_process: bool,
    /// Policy file for --spawn or --in-process [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    pub(super) policy: Option<PathBuf>,
    #[command(flatten)]
    pub(super) recording: RecordArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) real_time: RealTime,
}

/// Options of a run in real time.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub(super) struct RealTime {
    #[command(flatten)]
    pub(super) clock: RealTimeArgs,
    /// Processor for the loop of a controller that this program starts.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = parse_cpu
    )]
    pub(super) controller_cpu: Option<usize>,
    /// After a fall, end the run, or put the leg back to its start and count the
    /// fall.
    #[arg(long, value_enum, default_value_t, requires = "real_time")]
    on_fall: OnFall,
}

impl Args {
    /// Returns the domain in which leg and controller connect.
    pub(super) fn domain(&self) -> String {
        if self.spawn && self.meeting.domain.domain.is_none() {
            // A domain per process, so that runs at the same time do not connect to each other.
            format!("run-{}", std::process::id())
        } else {
            self.meeting.domain().to_owned()
        }
    }
}

impl RealTime {
    pub(super) fn is_on(&self) -> bool {
        self.clock.real_time
    }

    /// Returns the options of a controller that this program starts.
    pub(super) fn controller_arguments(&self) -> Vec<OsString> {
        self.clock.arguments(self.controller_cpu)
    }

    /// Returns the options of the leg's session.
    pub(super) fn session_options(&self, run_id: u32) -> Options {
        Options { run_id, on_fall: self.on_fall }
    }
}
