//! The contact switch of the foot.

use std::collections::VecDeque;

use super::catalog::Figures;
use super::figure::{Quantity, Sensor};
use crate::faults::stage::FaultRng;

/// A switch that reports each edge late, bounces after it, and may chatter while it is closed.
#[derive(Debug)]
pub(super) struct ContactSwitch {
    tick_s: f64,
    latency_s: f64,
    jitter_s: f64,
    bounce_s: f64,
    chatter_per_tick: f64,
    /// The truth at the last tick.
    is_on_ground: bool,
    /// Edges that the switch has yet to report, oldest first, with their ticks.
    edges: VecDeque<(u64, bool)>,
    is_closed: bool,
    bounces_until: u64,
    rng: FaultRng,
}

impl ContactSwitch {
    /// Creates the switch; `None` for a leg without one.
    pub(super) fn new(figures: &Figures, run_rate_hz: u32, rng: FaultRng) -> Option<Self> {
        let figure = |quantity| figures.of(Sensor::Contact, quantity);
        if figure(Quantity::Rate) <= 0.0 {
            return None;
        }
        let run_rate_hz = f64::from(run_rate_hz);
        let (latency_s, jitter_s) = (figure(Quantity::Latency), figure(Quantity::Jitter));
        // At most one edge a tick. The loops of a run in real time must not allocate.
        let most = ((latency_s + jitter_s) * run_rate_hz).ceil() as usize + 2;
        Some(Self {
            tick_s: 1.0 / run_rate_hz,
            latency_s,
            jitter_s,
            bounce_s: figure(Quantity::Bounce),
            chatter_per_tick: figure(Quantity::Chatter) / run_rate_hz,
            is_on_ground: false,
            edges: VecDeque::with_capacity(most),
            is_closed: false,
            bounces_until: 0,
            rng,
        })
    }

    /// Opens the switch, before another run.
    pub(super) fn clear(&mut self) {
        self.edges.clear();
        (self.is_on_ground, self.is_closed, self.bounces_until) = (false, false, 0);
    }

    fn ticks(&self, time_s: f64) -> u64 {
        libm::round(time_s / self.tick_s) as u64
    }

    fn bounce(&mut self, tick: u64) {
        if self.bounce_s > 0.0 {
            let time_s = self.bounce_s * self.rng.uniform();
            self.bounces_until = tick + 1 + self.ticks(time_s);
        }
    }

    /// Returns the reading at a tick. Ticks must rise.
    pub(super) fn read(&mut self, tick: u64, is_on_ground: bool) -> bool {
        if is_on_ground != self.is_on_ground {
            self.is_on_ground = is_on_ground;
            let random = if self.jitter_s > 0.0 { self.rng.uniform() } else { 0.0 };
            let due_at = tick + self.ticks(self.latency_s + random * self.jitter_s);
            let earliest = self.edges.back().map_or(0, |&(last, _)| last);
            self.edges.push_back((due_at.max(earliest), is_on_ground));
        }
        while let Some(&(due_at, is_closed)) = self.edges.front()
            && due_at <= tick
        {
            self.edges.pop_front();
            self.is_closed = is_closed;
            self.bounce(tick);
            // The edge itself is always seen.
            if self.edges.is_empty() {
                return is_closed;
            }
        }
        if self.is_closed
            && tick >= self.bounces_until
            && self.chatter_per_tick > 0.0
            && self.rng.occurs(self.chatter_per_tick)
        {
            self.bounce(tick);
            return false;
        }
        if tick < self.bounces_until { self.rng.occurs(0.5) } else { self.is_closed }
    }
}
