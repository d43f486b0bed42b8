//! The control law once a tick, whatever a tick is.

use super::message::{Mode, PolicyReport, Slot, cut};
use crate::config::{Config, ConfigError};
use crate::policy::Policy;
use crate::wire::{Command, Sample};
use crate::wire_controller::WireController;

/// Ticks a second before the first reset, Hz.
const USUAL_RATE_HZ: u32 = 1_000;
/// Gravity before the first reset, m/s2.
const USUAL_GRAVITY_M_S2: f32 = 9.81;

/// Counters of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunCounts {
    /// Ticks run.
    pub ticks: u32,
    /// Live: ticks that no new sample had come for.
    pub missed: u32,
    /// Live: samples replaced by a newer one before their tick.
    pub overwritten: u32,
    /// Live: ticks that began when the one before was not done.
    pub overruns: u32,
    /// Samples and requests said again, answered again.
    pub repeated: u32,
    /// Policies swapped in.
    pub swaps: u32,
}

/// On what terms a run goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
}

impl Terms {
    /// The control law's configuration.
    ///
    /// # Errors
    /// [`ConfigError`] when a figure is out of range.
    pub fn config(&self) -> Result<Config, ConfigError> {
        Config::at_rate(self.rate_hz)?.with_gravity(self.gravity_m_s2)
    }
}

/// A set-point that is not finite or beyond the guard's limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPointFault {
    /// Greatest magnitude, m/s.
    pub most_m_s: f32,
}

/// A policy at work, and the slots of it and of the one to come.
#[derive(Clone, Debug)]
struct Running<'a> {
    controller: WireController<'a>,
    slot: Slot,
    next: Option<Slot>,
}

/// Answers samples by commands, in each [`Mode`]; without a policy by safe ones.
#[derive(Clone, Debug)]
pub struct Pilot<'a> {
    running: Option<Running<'a>>,
    config: Config,
    terms: Terms,
    session: Option<u32>,
    mode: Mode,
    set_point_m_s: Option<f32>,
    /// Live: the sample for the next tick.
    fresh: Option<(u32, Sample)>,
    /// The last turn that was handled, and what came of it.
    answered: Option<(u32, Command)>,
    counts: RunCounts,
}

impl Default for Pilot<'_> {
    fn default() -> Self {
        Self::new()
    }
}

impl<'a> Pilot<'a> {
    /// Idle, without a policy, at 1 kHz on Earth.
    #[must_use]
    pub fn new() -> Self {
        Self {
            running: None,
            config: Config::default(),
            terms: Terms { rate_hz: USUAL_RATE_HZ, gravity_m_s2: USUAL_GRAVITY_M_S2 },
            session: None,
            mode: Mode::Idle,
            set_point_m_s: None,
            fresh: None,
            answered: None,
            counts: RunCounts::default(),
        }
    }

    /// Runs this policy, of this slot: from the next apex if another one flies
    /// the leg, else at once.
    #[inline(never)]
    pub fn fly(&mut self, slot: Slot, policy: &Policy<'a>) {
        let policy = policy.clone();
        if let Some(running) = &mut self.running {
            running.next = Some(slot);
            running.controller.swap(policy);
        } else {
            let controller = WireController::new(policy, self.config);
            self.running = Some(Running { controller, slot, next: Some(slot) });
        }
        self.note_swap();
    }

    /// Forgets the run and begins another under these terms: idle, counters at
    /// 0, no set-point of its own. A policy that waits for an apex is in.
    ///
    /// # Errors
    /// [`ConfigError`] when a figure is out of range; nothing has changed then.
    pub fn reset(&mut self, session: u32, terms: Terms) -> Result<(), ConfigError> {
        self.config = terms.config()?;
        self.terms = terms;
        self.session = Some(session);
        self.set_point_m_s = None;
        self.counts = RunCounts::default();
        self.set_mode(Mode::Idle);
        Ok(())
    }

    /// How ticks come about from now on. Idle forgets the run.
    #[inline(never)]
    pub fn set_mode(&mut self, mode: Mode) {
        self.fresh = None;
        self.answered = None;
        self.mode = mode;
        if mode == Mode::Idle {
            if let Some(running) = &mut self.running {
                running.controller.restart(self.config);
            }
            self.note_swap();
        }
    }

    /// The speed to keep, m/s, in place of that of the samples; `None`: theirs.
    ///
    /// # Errors
    /// [`SetPointFault`] when it is not finite or beyond the guard's limit.
    pub fn set_point(&mut self, set_point_m_s: Option<f32>) -> Result<(), SetPointFault> {
        let most_m_s = self.config.limits().max_speed_m_s;
        // A NaN is within nothing.
        if set_point_m_s.is_none_or(|v| (-most_m_s..=most_m_s).contains(&v)) {
            self.set_point_m_s = set_point_m_s;
            Ok(())
        } else {
            Err(SetPointFault { most_m_s })
        }
    }

