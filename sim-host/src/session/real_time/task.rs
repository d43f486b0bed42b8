//! What the leg does at a tick of the clock.

use std::time::Duration;

use leg_control::wire::{Command, Header};
use leg_host::realtime::{Clock, RxStatus, Task, Tick, TickResult};
use leg_host::{LegLink, LinkError};

use super::{HOLD, OnFall, Options};
use crate::scenario::Scenario;
use crate::session::hooks::Hooks;
use crate::session::leg::{Leg, TickRecord};
use crate::session::outcome::Ending;

/// A leg that is held says again, after so many ticks, what it senses: a
/// sample may be lost.
const SAY_AGAIN_TICKS: u64 = 10;
/// Samples of which the time of sending is remembered; older ones are answered
/// by no command that counts.
const REMEMBERED: usize = 32;

/// The leg's part of the loop.
#[derive(Debug)]
pub struct LegTask<'a, 'l, L, H> {
    leg: Leg<'a>,
    link: &'l mut L,
    on_fall: OnFall,
    run_id: u32,
    hooks: &'l mut H,
    sent: Sent,
    hold: Hold,
    /// The last command received.
    last: Option<Header>,
    /// The last command that counted.
    in_force: Option<Header>,
    ending: Option<Ending>,
}

impl<'a, 'l, L: LegLink, H: Hooks> LegTask<'a, 'l, L, H> {
    /// A leg at its start, that has not said anything yet.
    pub fn new(
        scenario: &'a Scenario,
        link: &'l mut L,
        options: Options,
        hooks: &'l mut H,
    ) -> Self {
        let Options { run_id, on_fall } = options;
        Self {
            leg: Leg::new(scenario, run_id),
            link,
            on_fall,
            run_id,
            hooks,
            sent: Sent::default(),
            hold: Hold::new(scenario.rate_hz),
            last: None,
            in_force: None,
            ending: None,
        }
    }

    /// Why the run is over, once it is.
    #[must_use]
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// The leg, and why its run is over, if it is.
    #[must_use]
    pub fn finish(self) -> (Leg<'a>, Option<Ending>) {
        (self.leg, self.ending)
    }

    /// The newest command, if it has not been seen before. (A controller that
    /// hears nothing new says the same again.)
    fn newest(&mut self) -> Result<Option<Command>, LinkError> {
        let last = self.last;
        let is_new = |command: &Command| {
            let Header { run_id, seq, .. } = command.header;
            last.is_none_or(|last| (last.run_id, last.seq) != (run_id, seq))
        };
        let command = self.link.receive(Duration::ZERO)?.filter(is_new);
        self.last = command.map(|command| command.header).or(self.last);
        Ok(command)
    }

    fn say(&mut self, clock: &impl Clock) -> Result<(), LinkError> {
        self.sent.note(&self.leg.sample().header, clock.now_ns());
        self.link.send(self.leg.sample())
    }

    /// Plays the time of so many ticks.
    fn play(&mut self, ticks: u64, mut command: Option<Command>, now_ns: u64) -> TickResult {
        let round_trip_ns = command.and_then(|command| self.sent.age_ns(&command.header, now_ns));
        let round_trip = Duration::from_nanos(round_trip_ns.unwrap_or(0));
        let (mut is_new, mut is_safe) = (false, false);
        for _ in 0..ticks {
            if self.leg.ending().is_some() {
                break;
            }
            let (in_force, hooks) = (&mut self.in_force, &mut *self.hooks);
            self.leg.step(command.take(), round_trip, &mut |record: &TickRecord| {
                is_safe = record.command.is_safe();
                if record.is_new {
                    is_new = true;
                    *in_force = Some(record.command.header);
                }
                hooks.observe(record);
            });
        }
        TickResult {
            rx: if is_new { RxStatus::New } else { RxStatus::Stale },
            safe: is_safe,
            run_id: self.run_id,
            seq: self.leg.seq().saturating_sub(1),
            sample_age_ns: self.in_force.and_then(|header| self.sent.age_ns(&header, now_ns)),
            round_trip_ns: round_trip_ns.filter(|_| is_new),
            over: false,
        }
    }
}

