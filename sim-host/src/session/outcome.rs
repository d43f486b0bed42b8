//! The result of a run, of any session.

use serde::Serialize;

use super::timing::{RoundTripUs, RoundTrips};
use crate::faults::FaultCount;
use leg_plant::Body;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// The duration was over.
    Duration,
    /// The distance was reached.
    Distance,
    /// The leg fell.
    Fall,
    /// The user stopped it, or its link failed.
    Stopped,
}

/// Result of a run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Why the run ended.
    pub ending: Ending,
    /// Falls after which the leg was put back to its start.
    pub restarts: u32,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Wall time, s.
    pub wall_time_s: f64,
    /// Distance from the start along x, m.
    pub distance_m: f64,
    /// The state at the end.
    pub body: Body,
    /// Touchdowns.
    pub touchdowns: u64,
    /// Apexes.
    pub apexes: u64,
    /// Ticks under a safe command of the controller or of the leg itself.
    pub safe_ticks: u64,
    /// Ticks without a new command; none in lock-step.
    pub held_ticks: u64,
    /// Times that the leg changed to its own safe command.
    pub silences: u64,
    /// Samples that the controller rejected, according to its last command.
    pub rejected: u32,
    /// Commands rejected: of another version or run, out of order, too old, or not
    /// finite.
    pub foreign_commands: u64,
    /// Hash of all states and commands.
    pub state_hash: u64,
    /// Counts of each fault.
    pub faults: Vec<FaultCount>,
    /// Round-trip times of the commands.
    pub round_trips: RoundTrips,
}

impl Outcome {
    /// Returns the ticks per second of wall time.
    #[must_use]
    pub fn ticks_per_s(&self) -> f64 {
        self.ticks as f64 / self.wall_time_s
    }

    /// Returns whether every tick was under a safe command.
    #[must_use]
    pub fn all_safe(&self) -> bool {
        self.ticks > 0 && self.safe_ticks == self.ticks
    }

    /// Returns the serialisable report.
    #[must_use]
    pub fn report(&self) -> RunReport {
        RunReport {
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

/// The values of an [`Outcome`] under the names that scripts read.
#[derive(Clone, Debug, Serialize)]
pub struct RunReport {
    /// Why the run ended.
    pub ending: Ending,
    /// Falls; more than one if a fallen leg is put back to its start.
    pub falls: u32,
    /// Touchdowns.
    pub hops: u64,
    /// Apexes.
    pub apexes: u64,
    /// Distance from the start along x, m.
    pub distance_m: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Ticks per second of wall time.
    pub ticks_per_s: f64,
    /// Ticks under a safe command.
    pub safe_ticks: u64,
    /// Ticks without a new command.
    pub held_ticks: u64,
    /// Times that the leg changed to its own safe command.
    pub silences: u64,
    /// Samples that the controller rejected.
    pub rejected: u32,
    /// From sending a sample to receiving its command.
    pub round_trip_us: RoundTripUs,
    /// Hash of every state and command, hexadecimal.
    pub state_hash: String,
    /// Counts of each fault.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultCount>,
}
