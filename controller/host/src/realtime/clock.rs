//! The clock of a loop.

use std::time::Duration;

use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Default time for which a loop spins before each tick: longer than most wake-ups
/// are late.
pub const DEFAULT_SPIN: Duration = Duration::from_micros(100);
/// Longest spin, as a divisor of the period. The kernel throttles a real-time thread
/// that never sleeps, for 50 ms of every second.
const MAX_SPIN_DIVISOR: u64 = 4;

/// The clock of a loop. Tests replace it by a simulated one.
pub trait Clock {
    /// Returns the current time, ns since the clock's zero.
    fn now_ns(&self) -> u64;
    /// Waits until `instant_ns`. Returns immediately if it has passed.
    fn wait_until_ns(&self, instant_ns: u64);
    /// Returns the processor time of this thread, ns: the time it has computed,
    /// without the time it has waited for the processor.
    fn cpu_time_ns(&self) -> u64;
}

/// The machine's monotonic clock.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock {
    spin_ns: u64,
}

impl MonotonicClock {
    /// Creates the clock of a loop with the period `tick_ns`. Waits sleep until
    /// `spin` before the instant, at most a quarter of a period, and spin for the
    /// rest.
    #[must_use]
    pub fn new(spin: Duration, tick_ns: u64) -> Self {
        let spin_ns = u64::try_from(spin.as_nanos()).unwrap_or(u64::MAX);
        Self { spin_ns: spin_ns.min(tick_ns / MAX_SPIN_DIVISOR) }
    }
}

impl Clock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        ns(clock_gettime(ClockId::Monotonic))
    }

    fn wait_until_ns(&self, instant_ns: u64) {
        let wake_ns = instant_ns.saturating_sub(self.spin_ns);
        let wake = Timespec {
            tv_sec: (wake_ns / 1_000_000_000).cast_signed(),
            tv_nsec: (wake_ns % 1_000_000_000).cast_signed(),
        };
        // Sleep again after a signal; the instant is absolute, and one in the past returns at
        // once. No other error can occur, and the spin would bridge it.
        while let Err(rustix::io::Errno::INTR) =
            clock_nanosleep_absolute(SleepClock::Monotonic, &wake)
        {}
        while self.now_ns() < instant_ns {
            std::hint::spin_loop();
        }
    }

    fn cpu_time_ns(&self) -> u64 {
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
    fn waits_never_end_early_and_cpu_time_excludes_sleep() {
        let clock = MonotonicClock::new(DEFAULT_SPIN, 1_000_000);
        let (start_ns, cpu_start_ns) = (clock.now_ns(), clock.cpu_time_ns());
        for i in 1..=20 {
            let instant_ns = start_ns + i * 2_000_000;
            clock.wait_until_ns(instant_ns);
            assert!(clock.now_ns() >= instant_ns);
        }
        let cpu_ns = clock.cpu_time_ns() - cpu_start_ns;
        // Each of the 20 waits spins for at most a quarter of 1 ms and sleeps for the rest.
        assert!(cpu_ns < 20_000_000, "{cpu_ns} ns of 40 ms");
        clock.wait_until_ns(0);
    }
}
