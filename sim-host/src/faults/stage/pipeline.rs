//! Stages in series, and the ticks in which they act.

use core::fmt::Debug;

use super::wire::WireMessage;
use leg_control::wire::{Command, Header, Sample};

/// The ticks in which a fault acts, counted from the start of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First tick of the window.
    pub from: u64,
    /// First tick after the window.
    pub until: u64,
}

impl Window {
    /// The whole run.
    pub const ALWAYS: Self = Self { from: 0, until: u64::MAX };

    /// Returns true if `tick` is in the window.
    #[must_use]
    pub fn contains(self, tick: u64) -> bool {
        self.from <= tick && tick < self.until
    }
}

/// The tick in which a stage is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Now {
    /// Number of the tick, from the start of the run.
    pub tick: u64,
    /// True if the fault may act. A message that it holds back from earlier ticks is released
    /// in any case.
    pub active: bool,
}

/// The output of a stage in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed<M> {
    /// The message that leaves the stage in this tick, if any.
    pub message: Option<M>,
    /// True if the fault acted on a message.
    pub touched: bool,
}

impl<M> Passed<M> {
    /// Creates the output of a fault that did not act.
    #[must_use]
    pub fn untouched(message: Option<M>) -> Self {
        Self { message, touched: false }
    }

    /// Creates the output of a fault that acted.
    #[must_use]
    pub fn touched(message: Option<M>) -> Self {
        Self { message, touched: true }
    }
}

/// One fault on one direction of a link. In each tick it receives at most one message and
/// releases at most one. Implementations must neither allocate nor block.
pub trait FaultStage<M>: Debug + Send {
    /// Processes the message of a tick, or its absence. Called once a tick, and again in the same
    /// tick only with another message.
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M>;
}

#[derive(Debug)]
struct Installed<M> {
    id: usize,
    window: Window,
    stage: Box<dyn FaultStage<M>>,
    touched: u64,
}

/// The faults of one direction, in the order in which they act.
#[derive(Debug)]
pub struct FaultPipeline<M>(Vec<Installed<M>>);

impl<M> Default for FaultPipeline<M> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<M> FaultPipeline<M> {
    /// Appends a fault; [`FaultPlan::count`] finds its count by `id`.
    pub fn push(&mut self, id: usize, window: Window, stage: Box<dyn FaultStage<M>>) {
        self.0.push(Installed { id, window, stage, touched: 0 });
    }

    /// Returns true if there is no fault.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Passes the message of a tick, or its absence, through all stages.
    pub fn pass(&mut self, tick: u64, message: Option<M>) -> Option<M> {
        self.0.iter_mut().fold(message, |message, installed| {
            let now = Now { tick, active: installed.window.contains(tick) };
            let passed = installed.stage.pass(now, message);
            installed.touched += u64::from(passed.touched);
            passed.message
        })
    }

    /// Returns how many messages the fault with this id has changed, dropped or held back.
    #[must_use]
    pub fn count(&self, id: usize) -> u64 {
        self.0
            .iter()
            .filter(|installed| installed.id == id)
            .map(|installed| installed.touched)
            .sum()
    }
}

/// The faults of both directions of a link.
#[derive(Debug, Default)]
pub struct FaultPlan {
    /// Faults of the messages that the leg sends.
    pub samples: FaultPipeline<Sample>,
    /// Faults of the messages that the controller sends.
    pub commands: FaultPipeline<Command>,
}

impl FaultPlan {
    /// Returns true if neither direction has a fault.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty() && self.commands.is_empty()
    }

    /// Returns how many messages the fault with this id has changed, dropped or held back.
    #[must_use]
    pub fn count(&self, id: usize) -> u64 {
        self.samples.count(id) + self.commands.count(id)
    }
}

/// Counts ticks since the first message, from the headers that one end sends. A new run, which
/// numbers its messages from 0 again, continues the count.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TickCounter {
    now: u64,
    last: Option<Header>,
}

impl TickCounter {
    pub(super) fn now(self) -> u64 {
        self.now
    }

    /// Counts a tick without a new message and returns true, unless `repeats`.
    pub(super) fn tick_unless(&mut self, repeats: bool) -> bool {
        self.now += u64::from(!repeats);
        !repeats
    }

    /// Counts a message, and returns true unless it has the header of the message before.
    pub(super) fn observe<M: WireMessage>(&mut self, message: &M) -> bool {
        let header = *message.header();
        if self.last == Some(header) {
            return false;
        }
        self.now += match self.last {
            Some(last) if last.run_id == header.run_id && last.seq < header.seq => {
                header.seq - last.seq
            }
            Some(_) => 1,
            None => 0,
        };
        self.last = Some(header);
        true
    }
}
