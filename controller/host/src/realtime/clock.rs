//! The clock of a loop: now, and waiting for an instant.

use std::time::Duration;

use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// How long before a tick a loop wakes, and spins for the rest: longer than
/// most wake-ups are late.
pub const SPIN: Duration = Duration::from_micros(100);
/// The most of a tick that is spun away, as a divisor. A real-time thread that
/// never slept would be stopped by the kernel, for 50 ms of every second.
const SPIN_AT_MOST: u64 = 4;

/// Time, as a loop sees it.
pub trait Clock {
    /// Now, ns since the clock's zero.
    fn now_ns(&self) -> u64;
    /// Waits for an instant; returns at once when it is over.
    fn wait_until_ns(&self, instant_ns: u64);
    /// Processor time of this thread so far, ns: what it has worked, and not
    /// what the machine has made it wait.
    fn own_ns(&self) -> u64;
}

/// The machine's monotonic clock.
#[derive(Clone, Copy, Debug)]
pub struct Monotonic {
    spin_ns: u64,
}

impl Monotonic {
    /// The clock for a loop with ticks of `tick_ns`, waking early by `spin`, but
    /// never by more than a quarter of a tick.
    #[must_use]
    pub fn new(spin: Duration, tick_ns: u64) -> Self {
        let spin_ns = u64::try_from(spin.as_nanos()).unwrap_or(u64::MAX);
        Self { spin_ns: spin_ns.min(tick_ns / SPIN_AT_MOST) }
    }
}

impl Clock for Monotonic {
    fn now_ns(&self) -> u64 {
        ns(clock_gettime(ClockId::Monotonic))
    }

    fn wait_until_ns(&self, instant_ns: u64) {
        let wake_ns = instant_ns.saturating_sub(self.spin_ns);
        let wake = Timespec {
            tv_sec: (wake_ns / 1_000_000_000).cast_signed(),
            tv_nsec: (wake_ns % 1_000_000_000).cast_signed(),
        };
        // Again after a signal: the instant is absolute. (An instant in the past
        // returns at once.) Another error cannot be; the spin would bridge it.
        while let Err(rustix::io::Errno::INTR) =
            clock_nanosleep_absolute(SleepClock::Monotonic, &wake)
        {}
        while self.now_ns() < instant_ns {
            std::hint::spin_loop();
        }
    }

    fn own_ns(&self) -> u64 {
        ns(clock_gettime(ClockId::ThreadCPUTime))
    }
}

fn ns(time: Timespec) -> u64 {
    time.tv_sec.cast_unsigned() * 1_000_000_000 + time.tv_nsec.cast_unsigned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_never_returns_early_and_knows_work_from_waiting() {
        let clock = Monotonic::new(SPIN, 1_000_000);
        let (start_ns, own_ns) = (clock.now_ns(), clock.own_ns());
        for i in 1..=20 {
            let instant_ns = start_ns + i * 2_000_000;
            clock.wait_until_ns(instant_ns);
            assert!(clock.now_ns() >= instant_ns);
        }
        let worked_ns = clock.own_ns() - own_ns;
        // At most a quarter of a tick of 1 ms is spun, 20 times; the rest is slept.
        assert!(worked_ns < 20_000_000, "{worked_ns} ns of 40 ms");
        clock.wait_until_ns(0);
    }
}
