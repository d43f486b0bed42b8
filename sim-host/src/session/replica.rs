//! The estimate of a controller in another process.

use leg_control::config::Config;
use leg_control::estimator::Estimate;
use leg_control::policy::Policy;
use leg_control::wire_controller::WireController;

use super::leg::TickRecord;
use crate::replay::difference;

/// The control law of a controller in another process, run again in this one over the samples
/// that it received in lock-step.
///
/// Commands carry no estimate. But the same law returns the same bits for the same samples: as
/// long as the commands of both are equal, bit for bit, so are their estimates.
#[derive(Debug)]
pub struct ControllerReplica<'a> {
    controller: WireController<'a>,
    /// First tick whose commands differed.
    differs_at: Option<u64>,
}

impl<'a> ControllerReplica<'a> {
    /// Returns the replica of a controller that begins its run with this policy and configuration.
    #[must_use]
    pub fn new(policy: Policy<'a>, config: Config) -> Self {
        Self { controller: WireController::new(policy, config), differs_at: None }
    }

    /// Returns the estimate that the controller holds after the sample of a tick; none without an
    /// estimator, before its estimate begins, and from the tick of
    /// [`ControllerReplica::differs_at`] on.
    pub fn tick(&mut self, tick: &TickRecord<'_>) -> Option<Estimate> {
        if self.differs_at.is_some() {
            return None;
        }
        let command = self.controller.tick(Some(tick.sample));
        if difference(tick.command, &command).is_some() {
            self.differs_at = Some(tick.seq);
            return None;
        }
        self.controller.estimate()
    }

    /// Returns the first tick at which the controller sent another command than this law: one
    /// whose policy or set-point was changed in between.
    #[must_use]
    pub fn differs_at(&self) -> Option<u64> {
        self.differs_at
    }
}

#[cfg(test)]
mod tests {
    use leg_control::policy::SHIPPED;
    use leg_control::wire::Sample;
    use leg_process::policy_file::AlignedBytes;

    use super::*;
    use crate::scenario::{Scenario, Settings};
    use crate::sensors::SensorProfile;
    use crate::session::{Options, stepped};

    #[test]
    fn has_the_estimates_of_the_controller_until_their_commands_differ() {
        const CHANGED_AT: u64 = 3_000;
        let settings = Settings {
            sensors: Some(SensorProfile::Imu),
            duration_s: Some(5.0),
            ..Settings::shore()
        };
        let scenario = Scenario::from_settings(&settings).unwrap();
        let config = scenario.controller_config().unwrap();
        let blob: AlignedBytes = SHIPPED.into();
        let policy = Policy::parse(blob.as_slice()).unwrap();
        for changed_at in [None, Some(CHANGED_AT)] {
            let mut controller = WireController::new(policy.clone(), config);
            let mut replica = ControllerReplica::new(policy.clone(), config);
            let held = std::cell::Cell::new(None);
            let law = |sample: Option<&Sample>| {
                // Somebody else sets the set-point of the controller.
                let seq = sample.map_or(0, |sample| sample.header.seq);
                let set_point_m_s = changed_at.filter(|at| seq >= *at).map(|_| -1.0);
                let set_point_m_s = set_point_m_s.or(sample.map(|sample| sample.set_point_m_s));
                let command = controller.tick_at(sample, set_point_m_s);
                held.set(controller.estimate());
                command
            };
            let mut estimates = 0;
            stepped::run(&scenario, law, Options::default(), |tick| {
                let replicated = replica.tick(tick);
                if replica.differs_at().is_none() {
                    assert_eq!(replicated, held.take(), "tick {}", tick.seq);
                    estimates += u64::from(replicated.is_some());
                } else {
                    assert_eq!(replicated, None);
                }
            })
            .unwrap();
            assert!(estimates > 2_000, "{estimates}");
            // The next action is computed for the new set-point.
            let differs_at = replica.differs_at();
            assert_eq!(differs_at.is_some(), changed_at.is_some(), "{differs_at:?}");
            assert!(differs_at.is_none_or(|at| at >= CHANGED_AT), "{differs_at:?}");
        }
    }
}
