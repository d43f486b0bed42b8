//! A control law in this thread, stepped with the leg, with faults in between.

use std::time::Duration;

use super::chain::{Clock, Plan};
use leg_control::wire::{Command, Sample};
use leg_host::link::{Link, LinkError};

/// A leg's end whose controller is a function, called once for each tick of the
/// leg with what has come of its sample, or with `None`: so its guard sees
/// missing ticks, as it does in real time.
#[derive(Debug)]
pub struct Stepped<F> {
    law: F,
    plan: Plan,
    clock: Clock,
    reply: Option<Command>,
}

impl<F: FnMut(Option<&Sample>) -> Command> Stepped<F> {
    /// A link to `law` with these faults.
    pub fn new(law: F, plan: Plan) -> Self {
        Self { law, plan, clock: Clock::default(), reply: None }
    }

    /// The faults, with their counts.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
}

impl<F: FnMut(Option<&Sample>) -> Command> Link for Stepped<F> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        if sample.ends_the_run() {
            return Ok(());
        }
        self.clock.hear(sample);
        let now = self.clock.now();
        let sample = self.plan.samples.pass(now, Some(*sample));
        let command = (self.law)(sample.as_ref());
        self.reply = self.plan.commands.pass(now, Some(command));
        Ok(())
    }

    /// What has come of the answer, at once; never waits.
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }

    fn expects_no_reply(&self) -> bool {
        true
    }
}
