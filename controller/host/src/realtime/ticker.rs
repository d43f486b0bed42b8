//! Waiting for the ticks of a schedule.

use super::clock::Clock;
use super::schedule::TickSchedule;

/// A tick that has started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Number of the newest due tick on the schedule.
    pub index: u64,
    /// Instant of the first due tick, at which the loop should have woken, ns.
    pub due_ns: u64,
    /// Instant at which the loop woke, ns.
    pub woke_ns: u64,
    /// Number of ticks before this one whose whole period has passed.
    pub missed: u64,
}

impl Tick {
    /// Returns the time from the due instant to the wake-up, ns.
    #[must_use]
    pub fn lateness_ns(&self) -> u64 {
        self.woke_ns.saturating_sub(self.due_ns)
    }
}

/// Waits for one tick of a schedule after the other.
#[derive(Debug)]
pub struct Ticker<'c, C> {
    clock: &'c C,
    schedule: TickSchedule,
    next: u64,
}

impl<'c, C: Clock> Ticker<'c, C> {
    /// Creates a ticker whose first tick is the next one on the schedule.
    pub fn new(clock: &'c C, schedule: TickSchedule) -> Self {
        Self { clock, schedule, next: schedule.next_after(clock.now_ns()) }
    }

    /// Waits for the next tick. If further ticks are due by then, returns the newest
    /// one and counts the others as missed.
    pub fn wait(&mut self) -> Tick {
        let due_ns = self.schedule.at_ns(self.next);
        self.clock.wait_until_ns(due_ns);
        let woke_ns = self.clock.now_ns();
        let index = self.schedule.newest(woke_ns).map_or(self.next, |newest| newest.max(self.next));
        let missed = index - self.next;
        self.next = index + 1;
        Tick { index, due_ns, woke_ns, missed }
    }
}
