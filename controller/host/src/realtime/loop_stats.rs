//! Aggregation of tick records.

use hdrhistogram::Histogram;

use super::report::{LoopReport, QuantilesUs, bins};
use super::tick_stats::{LoopCounters, RxStatus, TickStats};
use crate::link::Role;

/// Longest time that the histograms distinguish, ns.
const MAX_NS: u64 = 60_000_000_000;

/// The histograms of a loop, to three significant digits, and its latest counters.
#[derive(Clone, Debug)]
pub struct LoopStats {
    role: Role,
    rate_hz: u32,
    began_ns: Option<u64>,
    last: TickStats,
    lateness_ns: Histogram<u64>,
    tick_time_ns: Histogram<u64>,
    sample_age_ns: Histogram<u64>,
    round_trip_ns: Histogram<u64>,
}

impl LoopStats {
    /// Creates empty statistics of the loop of `role`.
    #[must_use]
    pub fn new(role: Role, rate_hz: u32) -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, MAX_NS, 3).expect("bounds that the library accepts");
        Self {
            role,
            rate_hz,
            began_ns: None,
            last: TickStats::default(),
            lateness_ns: histogram(),
            tick_time_ns: histogram(),
            sample_age_ns: histogram(),
            round_trip_ns: histogram(),
        }
    }

    /// Adds the record of a tick.
    pub fn add(&mut self, tick: &TickStats) {
        self.began_ns.get_or_insert(tick.woke_ns);
        self.last = *tick;
        self.lateness_ns.saturating_record(tick.lateness_ns);
        self.tick_time_ns.saturating_record(tick.work_ns);
        if let Some(age_ns) = tick.sample_age_ns {
            self.sample_age_ns.saturating_record(age_ns);
        }
        if let Some(time_ns) = tick.round_trip_ns {
            self.round_trip_ns.saturating_record(time_ns);
        }
    }

    /// Sets the final counters of a loop that has ended.
    pub(super) fn set_counters(&mut self, counters: LoopCounters) {
        self.last.counters = counters;
    }

    /// Returns the histogram of times from sample to command, ns.
    #[must_use]
    pub fn round_trips_ns(&self) -> &Histogram<u64> {
        &self.round_trip_ns
    }

    /// Returns the report on all ticks so far.
    #[must_use]
    pub fn report(&self) -> LoopReport {
        let TickStats { woke_ns, rx, safe, counters, .. } = self.last;
        LoopReport {
            role: self.role.as_str().to_owned(),
            rate_hz: self.rate_hz,
            time_s: 1e-9 * woke_ns.saturating_sub(self.began_ns.unwrap_or(woke_ns)) as f64,
            is_receiving: rx == RxStatus::New,
            is_safe: safe,
            counters,
            lateness_us: QuantilesUs::of(&self.lateness_ns),
            tick_time_us: QuantilesUs::of(&self.tick_time_ns),
            sample_age_us: QuantilesUs::of(&self.sample_age_ns),
            round_trip_us: QuantilesUs::of(&self.round_trip_ns),
            lateness_histogram: bins(&self.lateness_ns),
        }
    }
}
