//! What a loop records about each tick.

use serde::{Deserialize, Serialize};

/// What a tick has received from the peer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RxStatus {
    /// No message, and none is expected: no run has begun, or the last one is over.
    #[default]
    Idle,
    /// The message that the peer's run is over.
    EndOfRun,
    /// No message newer than the last one.
    Stale,
    /// A new message that counts.
    New,
}

/// The counters of a loop since its start.
///
/// Each [`TickStats`] carries all of them, so that they stay correct when records are
/// dropped. `ticks = idle + received + stale + missed`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoopCounters {
    /// Ticks of the schedule.
    pub ticks: u64,
    /// Of these, ticks outside a run: before the first message of the peer or after the
    /// end of its run.
    pub idle: u64,
    /// Of these, ticks with a new message that counted.
    pub received: u64,
    /// Of these, ticks in a run without a new message.
    pub stale: u64,
    /// Of these, ticks whose whole period passed while the loop slept.
    pub missed: u64,
    /// Ticks that started later than a tenth of a period after their instant.
    pub late: u64,
    /// Ticks that ended after the instant of the next one.
    pub deadline_misses: u64,
    /// Ticks that used more processor time than a period. Any other deadline miss was
    /// caused by the machine. (A virtual machine that is paused without noticing counts
    /// here too.)
    pub own_overruns: u64,
    /// Ticks under a safe command.
    pub safe: u64,
    /// Longest time from the start of one tick to the start of the next, ns.
    pub longest_gap_ns: u64,
    /// Records that found the ring full and are missing from the histograms.
    pub dropped_records: u64,
}

/// The record of one tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickStats {
    /// Start of the tick, ns of the clock.
    pub woke_ns: u64,
    /// Lateness of the start, ns.
    pub lateness_ns: u64,
    /// Duration of the tick, ns.
    pub work_ns: u64,
    /// Age of the sample that the tick used, ns: the newest one (controller), or the
    /// one that the command in force answers (leg).
    pub sample_age_ns: Option<u64>,
    /// Time from a sample to its command, ns: until the leg has received the command
    /// (leg), or until it is sent (controller).
    pub round_trip_ns: Option<u64>,
    /// What the tick has received.
    pub rx: RxStatus,
    /// Whether a safe command is in force.
    pub safe: bool,
    /// Id of the run.
    pub run_id: u32,
    /// Number of the last tick that the leg simulated, or of the last sample that the
    /// controller answered.
    pub seq: u64,
    /// All counters, including this tick.
    pub counters: LoopCounters,
}
