//! The results of the injections: counts and times.

use std::fmt;
use std::time::Duration;

use super::injection::{Injection, Kind};
use super::process::Role;

/// Upper ends of the histogram's bins, ms.
const BINS_MS: [u64; 10] = [2, 5, 10, 20, 50, 100, 200, 300, 500, 1000];
/// Width of the longest bar, characters.
const WIDTH: usize = 50;

/// An injection that was survived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recovery {
    pub(super) injection: Injection,
    /// Ticks from the target's last message to the safe state of its peer.
    pub(super) ticks_until_safe: u64,
    /// Time from the return of the target to the peer's report of it.
    pub(super) reconnected_after: Duration,
}

#[derive(Debug, Default)]
pub(super) struct Report {
    recoveries: Vec<Recovery>,
}

impl Report {
    pub(super) fn push(&mut self, recovery: Recovery) {
        self.recoveries.push(recovery);
    }

    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<36} {:>6} {:>9} {:>16} {:>27}",
            "", "count", "at start", "safe after", "back after p50, p99, max"
        )?;
        for target in [Role::Leg, Role::Controller] {
            for kind in Kind::ALL {
                let of_kind: Vec<_> = self
                    .recoveries
                    .iter()
                    .filter(|r| r.injection.target == target && r.injection.kind == kind)
                    .collect();
                let at_start = of_kind
                    .iter()
                    .filter(|r| r.injection.killed_at_start.is_some() && kind.ends())
                    .count();
                let ticks = of_kind.iter().map(|r| r.ticks_until_safe).max().unwrap_or(0);
                let mut back: Vec<_> = of_kind.iter().map(|r| ms(r.reconnected_after)).collect();
                back.sort_by(f64::total_cmp);
                writeln!(
                    f,
                    "{:<36} {:>6} {:>9} {:>10} ticks {:>9.1} {:>7.1} {:>6.1} ms",
                    format!("the {target} {kind}"),
                    of_kind.len(),
                    at_start,
                    ticks,
                    quantile(&back, 0.5),
                    quantile(&back, 0.99),
                    quantile(&back, 1.0)
                )?;
            }
        }
        Ok(())
    }

    fn histogram(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\ntime from the return of a process until its peer reports it:")?;
        let mut counts = [0_usize; BINS_MS.len()];
        for recovery in &self.recoveries {
            let time_ms = ms(recovery.reconnected_after);
            let bin = BINS_MS.iter().position(|end| time_ms <= *end as f64);
            counts[bin.unwrap_or(BINS_MS.len() - 1)] += 1;
        }
        let most = counts.iter().copied().max().unwrap_or(0).max(1);
        for (end, count) in BINS_MS.iter().zip(counts) {
            let bar = "#".repeat((count * WIDTH).div_ceil(most));
            writeln!(f, "  up to {end:>4} ms {count:>5}  {bar}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.table(f)?;
        self.histogram(f)
    }
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Returns a quantile of sorted values, zero of none.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((last as f64 * share).round() as usize).copied().unwrap_or(0.0)
}
