//! Polling for a message: spin, then yield, then sleep.

use std::cell::Cell;
use std::time::{Duration, Instant};

/// Longest spin before the core is yielded. A reply in lock-step takes one or two
/// microseconds, a sleep and wake-up thirty or more.
const SPIN: Duration = Duration::from_micros(20);
/// Polls between two readings of the clock, while spinning.
const POLLS: u32 = 16;
/// One wait in this many spins for the full time, whatever the waits before it measured.
const PROBE: u32 = 256;
/// Age of a wait up to which the core is yielded. When both processes share one
/// core, the peer then runs.
const YIELD: Duration = Duration::from_millis(1);
/// Duration of the first sleep. Each further sleep is twice as long, up to
/// [`SLEEP_MAX`].
const SLEEP_FIRST: Duration = Duration::from_micros(50);
const SLEEP_MAX: Duration = Duration::from_millis(1);
/// Interval of the idle callback during a wait.
const IDLE_CHECK: Duration = Duration::from_millis(20);

/// Polls with a spin time that adapts from one wait to the next.
///
/// Spinning pays when the peer runs on another core. When both share one core, it
/// only keeps the peer from running: 45 us a round trip instead of a few. So each
/// spin without success shortens the next ones to a quarter.
#[derive(Debug)]
pub(crate) struct Waiter {
    spin: Cell<Duration>,
    waits: Cell<u32>,
}

impl Waiter {
    pub(crate) fn new() -> Self {
        Self { spin: Cell::new(SPIN), waits: Cell::new(0) }
    }

    /// Calls `poll` until it returns a value, at most for `timeout`. Calls `idle`
    /// every [`IDLE_CHECK`] meanwhile, which may end the wait with an error.
    pub(crate) fn wait_for<T, E>(
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
            for _ in 0..POLLS {
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
                // Poll once more: this thread may not have run for long.
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