    /// Takes a sample; returns the command to send now, if there is one. Live,
    /// it comes of the next [`Self::live_tick`].
    ///
    /// The last turn again gives its command again, and is no tick.
    pub fn sample(&mut self, turn: u32, sample: &Sample) -> Option<Command> {
        if let Some((_, command)) = self.answered.filter(|(last, _)| *last == turn) {
            self.count_repeated();
            return Some(command);
        }
        match self.mode {
            Mode::Idle => {
                let command = Command::safe(&sample.header);
                self.answered = Some((turn, command));
                Some(command)
            }
            Mode::LockStep => Some(self.tick(turn, sample)),
            Mode::Live => {
                match self.fresh.replace((turn, *sample)) {
                    Some((waiting, _)) if waiting == turn => self.count_repeated(),
                    Some(_) => increment(&mut self.counts.overwritten),
                    None => {}
                }
                None
            }
        }
    }

    /// Live, at each beat of the board's timer: a tick, and the command to send
    /// with the turn of the newest sample. None in other modes, and before the
    /// first sample.
    pub fn live_tick(&mut self) -> Option<(u32, Command)> {
        if self.mode != Mode::Live {
            return None;
        }
        if let Some((turn, sample)) = self.fresh.take() {
            return Some((turn, self.tick(turn, &sample)));
        }
        let (turn, last) = self.answered?;
        increment(&mut self.counts.missed);
        increment(&mut self.counts.ticks);
        let command = match &mut self.running {
            Some(running) => running.controller.tick(None),
            None => Command::safe(&last.header),
        };
        self.note_swap();
        self.answered = Some((turn, command));
        Some((turn, command))
    }

    /// Apart, so that an image has the control law once.
    #[inline(never)]
    fn tick(&mut self, turn: u32, sample: &Sample) -> Command {
        increment(&mut self.counts.ticks);
        let command = match &mut self.running {
            Some(running) => {
                let set_point_m_s = self.set_point_m_s.unwrap_or(sample.set_point_m_s);
                running.controller.tick_at(Some(sample), Some(set_point_m_s))
            }
            None => Command::safe(&sample.header),
        };
        self.note_swap();
        self.answered = Some((turn, command));
        command
    }

    /// After whatever may have taken the policy that waits.
    fn note_swap(&mut self) {
        if let Some(running) = &mut self.running
            && !running.controller.swap_is_pending()
            && let Some(slot) = running.next.take()
        {
            running.slot = slot;
            increment(&mut self.counts.swaps);
        }
    }

    /// Counts a tick that began when the one before was not done.
    pub fn count_overrun(&mut self) {
        increment(&mut self.counts.overruns);
    }

    /// Counts a sample or request said again.
    pub fn count_repeated(&mut self) {
        increment(&mut self.counts.repeated);
    }

    /// Counters since the last reset.
    #[must_use]
    pub fn counts(&self) -> &RunCounts {
        &self.counts
    }

    /// The last turn that was handled in this mode, and the command for it.
    #[must_use]
    pub fn answered(&self) -> Option<&(u32, Command)> {
        self.answered.as_ref()
    }

    /// On what terms the run goes.
    #[must_use]
    pub fn terms(&self) -> Terms {
        self.terms
    }

    /// The number given by the last reset.
    #[must_use]
    pub fn session(&self) -> Option<u32> {
        self.session
    }

    /// How ticks come about.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether a policy waits for the next apex.
    #[must_use]
    pub fn swap_is_pending(&self) -> bool {
        self.running.as_ref().is_some_and(|running| running.next.is_some())
    }

    /// The slot of the policy that runs.
    #[must_use]
    pub fn slot(&self) -> Option<Slot> {
        self.running.as_ref().map(|running| running.slot)
    }

    /// The policy that runs.
    #[must_use]
    pub fn report(&self) -> Option<PolicyReport<'a>> {
        let running = self.running.as_ref()?;
        let policy = running.controller.policy();
        let manifest = policy.manifest();
        Some(PolicyReport {
            slot: running.slot,
            name: cut(manifest.name),
            crc32: policy.crc32(),
            leg: manifest.leg.fingerprint(),
        })
    }
}

/// A pilot that the desk shares with whatever ticks: a timer's interrupt, or
/// another thread.
pub trait SharedPilot {
    /// Calls `f` with the pilot, alone with it. No tick can happen meanwhile,
    /// so what is called takes little time.
    fn with<R>(&self, f: impl FnOnce(&mut Pilot<'static>) -> R) -> R;
}

fn increment(count: &mut u32) {
    *count = count.saturating_add(1);
}
