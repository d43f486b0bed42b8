//! The estimates of a run against the truth.

use std::collections::VecDeque;

use leg_control::estimator::Estimate;
use leg_plant::Phase;
use serde::Serialize;

use crate::session::TickRecord;

/// Time for which true states are kept, s: the largest age of a measurement that an estimate may
/// be for, and a little more.
const KEPT_S: f64 = 1.25;
/// Ticks between two kept estimates.
const STRIDE: u64 = 40;
/// Standard deviations of the bands.
pub(super) const BAND: f64 = 2.0;

/// The quantities of a state that the controller decides by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quantities<T> {
    /// Horizontal velocity, m/s.
    pub velocity: T,
    /// Height above the ground, m.
    pub height: T,
    /// Density ratio of the medium.
    pub density: T,
}

impl<T> Quantities<T> {
    fn from_array([velocity, height, density]: [T; 3]) -> Self {
        Self { velocity, height, density }
    }
}

/// An estimate of one quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimated {
    /// The estimate.
    pub value: f64,
    /// The standard deviation of its error, as the estimator states it.
    pub deviation: f64,
    /// Estimate less truth.
    pub error: f64,
}

/// An estimate at the time of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatePoint {
    /// Time of the measurement since the start, s.
    pub t_s: f64,
    /// Where the mass was, m.
    pub x_m: f64,
    /// The estimate.
    pub of: Quantities<Estimated>,
}

/// The true state at a time.
#[derive(Clone, Copy, Debug)]
struct Truth {
    t_s: f64,
    x_m: f64,
    /// Velocity, m/s, height, m, and density ratio.
    values: [f64; 3],
    is_flight: bool,
}

/// The estimates of a run.
#[derive(Clone, Debug, Default)]
pub struct EstimateTrace {
    /// True states of late.
    truths: VecDeque<Truth>,
    /// Time of the last measurement, ns.
    last_ns: Option<u64>,
    points: Vec<EstimatePoint>,
    ticks: u64,
    in_flight: u32,
    within: [u32; 3],
}

impl EstimateTrace {
    /// Adds a tick with the estimate that the controller holds after its sample, on even ground.
    pub(super) fn observe(&mut self, tick: &TickRecord<'_>, estimate: Option<Estimate>) {
        let body = tick.body;
        self.truths.push_back(Truth {
            t_s: tick.t_s,
            x_m: body.x_m,
            values: [body.vx_m_s, body.y_m, tick.medium.density_ratio()],
            is_flight: tick.phase == Phase::Flight,
        });
        while self.truths.pop_front_if(|truth| truth.t_s < tick.t_s - KEPT_S).is_some() {}
        let Some(e) = estimate else { return };
        self.ticks += 1;
        // Without a new measurement the estimate stays.
        if self.last_ns.replace(e.t_ns) == Some(e.t_ns) {
            return;
        }
        let (t_s, half_s) = (1e-9 * e.t_ns as f64, 0.5 * tick.dt_s);
        let at = self.truths.partition_point(|truth| truth.t_s < t_s - half_s);
        let known = self.truths.get(at).filter(|truth| truth.t_s < t_s + half_s);
        let Some(truth) = known.copied() else { return };
        let values = [
            (e.vx_m_s, e.vx_variance),
            (e.y_m, e.y_variance),
            (e.density_ratio, e.density_variance),
        ];
        let mut of = [Estimated::default(); 3];
        for (i, (value, variance)) in values.into_iter().enumerate() {
            let (value, deviation) = (f64::from(value), f64::from(variance).sqrt());
            of[i] = Estimated { value, deviation, error: value - truth.values[i] };
        }
        if truth.is_flight && !e.in_stance {
            self.in_flight += 1;
            for (within, one) in self.within.iter_mut().zip(of) {
                *within += u32::from(one.error.abs() <= BAND * one.deviation);
            }
        }
        if tick.seq.is_multiple_of(STRIDE) {
            let of = Quantities::from_array(of);
            self.points.push(EstimatePoint { t_s, x_m: truth.x_m, of });
        }
    }

    #[cfg(test)]
    pub(super) fn with_points(points: Vec<EstimatePoint>) -> Self {
        Self { points, ..Self::default() }
    }

    /// Returns some of the estimates, evenly spaced.
    #[must_use]
    pub fn points(&self) -> &[EstimatePoint] {
        &self.points
    }

    /// Returns how the estimates fit the truth; none without estimates.
    #[must_use]
    pub fn summary(&self) -> Option<EstimateSummary> {
        let share = |within: u32| f64::from(within) / f64::from(self.in_flight.max(1));
        (self.ticks > 0).then(|| EstimateSummary {
            ticks: self.ticks,
            within_two_sigma: Quantities::from_array(self.within.map(share)),
        })
    }
}

/// How the estimates of a run fit the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimateSummary {
    /// Ticks with an estimate.
    pub ticks: u64,
    /// Share of the estimates in flight that are off by no more than two of their standard
    /// deviations.
    pub within_two_sigma: Quantities<f64>,
}
