//! Links within a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use leg_control::wire::{Command, Sample};
use triple_buffer::{Input, Output, triple_buffer};

use crate::link::{Link, LinkError, Role, Waiter};

/// One end of a link between two threads.
///
/// Both directions are wait-free triple buffers, so neither end can block the
/// other, whatever their priorities.
#[derive(Debug)]
pub struct MemoryLink<Out: Copy + Send, In: Copy + Send> {
    outgoing: Input<Out>,
    incoming: Output<In>,
    /// Set when this end is dropped.
    left: Arc<AtomicBool>,
    /// Set when the other end is dropped.
    peer_left: Arc<AtomicBool>,
    peer: Role,
    waiter: Waiter,
}

/// Returns the two ends of a link between two threads: the leg's and the
/// controller's.
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
            // Read the flag before the buffer: the last message sent before leaving counts.
            let is_gone = peer_left.load(Ordering::Acquire);
            if incoming.update() {
                Ok(Some(*incoming.output_buffer()))
            } else if is_gone {
                Err(LinkError::PeerLeft { role: *peer, pid: std::process::id() })
            } else {
                Ok(None)
            }
        };
        waiter.wait_for(timeout, None, poll, || Ok(()))
    }
}

impl<Out: Copy + Send, In: Copy + Send> Drop for MemoryLink<Out, In> {
    fn drop(&mut self) {
        self.left.store(true, Ordering::Release);
    }
}

/// The leg's end of a link whose controller is a function of the sample, called by
/// [`Link::send`]. It is the fastest link, for runs within one thread.
#[derive(Debug)]
pub struct Inline<F> {
    controller: F,
    reply: Option<Command>,
}

impl<F: FnMut(&Sample) -> Command> Inline<F> {
    /// Creates a link to the function `controller`.
    pub fn new(controller: F) -> Self {
        Self { controller, reply: None }
    }
}

impl<F: FnMut(&Sample) -> Command> Link for Inline<F> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        self.reply = Some((self.controller)(sample));
        Ok(())
    }

    /// Returns the reply to the last sample, without waiting.
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }
}
