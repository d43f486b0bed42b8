//! What a loop tells of a tick.

use serde::{Deserialize, Serialize};

/// What a tick has heard of the peer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Word {
    /// Nothing yet, and nothing is expected: before a run, or after.
    #[default]
    Idle,
    /// That its run is over, and another may come.
    Farewell,
    /// Nothing new.
    Stale,
    /// Something new that counts.
    New,
}

/// What a loop has counted since it began. Carried by every [`Row`], so that
/// the counts are right whatever becomes of a row.
///
/// `ticks = idle + heard + stale + missed`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Ticks of the clock.
    pub ticks: u64,
    /// Of these, ticks outside a run: before the peer was first heard, or after its farewell.
    pub idle: u64,
    /// Of these, ticks with a new message that counted.
    pub heard: u64,
    /// Of these, ticks of a run without a new message.
    pub stale: u64,
    /// Of these, ticks slept through.
    pub missed: u64,
    /// Ticks that began later than a tenth of a tick after their instant.
    pub late: u64,
    /// Ticks that ended after the next one's instant.
    pub deadline_misses: u64,
    /// Ticks that had the processor for longer than a tick; whatever else is
    /// late, the machine has made late. (A virtual machine that stands still
    /// without knowing it counts here too.)
    pub own_overruns: u64,
    /// Ticks under a safe command.
    pub safe: u64,
    /// Longest time from the begin of one tick to that of the next, ns.
    pub longest_gap_ns: u64,
    /// Rows that found no room, and are missing in the histograms.
    pub dropped_rows: u64,
}

/// What a loop tells of a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// When it began, ns of the clock.
    pub woke_ns: u64,
    /// How late it began, ns.
    pub lateness_ns: u64,
    /// How long it took, ns.
    pub work_ns: u64,
    /// How old the newest sample is (controller), or the sample that the command
    /// in force answers (leg), ns.
    pub sample_age_ns: Option<u64>,
    /// From a sample to its command, ns: until the leg has it (leg), until it is
    /// sent (controller).
    pub round_trip_ns: Option<u64>,
    /// What was heard.
    pub word: Word,
    /// Whether a safe command is in force.
    pub safe: bool,
    /// The run.
    pub run_id: u32,
    /// The tick of the run that the leg played last, or the number of the sample
    /// that the controller answered last.
    pub seq: u64,
    /// All counts so far, this tick's included.
    pub counters: Counters,
}
