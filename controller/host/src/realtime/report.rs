//! The figures of a loop: for a script, for a person, and for one line.

use std::fmt;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

use super::row::Counters;

/// Quantiles of a time, us; 0 where nothing was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QuantilesUs {
    /// Half are shorter.
    pub p50: f64,
    /// One in ten is longer.
    pub p90: f64,
    /// One in a hundred is longer.
    pub p99: f64,
    /// One in a thousand is longer.
    pub p99_9: f64,
    /// The longest.
    pub max: f64,
    /// How many were measured.
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

/// A bar of a histogram: the ticks above the bar before it, up to this.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bar {
    /// Upper end, us.
    pub up_to_us: f64,
    /// How many.
    pub ticks: u64,
}

/// Bars at 1, 2, 5, 10, 20, … us, from the first to the last that is not empty.
pub(super) fn bars(times_ns: &Histogram<u64>) -> Vec<Bar> {
    if times_ns.is_empty() {
        return Vec::new();
    }
    let mut bars = Vec::new();
    let mut below = 0;
    for decade in 0..8 {
        for step in [1_u64, 2, 5] {
            let up_to_us = step * 10_u64.pow(decade);
            let ticks = times_ns.count_between(0, up_to_us * 1000) - below;
            below += ticks;
            if ticks > 0 || !bars.is_empty() {
                bars.push(Bar { up_to_us: up_to_us as f64, ticks });
            }
            if below == times_ns.len() {
                return bars;
            }
        }
    }
    bars
}

/// The figures of a loop. In JSON by these names, the counters among them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoopReport {
    /// Whose: `leg` or `controller`.
    pub role: String,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Since the first tick, s.
    pub time_s: f64,
    /// Whether the last tick had a new message.
    pub is_heard: bool,
    /// Whether a safe command is in force.
    pub is_safe: bool,
    /// What was counted.
    #[serde(flatten)]
    pub counters: Counters,
    /// How late ticks began.
    pub lateness_us: QuantilesUs,
    /// How long they took.
    pub tick_time_us: QuantilesUs,
    /// How old the sample was that a tick went by: the newest one (controller),
    /// the one that the command in force answers (leg).
    pub sample_age_us: QuantilesUs,
    /// From a sample to its command: until the leg has it at one of its ticks
    /// (leg), until it is sent (controller).
    pub round_trip_us: QuantilesUs,
    /// [`LoopReport::lateness_us`] as bars.
    pub lateness_histogram: Vec<Bar>,
}

impl LoopReport {
    /// The figures in one line, for a live view.
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

/// A time in us with three digits and the unit that suits it.
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
            (if is_leg { "age of the answered" } else { "age of the sample" }, &self.sample_age_us),
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
            "  ticks {}: {} heard, {} stale, {} missed, {} idle",
            c.ticks, c.heard, c.stale, c.missed, c.idle
        )?;
        write!(
            f,
            "  late {}, deadlines missed {} ({} while at work on the processor), longest gap {}, safe {}",
            c.late,
            c.deadline_misses,
            c.own_overruns,
            with_unit(c.longest_gap_ns as f64 * 1e-3),
            c.safe
        )?;
        if c.dropped_rows > 0 {
            write!(f, "\n  {} rows found no room: not in the times above", c.dropped_rows)?;
        }
        Ok(())
    }
}
