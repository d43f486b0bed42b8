//! The report of a bridge's run: for scripts, and as a table.

use std::fmt;
use std::time::Duration;

use leg_control::serial::message::{DeviceCounts, LineCounts, RunCounts};
use leg_host::serial::Counts;
use serde::Serialize;

use crate::session::{RoundTripUs, RoundTrips};

/// The times of the answers.
#[derive(Clone, Debug, Default)]
pub(super) struct Times {
    round_trips: RoundTrips,
    own: RoundTrips,
}

impl Times {
    /// Records one answer: the time from sample to command, and the bridge's share of it.
    pub(super) fn record(&mut self, round_trip: Duration, own: Duration) {
        self.round_trips.record(round_trip);
        self.own.record(own);
    }

    pub(super) fn round_trips_us(&self) -> RoundTripUs {
        self.round_trips.quantiles_us()
    }

    pub(super) fn own_shares_us(&self) -> RoundTripUs {
        self.own.quantiles_us()
    }
}

/// The report of a run; scripts read these names.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The board.
    pub board: String,
    /// Version of its firmware.
    pub firmware: String,
    /// The policy that ran at the end.
    pub policy: Option<String>,
    /// What made a tick.
    pub mode: String,
    /// Samples answered.
    pub ticks: u64,
    /// Of them in a second of real time.
    pub ticks_per_s: f64,
    /// Time from a sample's arrival at the bridge to its command's departure.
    pub round_trip_us: RoundTripUs,
    /// Of that, what the bridge itself took: until the sample was written to
    /// the line, and from the command's last byte on.
    pub own_share_us: RoundTripUs,
    /// What was sent, retransmissions counted apart.
    pub sent: Counts,
    /// What arrived from the controller.
    pub received: LineCounts,
    /// Times that the line broke and was opened again.
    pub reconnects: u64,
    /// Times that the controller was reset in the middle of the run.
    pub reboots: u64,
    /// Alarms that it raised.
    pub alarms: u64,
    /// Others' requests passed on.
    pub shared_requests: u64,
    /// The controller's own counts; of the line, what arrived there in this run,
    /// or since its last reboot.
    pub controller: ControllerCounts,
}

/// The controller's own counters.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct ControllerCounts {
    /// Frames that it received.
    pub line: LineCounts,
    /// Its ticks.
    #[serde(flatten)]
    pub run: RunCounts,
    /// Its device.
    #[serde(flatten)]
    pub device: DeviceCounts,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let policy = self.policy.as_deref().unwrap_or("none");
        let (us, own) = (self.round_trip_us, self.own_share_us);
        let (sent, here, there) = (self.sent, self.received, self.controller);
        let run = there.run;
        let damaged =
            |line: LineCounts| line.malformed + line.oversize + line.version + line.unknown;
        writeln!(
            f,
            "{} ticks, {:.0} a second, {}, by {} (firmware {}), policy {policy}",
            self.ticks, self.ticks_per_s, self.mode, self.board, self.firmware
        )?;
        writeln!(f, "us               p50       p99     p99.9       max")?;
        for (name, us) in [("round trip", us), ("bridge", own)] {
            writeln!(
                f,
                "{name:<10} {:>9.1} {:>9.1} {:>9.1} {:>9.1}",
                us.p50, us.p99, us.p99_9, us.max
            )?;
        }
        writeln!(f, "line             to controller    to host")?;
        for (name, to_controller, to_host) in [
            ("frames sent", sent.frames_out, None),
            ("frames whole", there.line.frames.into(), Some(here.frames)),
            ("CRC errors", there.line.crc_errors.into(), Some(here.crc_errors)),
            ("other damage", damaged(there.line).into(), Some(damaged(here))),
            ("resyncs", there.line.resyncs.into(), Some(here.resyncs)),
            ("bytes lost", there.device.lost_bytes.into(), None),
        ] {
            let to_host = to_host.map_or_else(|| "-".into(), |count| count.to_string());
            writeln!(f, "{name:<13} {to_controller:>16} {to_host:>10}")?;
        }
        writeln!(
            f,
            "retransmitted: {} samples, {} requests; repeated answers: {}; reconnects {}, reboots {}, \
             alarms {}",
            sent.sample_retries,
            sent.request_retries,
            there.run.repeated,
            self.reconnects,
            self.reboots,
            self.alarms
        )?;
        writeln!(
            f,
            "controller: {} ticks, {} missed, {} overwritten, {} overruns; {} policies swapped in",
            run.ticks, run.missed, run.overwritten, run.overruns, run.swaps
        )?;
        if there.device.stack_size > 0 {
            write!(
                f,
                "deepest stack: {} of {} bytes; ",
                there.device.stack_used, there.device.stack_size
            )?;
        }
        write!(f, "others' requests passed on: {}", self.shared_requests)
    }
}
