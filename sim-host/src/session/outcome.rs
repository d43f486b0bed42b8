//! What a run came to, whatever session played it.

use serde::Serialize;

use super::timing::{RoundTripUs, RoundTrips};
use crate::faults::FaultCount;
use leg_plant::Body;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// Its time was over.
    Duration,
    /// It had come as far as it should.
    Distance,
    /// The leg fell.
    Fall,
    /// It was told to stop, or its link broke.
    Stopped,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Why it ended.
    pub ending: Ending,
    /// Falls after which it was put back to its start.
    pub restarts: u32,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Real time, s.
    pub wall_time_s: f64,
    /// Way from the start along x, m.
    pub distance_m: f64,
    /// The state at the end.
    pub body: Body,
    /// Times that the foot came down.
    pub touchdowns: u64,
    /// Apexes.
    pub apexes: u64,
    /// Ticks under a safe command, the controller's or the leg's own.
    pub safe_ticks: u64,
    /// Ticks for which no new command had come; in lock-step none.
    pub held_ticks: u64,
    /// Times that the leg took its own safe command, for want of another.
    pub silences: u64,
    /// Samples that the controller's guard rejected, by its last command.
    pub rejected: u32,
    /// Commands dropped: of another version or run, out of order, too old, or
    /// with a figure that is not finite.
    pub foreign_commands: u64,
    /// Hash of every state and command.
    pub state_hash: u64,
    /// What each fault did.
    pub faults: Vec<FaultCount>,
    /// How long the answers took.
    pub round_trips: RoundTrips,
}

impl Outcome {
    /// Ticks a second of real time.
    #[must_use]
    pub fn ticks_per_s(&self) -> f64 {
        self.ticks as f64 / self.wall_time_s
    }

    /// Whether the controller sent its safe command throughout.
    #[must_use]
    pub fn all_safe(&self) -> bool {
        self.ticks > 0 && self.safe_ticks == self.ticks
    }

    /// The figures, for a script.
    #[must_use]
    pub fn report(&self) -> Report {
        Report {
            ending: self.ending,
            falls: self.restarts + u32::from(self.ending == Ending::Fall),
            hops: self.touchdowns,
            apexes: self.apexes,
            distance_m: self.distance_m,
            ticks: self.ticks,
            sim_time_s: self.sim_time_s,
            ticks_per_s: self.ticks_per_s(),
            safe_ticks: self.safe_ticks,
            held_ticks: self.held_ticks,
            silences: self.silences,
            rejected: self.rejected,
            round_trip_us: self.round_trips.quantiles_us(),
            state_hash: format!("{:016x}", self.state_hash),
            faults: self.faults.clone(),
        }
    }
}

/// The figures of an [`Outcome`], by the names that scripts read.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Why the run ended.
    pub ending: Ending,
    /// Falls: more than one where a leg that falls is put back to its start.
    pub falls: u32,
    /// Times that the foot came down.
    pub hops: u64,
    /// Apexes.
    pub apexes: u64,
    /// Way along x, m.
    pub distance_m: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Ticks a second of real time.
    pub ticks_per_s: f64,
    /// Ticks under a safe command.
    pub safe_ticks: u64,
    /// Ticks for which no new command had come.
    pub held_ticks: u64,
    /// Times that the leg took its own safe command.
    pub silences: u64,
    /// Samples that the controller's guard rejected.
    pub rejected: u32,
    /// Time from sample to command.
    pub round_trip_us: RoundTripUs,
    /// Hash of every state and command, hexadecimal.
    pub state_hash: String,
    /// What each fault did.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultCount>,
}
