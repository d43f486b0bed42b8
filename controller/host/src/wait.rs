//! Waiting for the peer: fast when it is quick, kind when it is not.

use std::cell::Cell;
use std::time::{Duration, Instant};

/// Longest spin without giving the core away: a reply in lock-step takes a
/// microsecond or two, a sleep and wake-up thirty or more.
const SPIN: Duration = Duration::from_micros(20);
/// Looks at the queue between two looks at the clock, while spinning.
const LOOKS: u32 = 16;
/// One wait in this many spins whatever the ones before it taught.
const PROBE: u32 = 256;
/// Then the core is offered to others, up to this age: when the two processes
/// share one core, it is the peer that takes it.
const YIELD: Duration = Duration::from_millis(1);
/// Then sleeps, each twice as long as the one before, up to a limit.
const SLEEP_FIRST: Duration = Duration::from_micros(50);
const SLEEP_MAX: Duration = Duration::from_millis(1);
/// How often a silent wait looks whether the peer still lives.
const IDLE_CHECK: Duration = Duration::from_millis(20);

/// Waits, and learns from one wait for the next whether spinning pays.
///
/// It does when the peer runs on another core. When the machine is busy and
/// both share one, the spin only keeps the peer from running: 45 us a round
/// trip instead of a few.
#[derive(Debug)]
pub(super) struct Waiter {
    spin: Cell<Duration>,
    waits: Cell<u32>,
}

impl Waiter {
    pub(super) fn new() -> Self {
        Self { spin: Cell::new(SPIN), waits: Cell::new(0) }
    }

    /// Calls `poll` until it has something, at most for `timeout`. After every
    /// [`IDLE_CHECK`] of silence calls `idle`, which may end the wait by an error.
    pub(super) fn wait_for<T, E>(
        &self,
        timeout: Duration,
        mut poll: impl FnMut() -> Result<Option<T>, E>,
        mut idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Option<T>, E> {
        if let Some(found) = poll()? {
            return Ok(Some(found));
        }
        let start = Instant::now();
        let waits = self.waits.get().wrapping_add(1);
        self.waits.set(waits);
        let probe = waits.is_multiple_of(PROBE);
        let spin = if probe { SPIN } else { self.spin.get() }.min(timeout);
        while start.elapsed() < spin {
            for _ in 0..LOOKS {
                std::hint::spin_loop();
                if let Some(found) = poll()? {
                    self.spin.set(SPIN);
                    return Ok(Some(found));
                }
            }
        }
        self.spin.set(self.spin.get() / 4);

        let mut sleep = SLEEP_FIRST;
        let mut next_check = IDLE_CHECK;
        loop {
            let waited = start.elapsed();
            if waited >= timeout {
                // One last look: this thread may have been away for long.
                return poll();
            }
            if waited < YIELD {
                std::thread::yield_now();
            } else {
                std::thread::sleep(sleep.min(timeout.saturating_sub(waited)));
                sleep = SLEEP_MAX.min(sleep * 2);
            }
            if let Some(found) = poll()? {
                return Ok(Some(found));
            }
            if start.elapsed() >= next_check {
                idle()?;
                next_check = start.elapsed() + IDLE_CHECK;
            }
        }
    }
}
