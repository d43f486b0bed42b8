//! Round-trip times of the controller.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest round trip in the histogram; longer ones count as this.
const MAX_NS: u64 = 60_000_000_000;

/// Histogram of the round-trip times of a run.
#[derive(Clone, Debug)]
pub struct RoundTrips(Histogram<u64>);

/// Quantiles of round-trip times, us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RoundTripUs {
    /// The median.
    pub p50: f64,
    /// The 99th percentile.
    pub p99: f64,
    /// The 99.9th percentile.
    pub p99_9: f64,
    /// The longest.
    pub max: f64,
}

impl Default for RoundTrips {
    fn default() -> Self {
        Self(Histogram::new_with_bounds(1, MAX_NS, 3).expect("valid bounds"))
    }
}

impl RoundTrips {
    /// Adds a round-trip time.
    pub fn record(&mut self, time: Duration) {
        self.0.saturating_record(time.as_nanos().min(u128::from(MAX_NS)) as u64);
    }

    /// Copies the histogram of a loop in real time.
    pub(super) fn of(times_ns: &Histogram<u64>) -> Self {
        Self(times_ns.clone())
    }

    /// Returns the quantiles.
    #[must_use]
    pub fn quantiles_us(&self) -> RoundTripUs {
        let at = |quantile| self.0.value_at_quantile(quantile) as f64 * 1e-3;
        RoundTripUs {
            p50: at(0.5),
            p99: at(0.99),
            p99_9: at(0.999),
            max: self.0.max() as f64 * 1e-3,
        }
    }
}
