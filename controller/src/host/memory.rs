//! Links within a process.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::card::Role;
use super::link::{Link, LinkError};
use super::wait::Waiter;
use crate::wire::{Command, Sample};

/// The newest message one way, and whether its sender is still there.
#[derive(Debug)]
struct Slot<T> {
    message: Option<T>,
    sender_left: bool,
}

#[derive(Debug)]
struct Shared<T>(Mutex<Slot<T>>);

impl<T: Copy> Shared<T> {
    fn new() -> Arc<Self> {
        Arc::new(Self(Mutex::new(Slot { message: None, sender_left: false })))
    }

    fn with<R>(&self, f: impl FnOnce(&mut Slot<T>) -> R) -> R {
        // A slot is whole between any two statements: a panic elsewhere does not spoil it.
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// One end of a link between two threads.
#[derive(Debug)]
pub struct MemoryLink<Out: Copy, In: Copy> {
    outgoing: Arc<Shared<Out>>,
    incoming: Arc<Shared<In>>,
    peer: Role,
    waiter: Waiter,
}

/// A leg's end and a controller's end, for two threads.
#[must_use]
pub fn pair() -> (MemoryLink<Sample, Command>, MemoryLink<Command, Sample>) {
    let (samples, commands) = (Shared::new(), Shared::new());
    (
        MemoryLink {
            outgoing: Arc::clone(&samples),
            incoming: Arc::clone(&commands),
            peer: Role::Controller,
            waiter: Waiter::new(),
        },
        MemoryLink {
            outgoing: commands,
            incoming: samples,
            peer: Role::Leg,
            waiter: Waiter::new(),
        },
    )
}

impl<Out: Copy, In: Copy> Link for MemoryLink<Out, In> {
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        self.outgoing.with(|slot| slot.message = Some(*message));
        Ok(())
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        let poll = || {
            self.incoming.with(|slot| match slot.message.take() {
                None if slot.sender_left => {
                    Err(LinkError::PeerLeft { role: self.peer, pid: std::process::id() })
                }
                message => Ok(message),
            })
        };
        self.waiter.wait_for(timeout, poll, || Ok(()))
    }
}

impl<Out: Copy, In: Copy> Drop for MemoryLink<Out, In> {
    fn drop(&mut self) {
        self.outgoing.with(|slot| slot.sender_left = true);
    }
}

/// A leg's end whose controller is a function of the sample, called in place.
///
/// The fastest link, for runs within one thread.
#[derive(Debug)]
pub struct Inline<F> {
    law: F,
    reply: Option<Command>,
}

impl<F: FnMut(&Sample) -> Command> Inline<F> {
    /// A link to `law`.
    pub fn new(law: F) -> Self {
        Self { law, reply: None }
    }
}

impl<F: FnMut(&Sample) -> Command> Link for Inline<F> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        self.reply = Some((self.law)(sample));
        Ok(())
    }

    /// The reply to the last sample, at once; never waits.
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }
}
