//! The loop's end of a recording: copies of fixed size into a ring.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use leg_control::wire::{Command, Sample};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::session::TickRecord;
use leg_plant::{Body, Event, Phase};

/// Ticks and events between the loop and the thread that writes them out: a
/// minute at 1 kHz, three seconds at 20 kHz; some 13 MB.
pub(super) const RING: usize = 1 << 16;

/// Between two looks whether a full ring has room again.
const LOOK: Duration = Duration::from_micros(50);

/// What the loop does when the ring is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFull {
    /// Waits. For lock-step, where time waits too and the recording is to be
    /// complete: the run is the same, bit for bit, only longer.
    Wait,
    /// Goes on, and the row is lost and counted. For real time.
    Drop,
}

/// A tick, as the ring holds it.
#[derive(Clone, Copy, Debug)]
pub(super) struct TickRow {
    pub(super) seq: u64,
    pub(super) t_s: f64,
    pub(super) body: Body,
    pub(super) phase: Phase,
    pub(super) density_ratio: f64,
    pub(super) sample: Sample,
    pub(super) command: Command,
    pub(super) is_new: bool,
    pub(super) round_trip: Duration,
}

/// What is in the ring. Events follow their tick.
#[derive(Clone, Copy, Debug)]
pub(super) enum Row {
    Tick(TickRow),
    Event(Event),
}

/// What the two ends of the ring tell each other beside it.
#[derive(Debug, Default)]
pub(super) struct Shared {
    dropped: AtomicU64,
    /// The reader takes no more.
    closed: AtomicBool,
}

impl Shared {
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

/// Takes ticks in. It never allocates and calls nothing of the system, but
/// that with [`OnFull::Wait`] it sleeps while the ring is full.
#[derive(Debug)]
pub struct Tap {
    ring: Producer<Row>,
    shared: Arc<Shared>,
    on_full: OnFull,
}

impl Tap {
    pub(super) fn new(rows: usize, on_full: OnFull) -> (Self, Consumer<Row>, Arc<Shared>) {
        let (mut ring, mut reader) = RingBuffer::new(rows);
        // Once through all of its memory, so that no page of it is new to the loop.
        let blank = Row::Event(Event {
            kind: leg_plant::EventKind::Fall,
            t_s: 0.0,
            body: Body { x_m: 0.0, vx_m_s: 0.0, y_m: 0.0, vy_m_s: 0.0 },
        });
        for _ in 0..rows {
            let _ = ring.push(blank);
        }
        while reader.pop().is_ok() {}
        let shared = Arc::new(Shared::default());
        (Self { ring, shared: Arc::clone(&shared), on_full }, reader, shared)
    }

    /// Takes in a tick and what happened in it.
    pub fn push(&mut self, tick: &TickRecord<'_>) {
        let row = TickRow {
            seq: tick.seq,
            t_s: tick.t_s,
            body: tick.body,
            phase: tick.phase,
            density_ratio: tick.medium.density_ratio(),
            sample: *tick.sample,
            command: *tick.command,
            is_new: tick.is_new,
            round_trip: tick.round_trip,
        };
        // Without its tick an event has no place in time.
        if self.row(Row::Tick(row)) {
            for event in tick.events.iter() {
                self.row(Row::Event(*event));
            }
        }
    }

    /// Rows that there was no room for.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.shared.dropped()
    }

    fn row(&mut self, row: Row) -> bool {
        while self.ring.is_full() && self.on_full == OnFull::Wait && !self.shared.is_closed() {
            std::thread::sleep(LOOK);
        }
        let taken = self.ring.push(row).is_ok();
        if !taken {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_plant::{EventKind, Medium, TickEvents};

    fn push(tap: &mut Tap, seq: u64) {
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

    fn seqs(ring: &mut Consumer<Row>) -> Vec<u64> {
        let mut all = Vec::new();
        while let Ok(row) = ring.pop() {
            match row {
                Row::Tick(tick) => all.push(tick.seq),
                Row::Event(event) => assert_eq!(event.kind, EventKind::Apex),
            }
        }
        all
    }

    #[test]
    fn a_full_ring_drops_and_counts() {
        let (mut tap, mut ring, shared) = Tap::new(4, OnFull::Drop);
        assert!(seqs(&mut ring).is_empty(), "what warmed it up is gone");
        (0..6).for_each(|seq| push(&mut tap, seq));
        assert_eq!((shared.dropped(), tap.dropped()), (2, 2));
        assert_eq!(seqs(&mut ring), [0, 1, 2, 3]);
        push(&mut tap, 6);
        assert_eq!((seqs(&mut ring), shared.dropped()), (vec![6], 2));
    }

    #[test]
    fn a_full_ring_is_waited_for_while_somebody_reads() {
        let (mut tap, mut ring, shared) = Tap::new(4, OnFull::Wait);
        let read = std::thread::scope(|scope| {
            scope.spawn(|| (0..100).for_each(|seq| push(&mut tap, seq)));
            let mut read = Vec::new();
            while read.len() < 100 {
                read.extend(seqs(&mut ring));
            }
            read
        });
        assert_eq!((read, shared.dropped()), ((0..100).collect(), 0));
        shared.close();
        (0..6).for_each(|seq| push(&mut tap, seq));
        assert_eq!(shared.dropped(), 2, "nobody reads any more: nothing to wait for");
    }
}
