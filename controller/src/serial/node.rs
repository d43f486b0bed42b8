//! The control node: runs the control law once a tick, whatever makes a tick.

use core::error::Error;
use core::fmt;

use super::error::RequestError;
pub use super::message::SessionParams;
use super::message::{
    Activity, Estimator, Mode, PolicyReport, RejectCounts, RunCounts, RunStatus, RunTick, Slot, cut,
};
use crate::config::{Config, ConfigError, Estimation, RATE_HZ, STALE_LIMIT_NS};
#[cfg(feature = "estimator")]
use crate::estimator::{SensorNoise, StateNoise};
use crate::guard::{Limits, SAFE_AFTER_NS};
use crate::policy::Policy;
use crate::wire::{Command, Sample};
use crate::wire_controller::WireController;

impl Default for SessionParams {
    /// Returns those before the first reset: 1 kHz on Earth, by the readings.
    fn default() -> Self {
        Self {
            rate_hz: 1_000,
            gravity_m_s2: 9.81,
            stale_limit_ns: SAFE_AFTER_NS as u32,
            estimator: Estimator::Readings,
        }
    }
}

impl SessionParams {
    /// Returns the configuration of the control law.
    ///
    /// # Errors
    /// [`ConfigError`] when a parameter is out of range, or the law was built without the
    /// estimator that it asks for.
    pub fn config(&self) -> Result<Config, ConfigError> {
        Config::at_rate(self.rate_hz)?
            .with_gravity(self.gravity_m_s2)?
            .with_stale_limit(self.stale_limit_ns.into())?
            .with_estimation(self.estimator.try_into()?)
    }
}

impl TryFrom<Estimator> for Estimation {
    type Error = ConfigError;

    fn try_from(estimator: Estimator) -> Result<Self, ConfigError> {
        match estimator {
            Estimator::Readings => Ok(Self::Readings),
            #[cfg(feature = "estimator")]
            Estimator::State { velocity_m_s, height_m, leg_length_m } => {
                Ok(Self::StateChannels(StateNoise { velocity_m_s, height_m, leg_length_m }))
            }
            #[cfg(feature = "estimator")]
            Estimator::Inertial { figures } => {
                Ok(Self::Inertial(SensorNoise::from_figures(figures)))
            }
            #[cfg(not(feature = "estimator"))]
            Estimator::State { .. } | Estimator::Inertial { .. } => Err(ConfigError::NoEstimator),
        }
    }
}

/// A set-point that is not finite or beyond the guard's limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPointError {
    /// Greatest magnitude, m/s.
    pub most_m_s: f32,
}

impl fmt::Display for SetPointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        RequestError::from(*self).fmt(f)
    }
}

impl Error for SetPointError {}

impl From<SetPointError> for RequestError {
    fn from(SetPointError { most_m_s }: SetPointError) -> Self {
        Self::SetPoint { most_m_s }
    }
}

impl From<ConfigError> for RequestError {
    fn from(error: ConfigError) -> Self {
        match error {
            ConfigError::Rate(_) => Self::Rate { least: *RATE_HZ.start(), most: *RATE_HZ.end() },
            ConfigError::StaleLimit(_) => Self::StaleLimit {
                least_ns: *STALE_LIMIT_NS.start() as u32,
                most_ns: *STALE_LIMIT_NS.end() as u32,
            },
            ConfigError::Noise => Self::Noise,
            ConfigError::NoEstimator => Self::NoEstimator,
            // The limits are as usual: they cannot be at fault.
            ConfigError::Gravity(_) | ConfigError::Limits => Self::Gravity,
        }
    }
}

/// A policy that runs, and the slot of the one that waits.
#[derive(Clone, Debug)]
struct Running<'a> {
    controller: WireController<'a>,
    slot: Slot,
    next: Option<Slot>,
}

