//! The control law behind the messages of [`crate::wire`].

use crate::command::Status;
use crate::config::Config;
use crate::control::Controller;
#[cfg(feature = "estimator")]
use crate::estimator::{Acted, Estimate};
use crate::guard::{Counts, Reject};
use crate::policy::Policy;
use crate::wire::{Command, Header, Sample, WIRE_VERSION};

/// A [`Controller`] that takes [`Sample`]s and returns [`Command`]s.
///
/// It checks what belongs to the message and not to the measurement: wire version, run,
/// and sequence number. A sample of a later run begins a new run.
#[derive(Clone, Debug)]
pub struct WireController<'a> {
    controller: Controller<'a>,
    /// Header of the last sample, good or not: the next command carries it.
    header: Header,
    order: SequenceGuard,
}

impl<'a> WireController<'a> {
    /// Returns a controller at the start of its first run, in the safe state.
    #[must_use]
    pub fn new(policy: Policy<'a>, config: Config) -> Self {
        Self {
            controller: Controller::new(policy, config),
            header: Header::default(),
            order: SequenceGuard::default(),
        }
    }

    /// Forgets everything but the policy; see [`Controller::restart`].
    pub fn restart(&mut self, config: Config) {
        self.controller.restart(config);
        self.header = Header::default();
        self.order = SequenceGuard::default();
    }

    /// Switches to another policy at the next apex; see [`Controller::swap`].
    pub fn swap(&mut self, policy: Policy<'a>) {
        self.controller.swap(policy);
    }

    /// Returns whether a policy waits for the next apex.
    #[must_use]
    pub fn swap_is_pending(&self) -> bool {
        self.controller.swap_is_pending()
    }

    /// Returns the policy in force.
    #[must_use]
    pub fn policy(&self) -> &Policy<'a> {
        self.controller.policy()
    }

    /// Returns what was rejected since the start of the run.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.controller.counts()
    }

    /// Returns the estimate at the last sample; see [`Controller::estimate`].
    #[cfg(feature = "estimator")]
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        self.controller.estimate()
    }

    /// Takes what the leg does, before the sample of the next tick; see
    /// [`Controller::follow_acted`].
    #[cfg(feature = "estimator")]
    pub fn follow_acted(&mut self, t_ns: u64, acted: &Acted) {
        self.controller.follow_acted(t_ns, acted);
    }

    /// Runs one tick: takes the sample that came, or `None`; returns the command for it.
    ///
    /// The set-point is the sample's. The command carries the header of the last sample,
    /// also when that was rejected, and is always finite.
    pub fn tick(&mut self, sample: Option<&Sample>) -> Command {
        let set_point_m_s = sample.map(|sample| sample.set_point_m_s);
        self.tick_at(sample, set_point_m_s)
    }

    /// Runs one tick as [`Self::tick`] does, with a set-point, m/s, in place of the
    /// sample's; `None` holds the last one.
    pub fn tick_at(&mut self, sample: Option<&Sample>, set_point_m_s: Option<f32>) -> Command {
        if let Some(sample) = sample {
            self.header = sample.header;
        }
        let set_point_m_s = set_point_m_s.unwrap_or(self.controller.set_point_m_s());
        let status = self.step(sample, set_point_m_s);
        let controller = &self.controller;
        Command::new(
            &self.header,
            controller.command(),
            status,
            controller.telemetry(),
            controller.counts(),
        )
    }

    fn step(&mut self, sample: Option<&Sample>, set_point_m_s: f32) -> Status {
        // Written in its place, not moved there as part of an option.
        let mut measurement;
        let checked = match (sample, sample.and_then(Sample::contact)) {
            (None, _) => Err(Reject::Missing),
            (Some(sample), _) if sample.header.version != WIRE_VERSION => Err(Reject::Version),
            (Some(_), None) => Err(Reject::NoContactSense),
            (Some(sample), Some(contact)) => {
                measurement = sample.measurement_of_state(contact);
                sample.complete(&mut measurement);
                let in_range = self.controller.check(&measurement);
                in_range.and_then(|m| self.order.check(&sample.header).map(|()| m))
            }
        };
        let good = sample.filter(|_| checked.is_ok());
        if good.is_some_and(|sample| self.order.begins_run(&sample.header)) {
            self.controller.begin_run();
        }
        // Called once, so that an image has the law once.
        let (status, rejected) = self.controller.step_checked(checked, set_point_m_s);
        match good {
            Some(sample) if rejected.is_none() => self.order.accept(&sample.header),
            _ if status.is_safe() => self.order.forget(),
            _ => (),
        }
        status
    }
}

/// The order of the samples: runs and sequence numbers.
#[derive(Clone, Copy, Debug, Default)]
struct SequenceGuard {
    /// Run and sequence number of the last good sample; forgotten in the safe state, so
    /// that no single corrupt number can lock the true ones out.
    last: Option<(u32, u64)>,
    /// Run of the last good sample ever.
    run_id: Option<u32>,
}

impl SequenceGuard {
    fn check(&self, header: &Header) -> Result<(), Reject> {
        let Some((run_id, seq)) = self.last else { return Ok(()) };
        if header.run_id != run_id {
            // Run ids only rise; half the range counts as the past, so that they may wrap.
            let is_newer = header.run_id.wrapping_sub(run_id) < u32::MAX / 2;
            return if is_newer { Ok(()) } else { Err(Reject::OldRun) };
        }
        if header.seq == seq {
            return Err(Reject::Stale);
        }
        if header.seq < seq { Err(Reject::OutOfOrder) } else { Ok(()) }
    }

    fn begins_run(&self, header: &Header) -> bool {
        self.run_id.is_some_and(|run_id| run_id != header.run_id)
    }

    fn accept(&mut self, header: &Header) {
        self.last = Some((header.run_id, header.seq));
        self.run_id = Some(header.run_id);
    }

    fn forget(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests;
