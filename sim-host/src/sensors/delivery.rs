//! When a sensor reads, and when its reading is in a sample.

use std::collections::VecDeque;

use leg_control::measurement::Aged;

use super::catalog::Figures;
use super::figure::{Quantity, Sensor};
use crate::faults::stage::FaultRng;

/// The way of a sensor's readings into the samples: rate, latency, jitter and dropouts, all in
/// whole ticks. Readings stay in their order.
#[derive(Debug)]
pub(super) struct Delivery<T> {
    /// Readings per tick, at most 1.
    per_tick: f64,
    /// Part of the time between two readings that has passed at tick 0.
    phase: f64,
    tick_s: f64,
    latency_s: f64,
    jitter_s: f64,
    dropout: f64,
    rng: FaultRng,
    /// Readings under way, oldest first.
    queue: VecDeque<UnderWay<T>>,
}

#[derive(Debug)]
struct UnderWay<T> {
    taken_at: u64,
    due_at: u64,
    value: T,
}

impl<T> Delivery<T> {
    /// Creates the way of a sensor's readings; `None` for one that the leg does not have.
    pub(super) fn new(
        figures: &Figures,
        sensor: Sensor,
        run_rate_hz: u32,
        mut rng: FaultRng,
    ) -> Option<Self> {
        let figure = |quantity| figures.of(sensor, quantity);
        let run_rate_hz = f64::from(run_rate_hz);
        let per_tick = (figure(Quantity::Rate) / run_rate_hz).min(1.0);
        if per_tick <= 0.0 {
            return None;
        }
        let (latency_s, jitter_s) = (figure(Quantity::Latency), figure(Quantity::Jitter));
        // The loops of a run in real time must not allocate.
        let most = ((latency_s + jitter_s) * run_rate_hz * per_tick).ceil() as usize + 2;
        Some(Self {
            per_tick,
            phase: rng.uniform(),
            tick_s: 1.0 / run_rate_hz,
            latency_s,
            jitter_s,
            dropout: figure(Quantity::Dropout),
            rng,
            queue: VecDeque::with_capacity(most),
        })
    }

    /// Forgets the readings under way.
    pub(super) fn clear(&mut self) {
        self.queue.clear();
    }

    fn is_due(&self, tick: u64) -> bool {
        let readings = |ticks: f64| libm::floor(ticks * self.per_tick + self.phase);
        self.per_tick >= 1.0 || readings(tick as f64) > readings(tick as f64 - 1.0)
    }

    /// Reads if the sensor is due at this tick, and returns the newest reading that arrives.
    /// Ticks must rise.
    pub(super) fn pass(&mut self, tick: u64, read: impl FnOnce() -> Option<T>) -> Option<Aged<T>> {
        if self.is_due(tick) {
            let is_lost = self.dropout > 0.0 && self.rng.occurs(self.dropout);
            if let Some(value) = read().filter(|_| !is_lost) {
                let random = if self.jitter_s > 0.0 { self.rng.uniform() } else { 0.0 };
                let delay_s = self.latency_s + random * self.jitter_s;
                let earliest = self.queue.back().map_or(0, |last| last.due_at);
                let due_at = (tick + libm::round(delay_s / self.tick_s) as u64).max(earliest);
                self.queue.push_back(UnderWay { taken_at: tick, due_at, value });
            }
        }
        let mut newest = None;
        while self.queue.front().is_some_and(|reading| reading.due_at <= tick) {
            newest = self.queue.pop_front();
        }
        newest.map(|UnderWay { taken_at, value, .. }| {
            let age_s = (tick - taken_at) as f64 * self.tick_s;
            Aged { value, age_ns: libm::round(1e9 * age_s) as u32 }
        })
    }
}
