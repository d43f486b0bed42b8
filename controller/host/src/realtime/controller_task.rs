//! The controller's work in each real-time tick.

use std::time::Duration;

use leg_control::config::Config;
use leg_control::wire::{Command, Header, Sample};
use leg_control::wire_controller::WireController;

use super::clock::Clock;
use super::run::{Task, TickResult};
use super::schedule::TickSchedule;
use super::tick_stats::RxStatus;
use super::ticker::Tick;
use crate::link::{ControllerLink, LinkError, Role};

/// Number of samples after which the start of the run on the schedule is determined
/// anew.
const WINDOW: u32 = 256;

/// Computes commands for samples. Called by the loop, so it must not allocate, log or
/// wait.
pub trait Control {
    /// Returns the command for a new sample, or for a tick without one.
    fn tick(&mut self, sample: Option<&Sample>) -> Command;
    /// Resets the state at the end of a run, before another.
    fn reset(&mut self);
}

impl<C: Control> Control for &mut C {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        (**self).tick(sample)
    }

    fn reset(&mut self) {
        (**self).reset();
    }
}

/// A controller without anything around it.
#[derive(Debug)]
pub struct Direct<'a> {
    /// The controller.
    pub controller: WireController<'a>,
    /// Configuration for each further run.
    pub config: Config,
}

impl Control for Direct<'_> {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.controller.tick(sample)
    }

    fn reset(&mut self) {
        self.controller.restart(self.config);
    }
}

/// The event that ends the controller's loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitOn {
    /// The end of the leg's run.
    EndOfRun,
    /// A stop signal only: the loop continues with the next run.
    StopSignal,
}

/// The task of a controller: receives the newest sample and sends a command.
#[derive(Debug)]
pub struct ControllerTask<L, C> {
    link: L,
    control: C,
    exit_on: ExitOn,
    ages: SampleAges,
    in_run: bool,
    last: Command,
    samples: u64,
}

impl<L: ControllerLink, C: Control> ControllerTask<L, C> {
    /// Creates the task of a controller on this end of a link, with ticks at `rate_hz`.
    pub fn new(link: L, control: C, rate_hz: u32, exit_on: ExitOn) -> Self {
        Self {
            link,
            control,
            exit_on,
            ages: SampleAges::new(rate_hz),
            in_run: false,
            last: Command::default(),
            samples: 0,
        }
    }

    /// Returns the number of samples received.
    #[must_use]
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Returns the last command.
    #[must_use]
    pub fn last_command(&self) -> &Command {
        &self.last
    }

    fn end_run(&mut self) -> TickResult {
        self.in_run = false;
        match self.exit_on {
            ExitOn::EndOfRun => TickResult { over: true, ..TickResult::default() },
            ExitOn::StopSignal => {
                self.control.reset();
                TickResult { rx: RxStatus::EndOfRun, ..TickResult::default() }
            }
        }
    }
}

impl<L: ControllerLink, C: Control> Task for ControllerTask<L, C> {
    type Error = LinkError;

    fn tick(&mut self, _at: &Tick, clock: &impl Clock) -> Result<TickResult, LinkError> {
        let sample = self.link.receive(Duration::ZERO)?;
        if let Some(sample) = &sample {
            if sample.ends_the_run() {
                return Ok(self.end_run());
            }
            self.in_run = true;
            self.samples += 1;
        } else if !self.in_run {
            return Ok(TickResult::default());
        }
        let received_ns = clock.now_ns();
        let command = self.control.tick(sample.as_ref());
        self.link.send(&command)?;
        // The header of a sample that the guard has rejected is not used for timing.
        let trusted = sample.filter(|_| command.rejected == self.last.rejected);
        let age_ns = trusted.and_then(|sample| self.ages.age_ns(&sample.header, received_ns));
        self.last = command;
        Ok(TickResult {
            rx: if sample.is_some() { RxStatus::New } else { RxStatus::Stale },
            safe: command.is_safe(),
            run_id: command.header.run_id,
            seq: command.header.seq,
            sample_age_ns: age_ns,
            round_trip_ns: age_ns.map(|age| age + clock.now_ns().saturating_sub(received_ns)),
            over: false,
        })
    }
}

/// Computes the ages of samples from their numbers alone.
///
/// The leg's run starts at a tick of the leg's schedule, so the number of a sample
/// that arrives without delay determines this tick. Of many samples, the one with the
/// least delay does.
#[derive(Clone, Copy, Debug)]
struct SampleAges {
    schedule: TickSchedule,
    run_id: Option<u32>,
    /// Estimated tick of the schedule at which the run started.
    start: u64,
    /// The same estimate from the samples of the current window only.
    window_start: u64,
    /// Samples in the current window.
    seen: u32,
}

impl SampleAges {
    fn new(rate_hz: u32) -> Self {
        let schedule = TickSchedule::of(Role::Leg, rate_hz);
        Self { schedule, run_id: None, start: u64::MAX, window_start: u64::MAX, seen: 0 }
    }

    /// Returns the time since the instant that a sample describes, ns.
    fn age_ns(&mut self, header: &Header, now_ns: u64) -> Option<u64> {
        let start = self.schedule.newest(now_ns)?.checked_sub(header.seq)?;
        if self.run_id != Some(header.run_id) {
            (self.run_id, self.start, self.window_start) = (Some(header.run_id), start, start);
            self.seen = 0;
        }
        self.start = self.start.min(start);
        self.window_start = self.window_start.min(start);
        self.seen += 1;
        if self.seen == WINDOW {
            // The leg may have paused in the window, which shifts its later ticks.
            (self.start, self.window_start, self.seen) = (self.window_start, u64::MAX, 0);
        }
        Some(now_ns.saturating_sub(self.schedule.at_ns(self.start + header.seq)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(seq: u64) -> Header {
        Header { run_id: 3, seq, ..Header::default() }
    }

    #[test]
    fn the_age_of_a_sample_counts_from_the_instant_that_it_describes() {
        let mut ages = SampleAges::new(1000);
        // The run starts at tick 20; the controller receives half a period later.
        let at = |tick: u64| tick * 1_000_000 + 750_000;
        assert_eq!(ages.age_ns(&header(0), at(20)), Some(500_000));
        assert_eq!(ages.age_ns(&header(1), at(21)), Some(500_000));
        assert_eq!(ages.age_ns(&header(1), at(23)), Some(2_500_000), "two ticks late");
        assert_eq!(ages.age_ns(&header(9), at(4)), None, "from the future");
        // The first sample arrives late; the first one without delay corrects the estimate.
        let mut ages = SampleAges::new(1000);
        assert_eq!(ages.age_ns(&header(5), at(28)), Some(500_000));
        assert_eq!(ages.age_ns(&header(9), at(29)), Some(500_000));
        assert_eq!(ages.age_ns(&header(10), at(31)), Some(1_500_000));
        // The leg pauses for ten ticks; the next windows forget the earlier start.
        let late = (11..2000).map(|seq| ages.age_ns(&header(seq), at(seq + 30))).last();
        assert_eq!(late, Some(Some(500_000)));
    }
}
