//! The loop's end of a recording: copies of fixed size into a ring.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use leg_control::estimator::Estimate;
use leg_control::wire::{Command, Sample};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::session::TickRecord;
use leg_plant::{Body, Event, Phase};

/// Capacity of the ring in ticks and events: a minute at 1 kHz, three seconds at
/// 20 kHz, about 17 MB.
pub(super) const RING_CAPACITY: usize = 1 << 16;

/// Time between two checks whether a full ring has room again.
const POLL_INTERVAL: Duration = Duration::from_micros(50);

/// Behaviour of the loop when the ring is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFull {
    /// Waits for room. For lock-step, where simulated time waits too: the run
    /// takes longer, but its results and its recording are the same.
    Wait,
    /// Drops the record and counts it. For real time.
    Drop,
}

/// What is known of the leg at a tick, beside its messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Known {
    /// Its true state.
    State,
    /// Where it is, as its messages and its status show.
    Place,
    /// Nothing.
    Nothing,
}

/// A copy of a tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TickCopy {
    pub(super) seq: u64,
    pub(super) t_s: f64,
    pub(super) body: Body,
    pub(super) phase: Phase,
    /// Of body and phase.
    pub(super) known: Known,
    pub(super) density_ratio: f64,
    pub(super) sample: Sample,
    pub(super) command: Command,
    pub(super) is_new: bool,
    pub(super) round_trip: Duration,
}

/// An entry of the ring. The estimate at a tick, if there is one, and its events follow it.
#[derive(Clone, Copy, Debug)]
pub(super) enum RingEntry {
    Tick(TickCopy),
    Estimate(Estimate),
    Event(Event),
}

/// State that both ends of the ring share.
#[derive(Debug, Default)]
pub(super) struct RingState {
    dropped: AtomicU64,
    /// The reader takes no more entries.
    closed: AtomicBool,
}

impl RingState {
    pub(super) fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    pub(super) fn close(&self) {
        self.closed.store(true, Ordering::Release);
    }

    pub(super) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }
}

/// Copies ticks into the ring. It never allocates and makes no system call,
/// except that it sleeps while the ring is full under [`OnFull::Wait`].
#[derive(Debug)]
pub struct RecordTap {
    ring: Producer<RingEntry>,
    state: Arc<RingState>,
    on_full: OnFull,
}

impl RecordTap {
    pub(super) fn new(
        capacity: usize,
        on_full: OnFull,
    ) -> (Self, Consumer<RingEntry>, Arc<RingState>) {
        let (mut ring, mut reader) = RingBuffer::new(capacity);
        // Touches every page once, so that the loop causes no page fault.
        let blank = RingEntry::Event(Event {
            kind: leg_plant::EventKind::Fall,
            t_s: 0.0,
            body: Body { x_m: 0.0, vx_m_s: 0.0, y_m: 0.0, vy_m_s: 0.0 },
        });
        for _ in 0..capacity {
            let _ = ring.push(blank);
        }
        while reader.pop().is_ok() {}
        let state = Arc::new(RingState::default());
        (Self { ring, state: Arc::clone(&state), on_full }, reader, state)
    }

    /// Copies a tick and its events.
    pub fn push(&mut self, tick: &TickRecord<'_>) {
        self.push_estimated(tick, None);
    }

    /// Copies a tick, the estimate that the controller holds after its sample, and its events.
    pub fn push_estimated(&mut self, tick: &TickRecord<'_>, estimate: Option<Estimate>) {
        let copy = TickCopy {
            seq: tick.seq,
            t_s: tick.t_s,
            body: tick.body,
            phase: tick.phase,
            known: Known::State,
            density_ratio: tick.medium.density_ratio(),
            sample: *tick.sample,
            command: *tick.command,
            is_new: tick.is_new,
            round_trip: tick.round_trip,
        };
        // Estimate and events take number and time from their tick, so they are useless without.
        if self.push_entry(&RingEntry::Tick(copy)) {
            if let Some(estimate) = estimate {
                self.push_entry(&RingEntry::Estimate(estimate));
            }
            for event in tick.events.iter() {
                self.push_entry(&RingEntry::Event(*event));
            }
        }
    }

    /// Copies a tick as an observer sees it.
    pub(crate) fn push_observed(&mut self, tick: &TickCopy) {
        self.push_entry(&RingEntry::Tick(*tick));
    }

    /// Returns the number of entries dropped because the ring was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.state.dropped()
    }

    fn push_entry(&mut self, entry: &RingEntry) -> bool {
        while self.ring.is_full() && self.on_full == OnFull::Wait && !self.state.is_closed() {
            std::thread::sleep(POLL_INTERVAL);
        }
        let pushed = self.ring.push(*entry).is_ok();
        if !pushed {
            self.state.dropped.fetch_add(1, Ordering::Relaxed);
        }
        pushed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_plant::{EventKind, Medium, TickEvents};

    fn push(tap: &mut RecordTap, seq: u64) {
        let body = Body { x_m: 0.0, vx_m_s: 0.0, y_m: 1.0, vy_m_s: 0.0 };
        tap.push(&TickRecord {
            seq,
            t_s: 0.0,
            dt_s: 1e-3,
            body,
            phase: Phase::Flight,
            medium: Medium::AIR,
            sample: &Sample::default(),
            command: &Command::default(),
            is_new: true,
            events: &TickEvents::default(),
            after: body,
            round_trip: Duration::ZERO,
        });
    }

    fn drain(ring: &mut Consumer<RingEntry>) -> Vec<u64> {
        let mut all = Vec::new();
        while let Ok(entry) = ring.pop() {
            match entry {
                RingEntry::Tick(tick) => all.push(tick.seq),
                RingEntry::Event(event) => assert_eq!(event.kind, EventKind::Apex),
                RingEntry::Estimate(_) => panic!("none was pushed"),
            }
        }
        all
    }

    #[test]
    fn drops_and_counts_entries_when_the_ring_is_full() {
        let (mut tap, mut ring, state) = RecordTap::new(4, OnFull::Drop);
        assert!(drain(&mut ring).is_empty(), "the entries that warmed the ring up are gone");
        (0..6).for_each(|seq| push(&mut tap, seq));
        assert_eq!((state.dropped(), tap.dropped()), (2, 2));
        assert_eq!(drain(&mut ring), [0, 1, 2, 3]);
        push(&mut tap, 6);
        assert_eq!((drain(&mut ring), state.dropped()), (vec![6], 2));
    }

    #[test]
    fn waits_for_room_until_the_reader_closes() {
        let (mut tap, mut ring, state) = RecordTap::new(4, OnFull::Wait);
        let read = std::thread::scope(|scope| {
            scope.spawn(|| (0..100).for_each(|seq| push(&mut tap, seq)));
            let mut read = Vec::new();
            while read.len() < 100 {
                read.extend(drain(&mut ring));
            }
            read
        });
        assert_eq!((read, state.dropped()), ((0..100).collect(), 0));
        state.close();
        (0..6).for_each(|seq| push(&mut tap, seq));
        assert_eq!(state.dropped(), 2, "without a reader it does not wait");
    }
}
