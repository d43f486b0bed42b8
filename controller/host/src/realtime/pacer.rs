//! From one tick to the next, and what was slept through in between.

use super::clock::Clock;
use super::grid::Grid;

/// A tick that has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Its number on the grid: the newest that is due.
    pub index: u64,
    /// When the loop was to wake, ns: the instant of the first tick that was due.
    pub due_ns: u64,
    /// When it did, ns.
    pub woke_ns: u64,
    /// Ticks before this one that were slept through.
    pub missed: u64,
}

impl Tick {
    /// How late the loop woke, ns.
    #[must_use]
    pub fn lateness_ns(&self) -> u64 {
        self.woke_ns.saturating_sub(self.due_ns)
    }
}

/// Waits for tick after tick of a grid.
#[derive(Debug)]
pub struct Pacer<'c, C> {
    clock: &'c C,
    grid: Grid,
    next: u64,
}

impl<'c, C: Clock> Pacer<'c, C> {
    /// Begins at the next whole tick from now.
    pub fn new(clock: &'c C, grid: Grid) -> Self {
        Self { clock, grid, next: grid.next_after(clock.now_ns()) }
    }

    /// Waits for the next tick. Those that are over by then are missed: it
    /// begins the newest that is due.
    pub fn wait(&mut self) -> Tick {
        let due_ns = self.grid.at_ns(self.next);
        self.clock.wait_until_ns(due_ns);
        let woke_ns = self.clock.now_ns();
        let index = self.grid.newest(woke_ns).map_or(self.next, |newest| newest.max(self.next));
        let missed = index - self.next;
        self.next = index + 1;
        Tick { index, due_ns, woke_ns, missed }
    }
}