/// A node's state, for whoever is not the one that ticks it.
#[derive(Clone, Copy, Debug)]
pub struct NodeStatus<'a> {
    /// The number of the last reset.
    pub session: Option<u32>,
    /// What makes a tick.
    pub mode: Mode,
    /// The parameters of the session.
    pub params: SessionParams,
    /// The policy that runs.
    pub policy: Option<PolicyReport<'a>>,
    /// The state of the run.
    pub run: RunStatus,
}

/// Answers samples by commands, in each [`Mode`]; without a policy by safe ones.
#[derive(Clone, Debug)]
pub struct ControlNode<'a> {
    running: Option<Running<'a>>,
    config: Config,
    params: SessionParams,
    session: Option<u32>,
    mode: Mode,
    set_point_m_s: Option<f32>,
    /// Live mode: the sample for the next tick.
    fresh: Option<(u32, Sample)>,
    /// The last sequence number that was answered, and the command.
    answered: Option<(u32, Command)>,
    counts: RunCounts,
}

impl Default for ControlNode<'_> {
    fn default() -> Self {
        Self::new()
    }
}

impl<'a> ControlNode<'a> {
    /// Makes a node that is idle, without a policy, at 1 kHz on Earth.
    #[must_use]
    pub fn new() -> Self {
        Self {
            running: None,
            config: Config::default(),
            params: SessionParams::default(),
            session: None,
            mode: Mode::Idle,
            set_point_m_s: None,
            fresh: None,
            answered: None,
            counts: RunCounts::default(),
        }
    }

