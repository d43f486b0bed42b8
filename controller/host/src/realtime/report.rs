//! The report on a loop: as JSON, as a table, and in one line.

use std::fmt;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

use super::tick_stats::LoopCounters;

/// Quantiles of a time, us; 0 without measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QuantilesUs {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p99_9: f64,
    /// Maximum.
    pub max: f64,
    /// Number of measurements.
    pub count: u64,
}

impl QuantilesUs {
    pub(super) fn of(times_ns: &Histogram<u64>) -> Self {
        let at = |quantile| times_ns.value_at_quantile(quantile) as f64 * 1e-3;
        Self {
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p99_9: at(0.999),
            max: times_ns.max() as f64 * 1e-3,
            count: times_ns.len(),
        }
    }
}

/// A bin of a histogram. Its lower bound is the upper bound of the bin before.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistogramBin {
    /// Upper bound, us, included.
    pub up_to_us: f64,
    /// Number of ticks in the bin.
    pub ticks: u64,
}

/// Returns bins with the upper bounds 1, 2, 5, 10, 20, … us, from the first to the last
/// that is not empty.
pub(super) fn bins(times_ns: &Histogram<u64>) -> Vec<HistogramBin> {
    if times_ns.is_empty() {
        return Vec::new();
    }
    let mut bins = Vec::new();
    let mut below = 0;
    for decade in 0..8 {
        for step in [1_u64, 2, 5] {
            let up_to_us = step * 10_u64.pow(decade);
            let ticks = times_ns.count_between(0, up_to_us * 1000) - below;
            below += ticks;
            if ticks > 0 || !bins.is_empty() {
                bins.push(HistogramBin { up_to_us: up_to_us as f64, ticks });
            }
            if below == times_ns.len() {
                return bins;
            }
        }
    }
    bins
}

/// The report on a loop. In JSON, the counters stand among the other fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoopReport {
    /// Role of the loop: `leg` or `controller`.
    pub role: String,
    /// Tick rate, Hz.
    pub rate_hz: u32,
    /// Time since the first tick, s.
    pub time_s: f64,
    /// Whether the last tick received a new message.
    pub is_receiving: bool,
    /// Whether a safe command is in force.
    pub is_safe: bool,
    /// Counters since the start of the loop.
    #[serde(flatten)]
    pub counters: LoopCounters,
    /// Lateness of the ticks.
    pub lateness_us: QuantilesUs,
    /// Duration of the ticks.
    pub tick_time_us: QuantilesUs,
    /// Age of the sample that a tick used: the newest one (controller), or the one that
    /// the command in force answers (leg).
    pub sample_age_us: QuantilesUs,
    /// Time from a sample to its command: until the leg has received it at one of its
    /// ticks (leg), or until it is sent (controller).
    pub round_trip_us: QuantilesUs,
    /// [`LoopReport::lateness_us`] as a histogram.
    pub lateness_histogram: Vec<HistogramBin>,
}

impl LoopReport {
    /// Formats the report in one line.
    #[must_use]
    pub fn line(&self) -> String {
        let c = &self.counters;
        format!(
            "{:>8.1} s  {} ticks, {} missed, {} stale, {} deadlines missed{}  late p50 {} p99 {} \
             max {}",
            self.time_s,
            c.ticks,
            c.missed,
            c.stale,
            c.deadline_misses,
            if self.is_safe { ", SAFE" } else { "" },
            with_unit(self.lateness_us.p50),
            with_unit(self.lateness_us.p99),
            with_unit(self.lateness_us.max),
        )
    }
}

/// Formats a time, given in us, with three significant digits and a suitable unit.
#[must_use]
pub fn with_unit(us: f64) -> String {
    let (value, unit) = match us {
        us if us < 1000.0 => (us, "us"),
        us if us < 1e6 => (us * 1e-3, "ms"),
        us => (us * 1e-6, "s"),
    };
    let digits = match value {
        value if value < 10.0 => 2,
        value if value < 100.0 => 1,
        _ => 0,
    };
    format!("{value:.digits$} {unit}")
}

impl fmt::Display for LoopReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.counters;
        let is_leg = self.role == "leg";
        writeln!(f, "the {}'s loop, {} Hz for {:.1} s", self.role, self.rate_hz, self.time_s)?;
        writeln!(
            f,
            "  {:<22} {:>9} {:>9} {:>9} {:>9} {:>9}",
            "", "p50", "p90", "p99", "p99.9", "max"
        )?;
        let rows = [
            ("wake-up lateness", &self.lateness_us),
            ("tick time", &self.tick_time_us),
            (if is_leg { "age of answered sample" } else { "sample age" }, &self.sample_age_us),
            (if is_leg { "command round trip" } else { "sample to command" }, &self.round_trip_us),
        ];
        for (name, q) in rows.into_iter().filter(|(_, q)| q.count > 0) {
            write!(f, "  {name:<22}")?;
            for us in [q.p50, q.p90, q.p99, q.p99_9, q.max] {
                write!(f, " {:>9}", with_unit(us))?;
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "  ticks {}: {} received, {} stale, {} missed, {} idle",
            c.ticks, c.received, c.stale, c.missed, c.idle
        )?;
        write!(
            f,
            "  late {}, deadlines missed {} ({} by own overruns), longest gap {}, safe {}",
            c.late,
            c.deadline_misses,
            c.own_overruns,
            with_unit(c.longest_gap_ns as f64 * 1e-3),
            c.safe
        )?;
        if c.dropped_records > 0 {
            write!(f, "\n  {} ticks dropped from the times above", c.dropped_records)?;
        }
        Ok(())
    }
}
