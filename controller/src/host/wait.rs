//! Waiting for the peer: fast when it is quick, kind when it is not.

use std::time::{Duration, Instant};

/// Spun through without giving the core away: a reply in lock-step takes a
/// couple of microseconds, a sleep and wake-up thirty or more.
const SPIN: Duration = Duration::from_micros(20);
/// Looks at the queue between two looks at the clock, while spinning.
const LOOKS: u32 = 16;
/// Then the core is offered to others, up to this age: on a machine with fewer
/// free cores than processes, it is the peer that takes it.
const YIELD: Duration = Duration::from_millis(1);
/// Then sleeps, each twice as long as the one before, up to a limit.
const SLEEP_FIRST: Duration = Duration::from_micros(50);
const SLEEP_MAX: Duration = Duration::from_millis(1);
/// How often a silent wait looks whether the peer still lives.
pub(super) const IDLE_CHECK: Duration = Duration::from_millis(20);

/// Calls `poll` until it has something, at most for `timeout`. After every
/// [`IDLE_CHECK`] of silence calls `idle`, which may end the wait by an error.
pub(super) fn wait_for<T, E>(
    timeout: Duration,
    mut poll: impl FnMut() -> Result<Option<T>, E>,
    mut idle: impl FnMut() -> Result<(), E>,
) -> Result<Option<T>, E> {
    if let Some(found) = poll()? {
        return Ok(Some(found));
    }
    let start = Instant::now();
    let spin = SPIN.min(timeout);
    loop {
        for _ in 0..LOOKS {
            std::hint::spin_loop();
            if let Some(found) = poll()? {
                return Ok(Some(found));
            }
        }
        if start.elapsed() >= spin {
            break;
        }
    }
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
            // What the peer sent before it went still counts.
            next_check = start.elapsed() + IDLE_CHECK;
        }
    }
}
