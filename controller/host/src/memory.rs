//! Links within a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use triple_buffer::{Input, Output, triple_buffer};

use super::card::Role;
use super::link::{Link, LinkError};
use super::wait::Waiter;
use leg_control::wire::{Command, Sample};

/// One end of a link between two threads. Wait-free: neither end can hold up
/// the other, whatever their priorities.
#[derive(Debug)]
pub struct MemoryLink<Out: Copy + Send, In: Copy + Send> {
    outgoing: Input<Out>,
    incoming: Output<In>,
    /// This end is gone; the other one is.
    left: Arc<AtomicBool>,
    peer_left: Arc<AtomicBool>,
    peer: Role,
    waiter: Waiter,
}

/// A leg's end and a controller's end, for two threads.
#[must_use]
pub fn pair() -> (MemoryLink<Sample, Command>, MemoryLink<Command, Sample>) {
    let (samples, samples_out) = triple_buffer(&Sample::default());
    let (commands, commands_out) = triple_buffer(&Command::default());
    let (leg_left, controller_left) = (Arc::<AtomicBool>::default(), Arc::<AtomicBool>::default());
    (
        MemoryLink {
            outgoing: samples,
            incoming: commands_out,
            left: Arc::clone(&leg_left),
            peer_left: Arc::clone(&controller_left),
            peer: Role::Controller,
            waiter: Waiter::new(),
        },
        MemoryLink {
            outgoing: commands,
            incoming: samples_out,
            left: controller_left,
            peer_left: leg_left,
            peer: Role::Leg,
            waiter: Waiter::new(),
        },
    )
}

impl<Out: Copy + Send, In: Copy + Send> Link for MemoryLink<Out, In> {
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        self.outgoing.write(*message);
        Ok(())
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        let Self { incoming, peer_left, peer, waiter, .. } = self;
        let poll = || {
            // In this order: what it sent last still counts.
            let is_gone = peer_left.load(Ordering::Acquire);
            if incoming.update() {
                Ok(Some(*incoming.output_buffer()))
            } else if is_gone {
                Err(LinkError::PeerLeft { role: *peer, pid: std::process::id() })
            } else {
                Ok(None)
            }
        };
        waiter.wait_for(timeout, poll, || Ok(()))
    }
}

impl<Out: Copy + Send, In: Copy + Send> Drop for MemoryLink<Out, In> {
    fn drop(&mut self) {
        self.left.store(true, Ordering::Release);
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
