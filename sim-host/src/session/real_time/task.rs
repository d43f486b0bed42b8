//! The leg's part of the loop: one call per tick of the clock.

use std::time::Duration;

use leg_control::wire::{Command, Header};
use leg_host::realtime::{Clock, RxStatus, Task, Tick, TickResult};
use leg_host::{LegLink, LinkError};

use super::{OnFall, Options, START_HOLD};
use crate::scenario::Scenario;
use crate::session::hooks::Hooks;
use crate::session::leg::{Leg, TickRecord};
use crate::session::outcome::Ending;

/// Ticks after which a leg that is held at its start sends its sample again,
/// because the last one may be lost.
const RESEND_TICKS: u64 = 10;
/// Samples whose send times are kept. A command that answers an older sample is
/// rejected.
const SEND_TIMES: usize = 32;

/// The leg's part of the loop.
#[derive(Debug)]
pub struct LegTask<'a, 'l, L, H> {
    leg: Leg<'a>,
    link: &'l mut L,
    on_fall: OnFall,
    run_id: u32,
    hooks: &'l mut H,
    sent: SendTimes,
    hold: StartHold,
    /// The last command received.
    last: Option<Header>,
    /// The last valid command.
    in_force: Option<Header>,
    ending: Option<Ending>,
}

impl<'a, 'l, L: LegLink, H: Hooks> LegTask<'a, 'l, L, H> {
    /// Creates a leg at its start that has not sent a sample yet.
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
            sent: SendTimes::default(),
            hold: StartHold::new(scenario.rate_hz),
            last: None,
            in_force: None,
            ending: None,
        }
    }

    /// Returns why the run is over, or `None` while it is not.
    #[must_use]
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// Returns the leg, and why the run is over, if it is.
    #[must_use]
    pub fn finish(self) -> (Leg<'a>, Option<Ending>) {
        (self.leg, self.ending)
    }

    /// Receives the newest command, unless it is the one received last: without a
    /// new sample the controller sends its last command again.
    fn receive_new(&mut self) -> Result<Option<Command>, LinkError> {
        let last = self.last;
        let is_new = |command: &Command| {
            let Header { run_id, seq, .. } = command.header;
            last.is_none_or(|last| (last.run_id, last.seq) != (run_id, seq))
        };
        let command = self.link.receive(Duration::ZERO)?.filter(is_new);
        self.last = command.map(|command| command.header).or(self.last);
        Ok(command)
    }

    fn send_sample(&mut self, clock: &impl Clock) -> Result<(), LinkError> {
        // Not between sending and playing, where the observers would get another set-point than the
        // controller.
        self.hooks.steer(&mut self.leg);
        self.sent.record(&self.leg.sample().header, clock.now_ns());
        self.link.send(self.leg.sample())
    }

    /// Plays `ticks` ticks of the plant.
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
            self.link.send(&self.leg.end_sample())?;
            return Ok(TickResult { run_id: self.run_id, over: true, ..TickResult::default() });
        }
        let command = self.receive_new()?;
        let was_held = self.hold.is_active();
        let is_answered = command.is_some_and(|command| self.leg.is_answered_by(&command));
        match self.hold.tick(1 + at.missed, is_answered) {
            HoldState::Released => (),
            HoldState::Wait => {
                return Ok(TickResult { run_id: self.run_id, ..TickResult::default() });
            }
            HoldState::Send => {
                self.send_sample(clock)?;
                return Ok(TickResult { run_id: self.run_id, ..TickResult::default() });
            }
        }
        // Time does not wait: missed ticks are played too, under the command in force now.
        let mut done = self.play(1 + at.missed, command, clock.now_ns());
        if was_held {
            // This time is the controller's start-up and not a round trip.
            (done.sample_age_ns, done.round_trip_ns) = (None, None);
        }
        match self.leg.ending() {
            None => self.send_sample(clock)?,
            Some(Ending::Fall) if self.on_fall == OnFall::Restart => {
                self.run_id = self.run_id.wrapping_add(1);
                self.leg.restart(self.run_id);
                self.hold.restart();
                self.in_force = None;
                self.send_sample(clock)?;
            }
            ending => {
                self.ending = ending;
                self.link.send(&self.leg.end_sample())?;
                return Ok(TickResult { over: true, ..done });
            }
        }
        Ok(done)
    }
}

/// Holds the leg at its start until a command arrives, for a limited time.
#[derive(Debug)]
struct StartHold {
    limit_ticks: u64,
    /// Ticks held so far; `None` once the leg is released.
    ticks: Option<u64>,
}

/// What to do in a tick.
#[derive(Debug, PartialEq, Eq)]
enum HoldState {
    /// Play the tick.
    Released,
    /// Do nothing.
    Wait,
    /// Send the sample again.
    Send,
}

impl StartHold {
    fn new(rate_hz: u32) -> Self {
        Self { limit_ticks: START_HOLD.as_secs() * u64::from(rate_hz), ticks: Some(0) }
    }

    /// Holds the leg again, for another run whose first sample is sent already.
    fn restart(&mut self) {
        self.ticks = Some(1);
    }

    fn is_active(&self) -> bool {
        self.ticks.is_some()
    }

    fn tick(&mut self, passed: u64, is_answered: bool) -> HoldState {
        let Some(ticks) = self.ticks.as_mut().filter(|ticks| **ticks < self.limit_ticks) else {
            self.ticks = None;
            return HoldState::Released;
        };
        if is_answered {
            self.ticks = None;
            return HoldState::Released;
        }
        let before = *ticks;
        *ticks += passed;
        if before.div_ceil(RESEND_TICKS) < ticks.div_ceil(RESEND_TICKS) {
            HoldState::Send
        } else {
            HoldState::Wait
        }
    }
}

/// Send times of the latest samples: run id, number, time in ns.
#[derive(Debug, Default)]
struct SendTimes([Option<(u32, u64, u64)>; SEND_TIMES]);

impl SendTimes {
    fn record(&mut self, header: &Header, now_ns: u64) {
        self.0[header.seq as usize % SEND_TIMES] = Some((header.run_id, header.seq, now_ns));
    }

    /// Returns the time since the sample with this header was sent, ns.
    fn age_ns(&self, header: &Header, now_ns: u64) -> Option<u64> {
        let (run_id, seq, sent_ns) = self.0[header.seq as usize % SEND_TIMES]?;
        ((run_id, seq) == (header.run_id, header.seq)).then(|| now_ns.saturating_sub(sent_ns))
    }
}
