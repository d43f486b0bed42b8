//! What came of it: counts, and how long it took.

use std::fmt;
use std::time::Duration;

use super::actor::Part;
use super::plan::{Blow, How};

/// Upper ends of the histogram's bars, ms.
const BARS_MS: [u64; 10] = [2, 5, 10, 20, 50, 100, 200, 300, 500, 1000];
/// Width of the longest bar.
const WIDTH: usize = 50;

/// A blow that was stood.
#[derive(Clone, Copy, Debug)]
pub(super) struct Incident {
    pub(super) blow: Blow,
    /// From the last message of the peer to the safe state.
    pub(super) ticks: u64,
    /// From the return of the peer until it was heard.
    pub(super) took: Duration,
}

#[derive(Debug, Default)]
pub(super) struct Report {
    incidents: Vec<Incident>,
}

impl Report {
    pub(super) fn take(&mut self, incident: &Incident) {
        self.incidents.push(*incident);
    }

    fn rows(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<22} {:>6} {:>9} {:>16} {:>27}",
            "", "blows", "at start", "safe after", "back after p50, p99, max"
        )?;
        for victim in [Part::Leg, Part::Controller] {
            for how in How::ALL {
                let of_kind: Vec<_> = self
                    .incidents
                    .iter()
                    .filter(|incident| incident.blow.victim == victim && incident.blow.how == how)
                    .collect();
                let at_start = of_kind
                    .iter()
                    .filter(|incident| incident.blow.killed_at_start.is_some() && how.ends())
                    .count();
                let ticks = of_kind.iter().map(|incident| incident.ticks).max().unwrap_or(0);
                let mut took: Vec<_> = of_kind.iter().map(|incident| ms(incident.took)).collect();
                took.sort_by(f64::total_cmp);
                writeln!(
                    f,
                    "{:<22} {:>6} {:>9} {:>10} ticks {:>9.1} {:>7.1} {:>6.1} ms",
                    format!("the {victim} {how}"),
                    of_kind.len(),
                    at_start,
                    ticks,
                    quantile(&took, 0.5),
                    quantile(&took, 0.99),
                    quantile(&took, 1.0)
                )?;
            }
        }
        Ok(())
    }

    fn histogram(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\ntime from the return of the peer until it was heard:")?;
        let mut counts = [0_usize; BARS_MS.len()];
        for incident in &self.incidents {
            let bar = BARS_MS.iter().position(|end| ms(incident.took) <= *end as f64);
            counts[bar.unwrap_or(BARS_MS.len() - 1)] += 1;
        }
        let most = counts.iter().copied().max().unwrap_or(0).max(1);
        for (end, count) in BARS_MS.iter().zip(counts) {
            let bar = "#".repeat((count * WIDTH).div_ceil(most));
            writeln!(f, "  up to {end:>4} ms {count:>5}  {bar}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.rows(f)?;
        self.histogram(f)
    }
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Of sorted figures.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((last as f64 * share).round() as usize).copied().unwrap_or(0.0)
}
