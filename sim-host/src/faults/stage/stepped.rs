//! A control law that runs in the thread of the leg, behind faults.

use std::time::Duration;

use super::pipeline::{FaultPlan, TickCounter};
use leg_control::wire::{Command, Sample};
use leg_host::link::{Link, LinkError};

/// A leg's end of a link whose controller is a function. It is called once a tick with the sample
/// that the faults let through, or with `None`, so its guard sees missing ticks as in real time.
#[derive(Debug)]
pub struct SteppedLink<F> {
    law: F,
    plan: FaultPlan,
    clock: TickCounter,
    reply: Option<Command>,
}

impl<F: FnMut(Option<&Sample>) -> Command> SteppedLink<F> {
    /// Creates a link to `law` with these faults.
    pub fn new(law: F, plan: FaultPlan) -> Self {
        Self { law, plan, clock: TickCounter::default(), reply: None }
    }

    /// Returns the faults with their counts.
    pub fn plan(&self) -> &FaultPlan {
        &self.plan
    }
}

impl<F: FnMut(Option<&Sample>) -> Command> Link for SteppedLink<F> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        if sample.ends_the_run() {
            return Ok(());
        }
        self.clock.observe(sample);
        let now = self.clock.now();
        let sample = self.plan.samples.pass(now, Some(*sample));
        let command = (self.law)(sample.as_ref());
        self.reply = self.plan.commands.pass(now, Some(command));
        Ok(())
    }

    /// Returns the command that the faults let through. Never waits.
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }

    fn expects_no_reply(&self) -> bool {
        true
    }
}
