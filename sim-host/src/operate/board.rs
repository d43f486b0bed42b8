//! What the loop and the socket tell each other: single numbers, written and read
//! without waiting. Each is right by itself; together they may be a tick apart.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use leg_process::Stop;

use crate::session::leg::{Leg, TickRecord};
use leg_plant::EventKind;

/// Bars of the histogram of round trips: the first up to 0.25 us, each twice as
/// wide as the one before, the last without an end.
pub const BUCKETS: usize = 20;

/// Between two looks of a run that is paused.
const LOOK: Duration = Duration::from_millis(2);

/// Orders to the loop, and what it shows.
#[derive(Debug, Default)]
pub struct Board {
    /// A set-point by hand: its bits, m/s, and whether there is one.
    set_point_bits: AtomicU64,
    is_ordered: AtomicBool,
    /// Raised by every order of a set-point.
    orders: AtomicU32,
    is_paused: AtomicBool,
    is_ended: AtomicBool,

    shown: Shown,
}

/// What the loop shows of its last tick, and has counted.
#[derive(Debug, Default)]
struct Shown {
    run_id: AtomicU32,
    seq: AtomicU64,
    t_s_bits: AtomicU64,
    x_m_bits: AtomicU64,
    density_bits: AtomicU64,
    ticks: AtomicU64,
    hops: AtomicU64,
    falls: AtomicU64,
    safe_ticks: AtomicU64,
    held_ticks: AtomicU64,
    rejected: AtomicU32,
    round_trips: [AtomicU32; BUCKETS],
}

/// What the loop has shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Seen {
    pub(super) run_id: u32,
    pub(super) seq: u64,
    pub(super) t_s: f64,
    pub(super) x_m: f64,
    pub(super) density_ratio: f64,
    pub(super) ticks: u64,
    pub(super) hops: u64,
    pub(super) falls: u64,
    pub(super) safe_ticks: u64,
    pub(super) held_ticks: u64,
    pub(super) rejected: u32,
    pub(super) round_trips: Vec<u32>,
}

impl Board {
    /// From the loop, after each tick. A few nanoseconds.
    pub fn show(&self, tick: &TickRecord<'_>) {
        // Only the loop writes: a count need not be raised in one go.
        let count = |of: &AtomicU64, more: u64| of.store(of.load(Relaxed) + more, Relaxed);
        let shown = &self.shown;
        shown.run_id.store(tick.sample.header.run_id, Relaxed);
        shown.seq.store(tick.seq, Relaxed);
        shown.t_s_bits.store(tick.t_s.to_bits(), Relaxed);
        shown.x_m_bits.store(tick.body.x_m.to_bits(), Relaxed);
        shown.density_bits.store(tick.medium.density_ratio().to_bits(), Relaxed);
        shown.rejected.store(tick.command.rejected, Relaxed);
        count(&shown.ticks, 1);
        count(&shown.safe_ticks, (tick.command.is_safe()).into());
        count(&shown.held_ticks, (!tick.is_new).into());
        for event in tick.events.iter() {
            match event.kind {
                EventKind::Touchdown { .. } => count(&shown.hops, 1),
                EventKind::Fall => count(&shown.falls, 1),
                EventKind::LiftOff | EventKind::Apex => (),
            }
        }
        if tick.is_new {
            let bucket = &shown.round_trips[bucket(tick.round_trip)];
            bucket.store(bucket.load(Relaxed).wrapping_add(1), Relaxed);
        }
    }

    /// From the loop, before each tick: gives the leg what is ordered. `known`
    /// is the loop's own memory, 0 at first. The leg keeps to its scenario as
    /// long as nothing is.
    pub fn steer(&self, leg: &mut Leg<'_>, known: &mut u32) {
        let orders = self.orders.load(Relaxed);
        if orders != *known {
            *known = orders;
            let m_s = f64::from_bits(self.set_point_bits.load(Relaxed));
            leg.override_set_point(self.is_ordered.load(Relaxed).then_some(m_s));
        }
    }

    /// From a loop whose time can wait: waits while it is paused.
    pub fn wait_while_paused(&self, stop: &Stop) {
        while self.is_paused.load(Relaxed) && !self.is_ended() && !stop.is_raised() {
            std::thread::sleep(LOOK);
        }
    }

    /// Whether the run is to end.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.is_ended.load(Relaxed)
    }

    /// Asks for a speed, m/s; `None` gives the word back to the scenario.
    pub fn order(&self, set_point_m_s: Option<f64>) {
        if let Some(m_s) = set_point_m_s {
            self.set_point_bits.store(m_s.to_bits(), Relaxed);
        }
        self.is_ordered.store(set_point_m_s.is_some(), Relaxed);
        self.orders.store(self.orders.load(Relaxed).wrapping_add(1).max(1), Relaxed);
    }

    /// The speed asked for by hand, m/s.
    pub(super) fn ordered(&self) -> Option<f64> {
        let m_s = f64::from_bits(self.set_point_bits.load(Relaxed));
        self.is_ordered.load(Relaxed).then_some(m_s)
    }

    /// Pauses a run in lock-step, or lets it go on.
    pub fn pause(&self, paused: bool) {
        self.is_paused.store(paused, Relaxed);
    }

    pub(super) fn is_paused(&self) -> bool {
        self.is_paused.load(Relaxed)
    }

    /// Asks the run to end.
    pub fn end(&self) {
        self.is_ended.store(true, Relaxed);
    }

    pub(super) fn seen(&self) -> Seen {
        let shown = &self.shown;
        let float = |bits: &AtomicU64| f64::from_bits(bits.load(Relaxed));
        Seen {
            run_id: shown.run_id.load(Relaxed),
            seq: shown.seq.load(Relaxed),
            t_s: float(&shown.t_s_bits),
            x_m: float(&shown.x_m_bits),
            density_ratio: float(&shown.density_bits),
            ticks: shown.ticks.load(Relaxed),
            hops: shown.hops.load(Relaxed),
            falls: shown.falls.load(Relaxed),
            safe_ticks: shown.safe_ticks.load(Relaxed),
            held_ticks: shown.held_ticks.load(Relaxed),
            rejected: shown.rejected.load(Relaxed),
            round_trips: shown.round_trips.iter().map(|n| n.load(Relaxed)).collect(),
        }
    }
}

/// The bar of a round trip.
fn bucket(time: Duration) -> usize {
    let quarters_us = time.as_nanos() / 250;
    (128 - quarters_us.leading_zeros() as usize).min(BUCKETS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bar_is_twice_as_wide_as_the_one_before() {
        let at = |ns: u64| bucket(Duration::from_nanos(ns));
        assert_eq!((at(0), at(249), at(250), at(499)), (0, 0, 1, 1));
        assert_eq!((at(500), at(999), at(1000), at(1999), at(2000)), (2, 2, 3, 3, 4));
        assert_eq!(at(u64::MAX), BUCKETS - 1);
    }
}
