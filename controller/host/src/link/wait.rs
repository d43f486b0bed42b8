//! Waiting for a message: spin, then block where the peer wakes us, else yield, then sleep.

use std::cell::Cell;
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

use rustix::thread::set_current_timer_slack;

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
/// Duration from which on a yield is too dear: a busy process took its whole time slice, of
/// some milliseconds. One that wakes from a sleep gets the core from it at once.
const DEAR_YIELD: Duration = Duration::from_micros(200);
/// Fewest and most waits without yields after a dear one.
const WITHOUT_YIELDS: [u32; 2] = [16, 1024];
/// Shortest and longest sleep. Between them a sleep takes an eighth of the wait so far, so a
/// slow peer is answered late by as much at most.
const SLEEP_MIN: Duration = Duration::from_micros(20);
const SLEEP_MAX: Duration = Duration::from_millis(1);
const SLEEP_DIVISOR: u32 = 8;
/// Interval of the idle callback during a wait.
const IDLE_CHECK: Duration = Duration::from_millis(20);

/// Polls with a spin time that adapts from one wait to the next.
///
/// Spinning pays when the peer runs on another core. When both share one core, it
/// only keeps the peer from running: 45 us a round trip instead of a few. So each
/// spin without success shortens the next ones to a quarter.
///
/// A yield is the fastest way to a peer on the same core, and the slowest where other processes
/// are busy, which then run first. So after a [dear](DEAR_YIELD) one sleeps take the place of
/// yields, for twice as many waits as after the last.
#[derive(Debug)]
pub(crate) struct Waiter {
    spin: Cell<Duration>,
    waits: Cell<u32>,
    /// Waits that still do without yields, and how many do after the next dear one.
    without_yields: Cell<u32>,
    next_without: Cell<u32>,
    sleeps_exactly: Cell<bool>,
}

impl Waiter {
    pub(crate) fn new() -> Self {
        Self {
            spin: Cell::new(SPIN),
            waits: Cell::new(0),
            without_yields: Cell::new(0),
            next_without: Cell::new(WITHOUT_YIELDS[0]),
            sleeps_exactly: Cell::new(false),
        }
    }

    /// Returns whether a yield that took this long pays.
    fn is_cheap(&self, took: Duration) -> bool {
        let [fewest, most] = WITHOUT_YIELDS;
        let next = self.next_without.get();
        let is_cheap = took < DEAR_YIELD;
        if is_cheap {
            self.next_without.set(fewest.max(next - next / 16));
        } else {
            self.without_yields.set(next);
            self.next_without.set(most.min(next * 2));
        }
        is_cheap
    }

    /// Sleeps for as long as a wait of this age permits.
    fn sleep(&self, waited: Duration, left: Duration) {
        if !self.sleeps_exactly.replace(true) {
            // By default the kernel adds up to 50 us to each sleep of a thread.
            let _ = set_current_timer_slack(Some(NonZeroU64::MIN));
        }
        std::thread::sleep((waited / SLEEP_DIVISOR).clamp(SLEEP_MIN, SLEEP_MAX).min(left));
    }

    /// Calls `poll` until it returns a value, at most for `timeout`. Calls `idle`
    /// every [`IDLE_CHECK`] meanwhile, which may end the wait with an error. `block`, if the peer
    /// sends wake-ups, waits for one of them for a time at most, and takes the place of yields
    /// and sleeps.
    pub(crate) fn wait_for<T, E>(
        &self,
        timeout: Duration,
        block: Option<&dyn Fn(Duration)>,
        mut poll: impl FnMut() -> Result<Option<T>, E>,
        mut idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Option<T>, E> {
        if let Some(found) = poll()? {
            return Ok(Some(found));
        }
        let start = Instant::now();
        let waits = self.waits.get().wrapping_add(1);
        self.waits.set(waits);
        let spin = if waits.is_multiple_of(PROBE) { SPIN } else { self.spin.get() }.min(timeout);
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

        let mut yields = self.without_yields.get() == 0;
        self.without_yields.set(self.without_yields.get().saturating_sub(1));
        let mut next_check = IDLE_CHECK;
        loop {
            let waited = start.elapsed();
            if waited >= timeout {
                // Poll once more: this thread may not have run for long.
                return poll();
            }
            let left = timeout.saturating_sub(waited);
            if let Some(block) = block {
                block(IDLE_CHECK.min(left));
            } else if waited < YIELD && yields {
                std::thread::yield_now();
                yields = self.is_cheap(start.elapsed().saturating_sub(waited));
            } else {
                self.sleep(waited, left);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dear_yields_are_replaced_by_sleeps_for_longer_each_time() {
        let waiter = Waiter::new();
        assert!(waiter.is_cheap(Duration::from_micros(1)));
        assert_eq!(waiter.without_yields.get(), 0);
        let mut pauses = Vec::new();
        for _ in 0..8 {
            assert!(!waiter.is_cheap(DEAR_YIELD));
            pauses.push(waiter.without_yields.replace(0));
        }
        assert_eq!(pauses, [16, 32, 64, 128, 256, 512, 1024, 1024]);
        for _ in 0..200 {
            assert!(waiter.is_cheap(Duration::from_micros(1)));
        }
        assert!(!waiter.is_cheap(DEAR_YIELD));
        assert!(waiter.without_yields.get() < 64, "cheap ones make up for it");
    }

    #[test]
    fn a_wait_returns_what_is_found_and_ends_at_its_timeout() {
        let waiter = Waiter::new();
        let wait = |polls: u32, timeout| {
            let mut left = polls;
            let poll = || {
                left -= 1;
                Ok::<_, ()>((left == 0).then_some(polls))
            };
            waiter.wait_for(timeout, None, poll, || Ok(()))
        };
        for polls in [1, 2, 100, 1_000] {
            assert_eq!(wait(polls, Duration::from_mins(1)), Ok(Some(polls)));
        }
        waiter.without_yields.set(3);
        let start = Instant::now();
        let timeout = Duration::from_millis(3);
        assert_eq!(wait(u32::MAX, timeout), Ok(None));
        assert!(start.elapsed() >= timeout);
    }
}