    /// Runs this policy, of this slot: from the next apex on if an action of
    /// another one is in force, else at once. One that still waits gives way.
    #[inline(never)]
    pub fn run_policy(&mut self, slot: Slot, policy: &Policy<'a>) {
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

    /// Forgets the run and begins another with these parameters: idle, counters
    /// at 0, no set-point of its own. A policy that waits for an apex runs.
    ///
    /// # Errors
    /// [`ConfigError`] when a parameter is out of range; nothing has changed then.
    pub fn reset(&mut self, session: u32, params: SessionParams) -> Result<(), ConfigError> {
        self.config = params.config()?;
        self.params = params;
        self.session = Some(session);
        self.set_point_m_s = None;
        self.counts = RunCounts::default();
        self.set_mode(Mode::Idle);
        Ok(())
    }

    /// Sets what makes a tick. Idle forgets the run.
    #[inline(never)]
    pub fn set_mode(&mut self, mode: Mode) {
        self.fresh = None;
        self.answered = None;
        self.mode = mode;
        if mode == Mode::Idle {
            self.end_run();
        }
    }

    /// Forgets the run, in whatever mode, and is ready for the next. A policy
    /// that waits for an apex runs.
    pub fn end_run(&mut self) {
        (self.fresh, self.answered) = (None, None);
        if let Some(running) = &mut self.running {
            running.controller.restart(self.config);
        }
        self.note_swap();
    }

    /// Sets the speed to keep, m/s, in place of that in the samples; `None`
    /// returns to that in the samples.
    ///
    /// # Errors
    /// [`SetPointError`] when it is not finite or beyond the guard's limit.
    pub fn set_point(&mut self, set_point_m_s: Option<f32>) -> Result<(), SetPointError> {
        check_set_point(set_point_m_s)?;
        self.set_point_m_s = set_point_m_s;
        Ok(())
    }

    /// Takes a sample from the line; returns the command to send now, if there
    /// is one. In live mode it comes from the next [`Self::live_tick`].
    ///
    /// A repeated sequence number gives the same command again, and is no tick.
    pub fn sample(&mut self, seq: u32, sample: &Sample) -> Option<Command> {
        if let Some((_, command)) = self.answered.filter(|(last, _)| *last == seq) {
            self.count_repeated();
            return Some(command);
        }
        match self.mode {
            Mode::Idle => {
                let command = Command::safe(&sample.header);
                self.answered = Some((seq, command));
                Some(command)
            }
            Mode::LockStep => Some(self.tick(seq, Some(sample))),
            Mode::Live => {
                match self.fresh.replace((seq, *sample)) {
                    Some((waiting, _)) if waiting == seq => self.count_repeated(),
                    Some(_) => increment(&mut self.counts.overwritten),
                    None => {}
                }
                None
            }
        }
    }

    /// Runs a tick of the timer in live mode, and returns the command to send
    /// with the sequence number of the newest sample. Returns `None` in other
    /// modes, and before the first sample.
    pub fn live_tick(&mut self) -> Option<(u32, Command)> {
        if self.mode != Mode::Live {
            return None;
        }
        let (seq, sample) = match self.fresh.take() {
            Some((seq, sample)) => (seq, Some(sample)),
            None => (self.answered?.0, None),
        };
        Some((seq, self.tick(seq, sample.as_ref())))
    }

    /// Runs a tick with the sample that came, or without one, and returns its
    /// command: for callers whose samples do not come over the line.
    ///
    /// Not inlined, so that an image has the control law once.
    #[inline(never)]
    pub fn tick(&mut self, seq: u32, sample: Option<&Sample>) -> Command {
        self.counts.ticks += 1;
        self.counts.missed += u64::from(sample.is_none());
        let last = self.answered.map(|(_, command)| command.header).unwrap_or_default();
        let command = match &mut self.running {
            Some(running) => {
                let set_point_m_s =
                    self.set_point_m_s.or(sample.map(|sample| sample.set_point_m_s));
                running.controller.tick_at(sample, set_point_m_s)
            }
            None => Command::safe(&sample.map_or(last, |sample| sample.header)),
        };
        self.note_swap();
        self.answered = Some((seq, command));
        command
    }

    /// Records that the waiting policy runs, after whatever may have let it in.
    fn note_swap(&mut self) {
        if let Some(running) = &mut self.running
            && !running.controller.swap_is_pending()
            && let Some(slot) = running.next.take()
        {
            running.slot = slot;
            increment(&mut self.counts.swaps);
        }
    }

    /// Counts a tick that began before the one before had ended.
    pub fn count_overrun(&mut self) {
        increment(&mut self.counts.overruns);
    }

    /// Counts a sample or a request that was received again.
    pub fn count_repeated(&mut self) {
        increment(&mut self.counts.repeated);
    }

    /// Returns the last sequence number that was answered in this mode, and the
    /// command.
    #[must_use]
    pub fn answered(&self) -> Option<&(u32, Command)> {
        self.answered.as_ref()
    }

    /// Returns what makes a tick, and the ticks a second.
    #[must_use]
    pub fn mode(&self) -> (Mode, u32) {
        (self.mode, self.params.rate_hz)
    }

    /// Returns the control law that runs.
    #[must_use]
    pub fn controller(&self) -> Option<&WireController<'a>> {
        self.running.as_ref().map(|running| &running.controller)
    }

    /// Returns the policy that runs.
    #[must_use]
    pub fn report(&self) -> Option<PolicyReport<'a>> {
        let running = self.running.as_ref()?;
        Some(report(running.slot, running.controller.policy()))
    }

    /// Returns the state of the node. `policy` is [`Self::report`], which takes
    /// its time: who calls this every tick keeps it.
    #[inline(never)]
    #[must_use]
    pub fn status(&self, policy: Option<PolicyReport<'a>>) -> NodeStatus<'a> {
        let mut run = RunStatus {
            activity: Activity::Waiting,
            last: None,
            pending: None,
            counts: self.counts,
            apexes: 0,
            rejected: RejectCounts::default(),
        };
        if let Some(running) = &self.running {
            run.pending = running.next;
            let counts = running.controller.counts();
            run.rejected.missing = counts.missing;
            run.rejected.stale = counts.stale;
            run.rejected.safe_entered = counts.safe_entered;
        }
        if let Some((_, command)) = &self.answered {
            run.activity = if command.is_safe() { Activity::Safe } else { Activity::Running };
            run.last = Some(RunTick { run_id: command.header.run_id, seq: command.header.seq });
            run.apexes = command.apexes;
            run.rejected.ticks = command.rejected;
        }
        NodeStatus { session: self.session, mode: self.mode, params: self.params, policy, run }
    }
}