impl<L: LegLink, H: Hooks> Task for LegTask<'_, '_, L, H> {
    type Error = LinkError;

    fn tick(&mut self, at: &Tick, clock: &impl Clock) -> Result<TickResult, LinkError> {
        if self.hooks.ends() {
            self.ending = Some(Ending::Stopped);
            self.link.send(&self.leg.farewell())?;
            return Ok(TickResult { run_id: self.run_id, over: true, ..TickResult::default() });
        }
        self.hooks.steer(&mut self.leg);
        let command = self.newest()?;
        let was_held = self.hold.is_held();
        let is_answered = command.is_some_and(|command| self.leg.is_answered_by(&command));
        match self.hold.tick(1 + at.missed, is_answered) {
            Held::Free => (),
            Held::Quiet => return Ok(TickResult { run_id: self.run_id, ..TickResult::default() }),
            Held::Speaks => {
                self.say(clock)?;
                return Ok(TickResult { run_id: self.run_id, ..TickResult::default() });
            }
        }
        // Time does not wait: what was slept through is played too, under what is known now.
        let mut done = self.play(1 + at.missed, command, clock.now_ns());
        if was_held {
            // How long a controller takes to begin is not how long it takes to answer.
            (done.sample_age_ns, done.round_trip_ns) = (None, None);
        }
        match self.leg.ending() {
            None => self.say(clock)?,
            Some(Ending::Fall) if self.on_fall == OnFall::Restart => {
                self.run_id = self.run_id.wrapping_add(1);
                self.leg.restart(self.run_id);
                self.hold.begin();
                self.in_force = None;
                self.say(clock)?;
            }
            ending => {
                self.ending = ending;
                self.link.send(&self.leg.farewell())?;
                return Ok(TickResult { over: true, ..done });
            }
        }
        Ok(done)
    }
}

/// Keeps a leg at its start until it is commanded, or the time is over.
#[derive(Debug)]
struct Hold {
    limit_ticks: u64,
    /// Ticks so far; `None` once it is let go.
    ticks: Option<u64>,
}

/// What a leg does in a tick.
#[derive(Debug, PartialEq, Eq)]
enum Held {
    /// It moves.
    Free,
    /// It is held.
    Quiet,
    /// It is held, and says what it senses.
    Speaks,
}

impl Hold {
    fn new(rate_hz: u32) -> Self {
        Self { limit_ticks: HOLD.as_secs() * u64::from(rate_hz), ticks: Some(0) }
    }

    /// Another run, of which the first sample is said.
    fn begin(&mut self) {
        self.ticks = Some(1);
    }

    fn is_held(&self) -> bool {
        self.ticks.is_some()
    }

    fn tick(&mut self, passed: u64, is_answered: bool) -> Held {
        let Some(ticks) = self.ticks.as_mut().filter(|ticks| **ticks < self.limit_ticks) else {
            self.ticks = None;
            return Held::Free;
        };
        if is_answered {
            self.ticks = None;
            return Held::Free;
        }
        let before = *ticks;
        *ticks += passed;
        if before.div_ceil(SAY_AGAIN_TICKS) < ticks.div_ceil(SAY_AGAIN_TICKS) {
            Held::Speaks
        } else {
            Held::Quiet
        }
    }
}

/// When the latest samples were sent.
#[derive(Debug, Default)]
struct Sent([Option<(u32, u64, u64)>; REMEMBERED]);

impl Sent {
    fn note(&mut self, header: &Header, now_ns: u64) {
        self.0[header.seq as usize % REMEMBERED] = Some((header.run_id, header.seq, now_ns));
    }

    /// Time since the sample with this run id and number was sent, ns.
    fn age_ns(&self, header: &Header, now_ns: u64) -> Option<u64> {
        let (run_id, seq, sent_ns) = self.0[header.seq as usize % REMEMBERED]?;
        ((run_id, seq) == (header.run_id, header.seq)).then(|| now_ns.saturating_sub(sent_ns))
    }
}
