//! A link with faults.

use std::time::{Duration, Instant};

use super::pipeline::{FaultPipeline, FaultPlan, TickCounter};
use super::wire::WireMessage;
use leg_control::wire::flags;
use leg_host::link::{ControllerLink, LegLink, Link, LinkError};

/// A link with faults in both directions, at either end and over any transport.
///
/// Its ticks are those of the messages that this end sends; each tick sends one message and then
/// receives. The message that ends a run is never affected.
///
/// In lock-step ([`FaultyLink::in_lock_step`], at the leg's end) the link waits for a reply exactly
/// when a message was sent, so the result does not depend on timing, and
/// [`Link::expects_no_reply`] returns true once a tick is complete. Otherwise the link takes the
/// messages as they arrive, once a tick.
#[derive(Debug)]
pub struct FaultyLink<L: Link> {
    link: L,
    outgoing: FaultPipeline<L::Sends>,
    incoming: FaultPipeline<L::Receives>,
    lock_step: bool,
    clock: TickCounter,
    /// The message sent in this tick, after the faults.
    sent: Option<L::Sends>,
    /// Tick in which the incoming pipeline was last called.
    called: Option<u64>,
    settled: bool,
}

impl<L: LegLink> FaultyLink<L> {
    /// Wraps the leg's end of a link.
    #[must_use]
    pub fn at_leg(link: L, plan: FaultPlan) -> Self {
        Self::around(link, plan.samples, plan.commands)
    }

    /// Returns the link without the faults, and the faults with their counts.
    #[must_use]
    pub fn into_parts(self) -> (L, FaultPlan) {
        (self.link, FaultPlan { samples: self.outgoing, commands: self.incoming })
    }
}

impl<L: ControllerLink> FaultyLink<L> {
    /// Wraps the controller's end of a link.
    #[must_use]
    pub fn at_controller(link: L, plan: FaultPlan) -> Self {
        Self::around(link, plan.commands, plan.samples)
    }
}

impl<L: Link> FaultyLink<L> {
    fn around(
        link: L,
        outgoing: FaultPipeline<L::Sends>,
        incoming: FaultPipeline<L::Receives>,
    ) -> Self {
        Self {
            link,
            outgoing,
            incoming,
            lock_step: false,
            clock: TickCounter::default(),
            sent: None,
            called: None,
            settled: false,
        }
    }

    /// Switches to lock-step, for a session at the leg's end.
    #[must_use]
    pub fn in_lock_step(mut self) -> Self {
        self.lock_step = true;
        self
    }
}

impl<L: Link<Sends: WireMessage, Receives: WireMessage>> FaultyLink<L> {
    /// Receives the reply to the message sent in this tick; `None` if it does not arrive in time.
    fn reply(
        &mut self,
        sent: &L::Sends,
        timeout: Duration,
    ) -> Result<Option<L::Receives>, LinkError> {
        let (mut left, mut since) = (timeout, None);
        loop {
            let Some(message) = self.link.receive(left)? else { return Ok(None) };
            let (ours, theirs) = (sent.header(), message.header());
            if (ours.run_id, ours.seq) == (theirs.run_id, theirs.seq) {
                return Ok(Some(message));
            }
            // A reply to an earlier tick whose message was sent twice.
            let since: Instant = *since.get_or_insert_with(Instant::now);
            left = timeout.saturating_sub(since.elapsed());
        }
    }
}

impl<L: Link<Sends: WireMessage, Receives: WireMessage>> Link for FaultyLink<L> {
    type Sends = L::Sends;
    type Receives = L::Receives;

    fn send(&mut self, message: &L::Sends) -> Result<(), LinkError> {
        if message.header().flags == flags::END {
            return self.link.send(message);
        }
        // In lock-step a message that is sent again, as after the loss of the peer, has the same
        // result as before. In real time it is another attempt.
        if self.clock.observe(message) || self.clock.tick_unless(self.lock_step) {
            self.sent = self.outgoing.pass(self.clock.now(), Some(*message));
        }
        self.settled = false;
        self.sent.as_ref().map_or(Ok(()), |sent| self.link.send(sent))
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<L::Receives>, LinkError> {
        let now = self.clock.now();
        let received = if self.lock_step {
            if self.settled {
                return Ok(None);
            }
            let received = match self.sent {
                None => None,
                Some(sent) => match self.reply(&sent, timeout)? {
                    None => return Ok(None),
                    reply => reply,
                },
            };
            self.settled = true;
            received
        } else {
            let received = self.link.receive(timeout)?;
            if received.is_none() && self.called == Some(now) {
                return Ok(None);
            }
            received
        };
        self.called = Some(now);
        Ok(self.incoming.pass(now, received))
    }

    fn expects_no_reply(&self) -> bool {
        self.settled
    }
}
