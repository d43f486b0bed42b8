//! A link that things happen on.

use std::time::{Duration, Instant};

use super::chain::{Chain, Clock, Plan};
use super::wire::WireMessage;
use leg_control::wire::flags;
use leg_host::link::{ControllerLink, LegLink, Link, LinkError};

/// A link with faults in both directions, at either end and over any transport.
///
/// Its ticks are those of the messages that this end sends: one is sent, then
/// received, in each. The message that ends a run always gets through.
///
/// In lock-step ([`Faulty::in_lock_step`]; at the leg's end) an answer is waited
/// for exactly when something was sent, so what happens does not depend on any
/// clock; [`Link::expects_no_reply`] tells the session when a tick has brought all that
/// it will. Else what has come is taken as it is, once a tick.
#[derive(Debug)]
pub struct Faulty<L: Link> {
    link: L,
    outgoing: Chain<L::Sends>,
    incoming: Chain<L::Receives>,
    lock_step: bool,
    clock: Clock,
    /// What really was sent in this tick.
    sent: Option<L::Sends>,
    /// Tick in which the incoming chain was last asked.
    asked: Option<u64>,
    settled: bool,
}

impl<L: LegLink> Faulty<L> {
    /// Around the leg's end of a link.
    #[must_use]
    pub fn at_leg(link: L, plan: Plan) -> Self {
        Self::around(link, plan.samples, plan.commands)
    }

    /// The link without the faults, and those with their counts.
    #[must_use]
    pub fn into_parts(self) -> (L, Plan) {
        (self.link, Plan { samples: self.outgoing, commands: self.incoming })
    }
}

impl<L: ControllerLink> Faulty<L> {
    /// Around the controller's end of a link.
    #[must_use]
    pub fn at_controller(link: L, plan: Plan) -> Self {
        Self::around(link, plan.commands, plan.samples)
    }
}

impl<L: Link> Faulty<L> {
    fn around(link: L, outgoing: Chain<L::Sends>, incoming: Chain<L::Receives>) -> Self {
        Self {
            link,
            outgoing,
            incoming,
            lock_step: false,
            clock: Clock::default(),
            sent: None,
            asked: None,
            settled: false,
        }
    }

    /// For a session in lock-step, at the leg's end.
    #[must_use]
    pub fn in_lock_step(mut self) -> Self {
        self.lock_step = true;
        self
    }
}

impl<L: Link<Sends: WireMessage, Receives: WireMessage>> Faulty<L> {
    /// The answer to what was sent in this tick, whatever it says; `None` when
    /// it has not come in time.
    fn answer(
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
            // To a tick before, asked twice.
            let since: Instant = *since.get_or_insert_with(Instant::now);
            left = timeout.saturating_sub(since.elapsed());
        }
    }
}

impl<L: Link<Sends: WireMessage, Receives: WireMessage>> Link for Faulty<L> {
    type Sends = L::Sends;
    type Receives = L::Receives;

    fn send(&mut self, message: &L::Sends) -> Result<(), LinkError> {
        if message.header().flags == flags::END {
            return self.link.send(message);
        }
        // In lock-step the same one again, as after the peer was lost, meets no other
        // fate; in real time to say it again is another try.
        if self.clock.hear(message) || self.clock.tick_unless(self.lock_step) {
            self.sent = self.outgoing.pass(self.clock.now(), Some(*message));
        }
        self.settled = false;
        self.sent.as_ref().map_or(Ok(()), |sent| self.link.send(sent))
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<L::Receives>, LinkError> {
        let now = self.clock.now();
        let came = if self.lock_step {
            if self.settled {
                return Ok(None);
            }
            let came = match self.sent {
                None => None,
                Some(sent) => match self.answer(&sent, timeout)? {
                    None => return Ok(None),
                    answer => answer,
                },
            };
            self.settled = true;
            came
        } else {
            let came = self.link.receive(timeout)?;
            if came.is_none() && self.asked == Some(now) {
                return Ok(None);
            }
            came
        };
        self.asked = Some(now);
        Ok(self.incoming.pass(now, came))
    }

    fn expects_no_reply(&self) -> bool {
        self.settled
    }
}