/// Checks a set-point against the guard's limit.
///
/// # Errors
/// [`SetPointError`] when it is not finite or beyond the limit.
pub fn check_set_point(set_point_m_s: Option<f32>) -> Result<(), SetPointError> {
    let most_m_s = Limits::default().max_speed_m_s;
    // No range contains a NaN.
    if set_point_m_s.is_none_or(|v| (-most_m_s..=most_m_s).contains(&v)) {
        Ok(())
    } else {
        Err(SetPointError { most_m_s })
    }
}

/// Describes a policy.
#[must_use]
pub fn report<'a>(slot: Slot, policy: &Policy<'a>) -> PolicyReport<'a> {
    let manifest = policy.manifest();
    PolicyReport {
        slot,
        name: cut(manifest.name),
        crc32: policy.crc32(),
        leg: manifest.leg.fingerprint(),
    }
}

fn increment(count: &mut u32) {
    *count = count.saturating_add(1);
}

/// A change of a node that something else ticks.
#[derive(Clone, Copy, Debug)]
pub enum NodeChange<'p> {
    /// [`ControlNode::reset`].
    Reset(u32, SessionParams),
    /// [`ControlNode::set_mode`], unless that mode is already set.
    SetMode(Mode),
    /// [`ControlNode::set_point`].
    SetPoint(Option<f32>),
    /// [`ControlNode::run_policy`].
    RunPolicy(Slot, &'p Policy<'static>),
    /// [`ControlNode::count_repeated`].
    CountRepeated,
}

/// How a request handler reaches a node that something else ticks: a timer's
/// interrupt, or a real-time loop.
pub trait NodeHandle {
    /// Returns the state of the node.
    fn status(&self) -> NodeStatus<'static>;

    /// Changes the node, now or before its next tick.
    ///
    /// # Errors
    /// [`RequestError`] when the change is refused; nothing has changed then.
    fn change(&self, change: NodeChange<'_>) -> Result<(), RequestError>;

    /// Takes a sample from the line, as [`ControlNode::sample`] does.
    fn sample(&self, seq: u32, sample: &Sample) -> Option<Command>;
}

/// A node in memory that is shared under mutual exclusion: a priority ceiling on
/// a board, a lock in a test.
pub trait SharedNode {
    /// Calls `f` with exclusive access to the node. No tick can happen
    /// meanwhile, so `f` returns soon.
    fn with<R>(&self, f: impl FnOnce(&mut ControlNode<'static>) -> R) -> R;
}

impl<N: SharedNode> NodeHandle for N {
    #[inline(never)]
    fn status(&self) -> NodeStatus<'static> {
        self.with(|node| node.status(node.report()))
    }

    #[inline(never)]
    fn change(&self, change: NodeChange<'_>) -> Result<(), RequestError> {
        self.with(|node| match change {
            NodeChange::Reset(session, params) => Ok(node.reset(session, params)?),
            NodeChange::SetMode(mode) => {
                if node.mode != mode {
                    node.set_mode(mode);
                }
                Ok(())
            }
            NodeChange::SetPoint(set_point_m_s) => Ok(node.set_point(set_point_m_s)?),
            NodeChange::RunPolicy(slot, policy) => {
                node.run_policy(slot, policy);
                Ok(())
            }
            NodeChange::CountRepeated => {
                node.count_repeated();
                Ok(())
            }
        })
    }

    fn sample(&self, seq: u32, sample: &Sample) -> Option<Command> {
        self.with(|node| node.sample(seq, sample))
    }
}
