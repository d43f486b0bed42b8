//! How long the controller takes to answer.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest round trip told apart from longer ones.
const LONGEST_NS: u64 = 60_000_000_000;

/// Round-trip times of a run.
#[derive(Clone, Debug)]
pub struct RoundTrips(Histogram<u64>);

/// Their quantiles, us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RoundTripUs {
    /// Half are shorter.
    pub p50: f64,
    /// One in a hundred is longer.
    pub p99: f64,
    /// One in a thousand is longer.
    pub p99_9: f64,
    /// The longest.
    pub max: f64,
}

impl Default for RoundTrips {
    fn default() -> Self {
        Self(Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("bounds that the library takes"))
    }
}

impl RoundTrips {
    /// Takes in one.
    pub fn record(&mut self, time: Duration) {
        self.0.saturating_record(time.as_nanos().min(u128::from(LONGEST_NS)) as u64);
    }

    /// Those of a loop in real time.
    pub(super) fn of(times_ns: &Histogram<u64>) -> Self {
        Self(times_ns.clone())
    }

    /// The quantiles.
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
