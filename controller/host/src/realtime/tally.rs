//! What many rows come to.

use hdrhistogram::Histogram;

use super::super::card::Role;
use super::report::{LoopReport, QuantilesUs, bars};
use super::row::{Counters, Row, Word};

/// Longest time told apart from longer ones, ns.
const LONGEST_NS: u64 = 60_000_000_000;

/// The histograms of a loop, to three digits, and its latest counts.
#[derive(Clone, Debug)]
pub struct Tally {
    role: Role,
    rate_hz: u32,
    began_ns: Option<u64>,
    last: Row,
    lateness_ns: Histogram<u64>,
    tick_time_ns: Histogram<u64>,
    sample_age_ns: Histogram<u64>,
    round_trip_ns: Histogram<u64>,
}

impl Tally {
    /// An empty one.
    #[must_use]
    pub fn new(role: Role, rate_hz: u32) -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("bounds that the library takes");
        Self {
            role,
            rate_hz,
            began_ns: None,
            last: Row::default(),
            lateness_ns: histogram(),
            tick_time_ns: histogram(),
            sample_age_ns: histogram(),
            round_trip_ns: histogram(),
        }
    }

    /// Takes in a row.
    pub fn take(&mut self, row: &Row) {
        self.began_ns.get_or_insert(row.woke_ns);
        self.last = *row;
        self.lateness_ns.saturating_record(row.lateness_ns);
        self.tick_time_ns.saturating_record(row.work_ns);
        if let Some(age_ns) = row.sample_age_ns {
            self.sample_age_ns.saturating_record(age_ns);
        }
        if let Some(time_ns) = row.round_trip_ns {
            self.round_trip_ns.saturating_record(time_ns);
        }
    }

    /// Takes in the last counts of a loop that is over.
    pub(super) fn close(&mut self, counters: Counters) {
        self.last.counters = counters;
    }

    /// The times from sample to command, ns.
    #[must_use]
    pub fn round_trips_ns(&self) -> &Histogram<u64> {
        &self.round_trip_ns
    }

    /// The figures so far.
    #[must_use]
    pub fn report(&self) -> LoopReport {
        let Row { woke_ns, word, safe, counters, .. } = self.last;
        LoopReport {
            role: match self.role {
                Role::Leg => "leg".to_owned(),
                Role::Controller => "controller".to_owned(),
            },
            rate_hz: self.rate_hz,
            time_s: 1e-9 * woke_ns.saturating_sub(self.began_ns.unwrap_or(woke_ns)) as f64,
            is_heard: word == Word::New,
            is_safe: safe,
            counters,
            lateness_us: QuantilesUs::of(&self.lateness_ns),
            tick_time_us: QuantilesUs::of(&self.tick_time_ns),
            sample_age_us: QuantilesUs::of(&self.sample_age_ns),
            round_trip_us: QuantilesUs::of(&self.round_trip_ns),
            lateness_histogram: bars(&self.lateness_ns),
        }
    }
}
