//! The controller's tick in real time.

use std::time::Duration;

use super::super::card::Role;
use super::super::link::{ControllerLink, LinkError};
use super::clock::Clock;
use super::drive::{Done, Task};
use super::grid::Grid;
use super::pacer::Tick;
use super::row::Word;
use leg_control::config::Config;
use leg_control::wire::{Command, Header, Sample};
use leg_control::wire_controller::WireController;

/// Samples over which an age's zero is sought; then it is sought anew.
const WINDOW: u32 = 256;

/// What answers samples. Called by the loop: it must not allocate, log, or wait.
pub trait Law {
    /// The command for the sample that came, or for a tick without one.
    fn tick(&mut self, sample: Option<&Sample>) -> Command;
    /// The run is over, and another may come, which knows nothing of it.
    fn rest(&mut self);
}

impl<W: Law> Law for &mut W {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        (**self).tick(sample)
    }

    fn rest(&mut self) {
        (**self).rest();
    }
}

/// A controller as it is.
#[derive(Debug)]
pub struct Plain<'a> {
    /// The controller.
    pub controller: WireController<'a>,
    /// What it restarts under after a run.
    pub config: Config,
}

impl Law for Plain<'_> {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.controller.tick(sample)
    }

    fn rest(&mut self) {
        self.controller.restart(self.config);
    }
}

/// When the controller's loop ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// When the leg says that its run is over.
    AtFarewell,
    /// Never: it stays for the next run.
    Never,
}

/// The controller's part: newest sample in, command out.
#[derive(Debug)]
pub struct ControllerTask<L, W> {
    link: L,
    law: W,
    ends: Ends,
    ages: Ages,
    in_run: bool,
    last: Command,
    samples: u64,
}

impl<L: ControllerLink, W: Law> ControllerTask<L, W> {
    /// A controller at this end of a link, with ticks at `rate_hz`.
    pub fn new(link: L, law: W, rate_hz: u32, ends: Ends) -> Self {
        Self {
            link,
            law,
            ends,
            ages: Ages::new(rate_hz),
            in_run: false,
            last: Command::default(),
            samples: 0,
        }
    }

    /// Samples taken so far.
    #[must_use]
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// The last command.
    #[must_use]
    pub fn last_command(&self) -> &Command {
        &self.last
    }

    fn rest(&mut self) -> Done {
        self.in_run = false;
        match self.ends {
            Ends::AtFarewell => Done { over: true, ..Done::default() },
            Ends::Never => {
                self.law.rest();
                Done { word: Word::Farewell, ..Done::default() }
            }
        }
    }
}

impl<L: ControllerLink, W: Law> Task for ControllerTask<L, W> {
    type Error = LinkError;

    fn tick(&mut self, _at: &Tick, clock: &impl Clock) -> Result<Done, LinkError> {
        let sample = self.link.receive(Duration::ZERO)?;
        if let Some(sample) = &sample {
            if sample.ends_the_run() {
                return Ok(self.rest());
            }
            self.in_run = true;
            self.samples += 1;
        } else if !self.in_run {
            return Ok(Done::default());
        }
        let taken_ns = clock.now_ns();
        let command = self.law.tick(sample.as_ref());
        self.link.send(&command)?;
        // A header that the guard has rejected says nothing of time.
        let trusted = sample.filter(|_| command.rejected == self.last.rejected);
        let age_ns = trusted.and_then(|sample| self.ages.age_ns(&sample.header, taken_ns));
        self.last = command;
        Ok(Done {
            word: if sample.is_some() { Word::New } else { Word::Stale },
            safe: command.is_safe(),
            run_id: command.header.run_id,
            seq: command.header.seq,
            sample_age_ns: age_ns,
            round_trip_ns: age_ns.map(|age| age + clock.now_ns().saturating_sub(taken_ns)),
            over: false,
        })
    }
}

/// How old samples are, by their numbers alone.
///
/// A leg's run begins at a tick of the leg's grid, so a sample that is as fresh
/// as can be tells which one; of many, the freshest does.
#[derive(Clone, Copy, Debug)]
struct Ages {
    grid: Grid,
    run_id: Option<u32>,
    /// Tick of the grid at which the run began, as far as is known.
    zero: u64,
    /// The same by the samples since the last window's end.
    next_zero: u64,
    seen: u32,
}

impl Ages {
    fn new(rate_hz: u32) -> Self {
        let grid = Grid::of(Role::Leg, rate_hz);
        Self { grid, run_id: None, zero: u64::MAX, next_zero: u64::MAX, seen: 0 }
    }

    /// Time since the instant that a sample describes, ns.
    fn age_ns(&mut self, header: &Header, now_ns: u64) -> Option<u64> {
        let zero = self.grid.newest(now_ns)?.checked_sub(header.seq)?;
        if self.run_id != Some(header.run_id) {
            (self.run_id, self.zero, self.next_zero) = (Some(header.run_id), zero, zero);
            self.seen = 0;
        }
        self.zero = self.zero.min(zero);
        self.next_zero = self.next_zero.min(zero);
        self.seen += 1;
        if self.seen == WINDOW {
            // The leg may have been held meanwhile: what was true is not for ever.
            (self.zero, self.next_zero, self.seen) = (self.next_zero, u64::MAX, 0);
        }
        Some(now_ns.saturating_sub(self.grid.at_ns(self.zero + header.seq)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(seq: u64) -> Header {
        Header { run_id: 3, seq, ..Header::default() }
    }

    #[test]
    fn a_sample_is_as_old_as_the_instant_that_it_describes() {
        let mut ages = Ages::new(1000);
        // The run began at 20 ms; the controller looks half a tick later.
        let at = |tick: u64| tick * 1_000_000 + 750_000;
        assert_eq!(ages.age_ns(&header(0), at(20)), Some(500_000));
        assert_eq!(ages.age_ns(&header(1), at(21)), Some(500_000));
        assert_eq!(ages.age_ns(&header(1), at(23)), Some(2_500_000), "two ticks late");
        assert_eq!(ages.age_ns(&header(9), at(4)), None, "from the future");
        // First seen late: corrected by the first fresh one.
        let mut ages = Ages::new(1000);
        assert_eq!(ages.age_ns(&header(5), at(28)), Some(500_000));
        assert_eq!(ages.age_ns(&header(9), at(29)), Some(500_000));
        assert_eq!(ages.age_ns(&header(10), at(31)), Some(1_500_000));
        // The leg is held for ten ticks: soon forgotten.
        let late = (11..2000).map(|seq| ages.age_ns(&header(seq), at(seq + 30))).last();
        assert_eq!(late, Some(Some(500_000)));
    }
}
