//! Stages in a row, and when they act.

use core::fmt::Debug;

use super::wire::WireMessage;
use leg_control::wire::{Command, Header, Sample};

/// Ticks since the run's start in which a fault acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The first.
    pub from: u64,
    /// The first after it.
    pub until: u64,
}

impl Window {
    /// The whole run.
    pub const ALWAYS: Self = Self { from: 0, until: u64::MAX };

    /// Whether a tick is in it.
    #[must_use]
    pub fn contains(self, tick: u64) -> bool {
        self.from <= tick && tick < self.until
    }
}

/// The tick at which a stage is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Now {
    /// Its number, from the run's start.
    pub tick: u64,
    /// Whether the fault is to act. What it holds back from before comes out also
    /// when not.
    pub active: bool,
}

/// What a stage hands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed<M> {
    /// The message, if there is one at this tick.
    pub message: Option<M>,
    /// Whether the fault has done something.
    pub touched: bool,
}

impl<M> Passed<M> {
    /// As it would have been without the fault.
    #[must_use]
    pub fn untouched(message: Option<M>) -> Self {
        Self { message, touched: false }
    }

    /// Otherwise.
    #[must_use]
    pub fn touched(message: Option<M>) -> Self {
        Self { message, touched: true }
    }
}

/// One fault on one direction: what comes of the message of each tick, or of
/// there being none. Neither allocates nor waits.
pub trait Stage<M>: Debug + Send {
    /// Called once a tick; again in the same tick only with another message.
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M>;
}

#[derive(Debug)]
struct Armed<M> {
    tag: usize,
    window: Window,
    stage: Box<dyn Stage<M>>,
    touched: u64,
}

/// The faults of one direction, in their order.
#[derive(Debug)]
pub struct Chain<M>(Vec<Armed<M>>);

impl<M> Default for Chain<M> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<M> Chain<M> {
    /// Adds a fault behind the others; `tag` is what its count goes by.
    pub fn push(&mut self, tag: usize, window: Window, stage: Box<dyn Stage<M>>) {
        self.0.push(Armed { tag, window, stage, touched: 0 });
    }

    /// Whether messages pass as they are.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What comes of a tick's message.
    pub fn pass(&mut self, tick: u64, message: Option<M>) -> Option<M> {
        self.0.iter_mut().fold(message, |message, armed| {
            let now = Now { tick, active: armed.window.contains(tick) };
            let passed = armed.stage.pass(now, message);
            armed.touched += u64::from(passed.touched);
            passed.message
        })
    }

    fn count(&self, tag: usize) -> u64 {
        self.0.iter().filter(|armed| armed.tag == tag).map(|armed| armed.touched).sum()
    }
}

/// The faults of a link.
#[derive(Debug, Default)]
pub struct Plan {
    /// Those of what the leg sends.
    pub samples: Chain<Sample>,
    /// Those of what the controller sends.
    pub commands: Chain<Command>,
}

impl Plan {
    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty() && self.commands.is_empty()
    }

    /// How often the fault of this tag has done something: messages touched,
    /// lost or held back.
    #[must_use]
    pub fn count(&self, tag: usize) -> u64 {
        self.samples.count(tag) + self.commands.count(tag)
    }
}

/// Ticks since the first message, by what one end sends: a new run that counts
/// from 0 again, as after a restart of the leg, is a later tick.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clock {
    now: u64,
    last: Option<Header>,
}

impl Clock {
    pub(super) fn now(self) -> u64 {
        self.now
    }

    /// Goes on by a tick without a new message, unless `stands`; whether it does.
    pub(super) fn tick_unless(&mut self, stands: bool) -> bool {
        self.now += u64::from(!stands);
        !stands
    }

    /// Takes in a message's header; whether it is another than the last.
    pub(super) fn hear<M: WireMessage>(&mut self, message: &M) -> bool {
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
