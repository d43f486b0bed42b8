//! The demonstration, which `sim-host` runs without a subcommand: the leg hops out
//! of the water, over the shore, onto land.

pub mod estimates;
pub mod picture;
pub mod report;
pub mod track;

use leg_control::estimator::Estimate;
use leg_plant::{Event, EventKind, Phase};

use crate::sensors::SensorProfile;
use crate::session::{Outcome, TickRecord};
use estimates::EstimateTrace;
use report::{Regions, Report};
use track::{ApexMark, Decision, LegPose, Track};

/// Ticks between two points of the plotted path, and of the plotted velocity.
const PATH_STRIDE: u64 = 8;
const VELOCITY_STRIDE: u64 = 24;
/// An estimator may notice an apex so much too early, s.
const EARLY_S: f64 = 0.25;

/// Observes a run and keeps the data for the table and the picture.
#[derive(Clone, Debug, Default)]
pub struct TrackRecorder {
    track: Track,
    estimates: EstimateTrace,
    /// Whether the decision for the last apex has not been received yet.
    awaits_decision: bool,
    /// The last decision and its time, s, if it belongs to no apex so far.
    early: Option<(f64, Decision)>,
    last_apexes: u32,
}

impl TrackRecorder {
    /// Adds a tick with the estimate that the controller holds after its sample. Returns the
    /// apex for which both the event and the decision are known now.
    pub fn observe(
        &mut self,
        tick: &TickRecord<'_>,
        estimate: Option<Estimate>,
    ) -> Option<ApexMark> {
        self.estimates.observe(tick, estimate);
        let mut complete = self.take_decision(tick);
        if tick.seq.is_multiple_of(PATH_STRIDE) {
            self.track.path.push((tick.body.x_m, tick.body.y_m));
        }
        if tick.seq.is_multiple_of(VELOCITY_STRIDE) {
            self.track.velocity.push((tick.body.x_m, tick.body.vx_m_s));
        }
        let mut foot = match tick.phase {
            Phase::Stance { foot_x_m, foot_y_m } => (foot_x_m, foot_y_m),
            Phase::Flight | Phase::Fallen => (tick.body.x_m, 0.0),
        };
        for event in tick.events.iter() {
            complete = self.mark(event, &mut foot, tick).or(complete);
        }
        complete
    }

    /// Takes the decision of the tick, if it has one. By exact readings the controller decides in
    /// the tick after the apex, by an estimate a little earlier or later.
    fn take_decision(&mut self, tick: &TickRecord<'_>) -> Option<ApexMark> {
        if tick.command.apexes == self.last_apexes {
            return None;
        }
        self.last_apexes = tick.command.apexes;
        let decision = Decision {
            vx_m_s: tick.command.apex_vx_m_s.into(),
            y_m: tick.command.apex_y_m.into(),
            density_ratio: tick.command.density_ratio.into(),
        };
        if !std::mem::take(&mut self.awaits_decision) {
            // The start, which counts as an apex only for the controller, or the next apex.
            self.early = Some((tick.t_s, decision));
            return None;
        }
        let apex = self.track.apexes.last_mut()?;
        apex.decision = Some(decision);
        Some(*apex)
    }

    fn mark(
        &mut self,
        event: &Event,
        foot: &mut track::Point,
        tick: &TickRecord<'_>,
    ) -> Option<ApexMark> {
        let mass = (event.body.x_m, event.body.y_m);
        match event.kind {
            EventKind::Touchdown { foot_x_m, foot_y_m } => {
                *foot = (foot_x_m, foot_y_m);
                self.track.touchdowns.push(LegPose { foot: *foot, mass });
            }
            EventKind::LiftOff => self.track.liftoffs.push(LegPose { foot: *foot, mass }),
            EventKind::Apex => {
                let t_s = tick.t_s + event.t_s;
                let early = self.early.take().filter(|(early_s, _)| t_s - early_s < EARLY_S);
                let apex = ApexMark {
                    t_s,
                    x_m: mass.0,
                    y_m: mass.1,
                    vx_m_s: event.body.vx_m_s,
                    set_point_m_s: tick.sample.set_point_m_s.into(),
                    density_ratio: tick.medium.density_ratio(),
                    decision: early.map(|(_, decision)| decision),
                };
                self.awaits_decision = apex.decision.is_none();
                self.track.apexes.push(apex);
                return apex.decision.map(|_| apex);
            }
            EventKind::Fall => self.track.fall = Some(mass),
        }
        None
    }

    /// Returns the track so far.
    #[must_use]
    pub fn track(&self) -> &Track {
        &self.track
    }

    /// Returns the estimates so far.
    #[must_use]
    pub fn estimates(&self) -> &EstimateTrace {
        &self.estimates
    }

    /// Returns the report of a run with these sensors; `end_rho` is the density ratio where it
    /// ended.
    #[must_use]
    pub fn report(&self, outcome: &Outcome, sensors: SensorProfile, end_rho: f64) -> Report {
        let run = outcome.report();
        let regions = Regions::of(&self.track);
        let Regions { water, shore, land } = &regions;
        Report {
            sensors,
            falls: run.falls,
            hops: self.track.apexes.len(),
            distance_m: run.distance_m,
            end_rho,
            sim_time_s: run.sim_time_s,
            ticks: run.ticks,
            ticks_per_s: run.ticks_per_s,
            round_trip_us: run.round_trip_us,
            tracking: regions.tracking(),
            rho_error_max: [water, shore, land]
                .map(|r| r.rho_error_max)
                .into_iter()
                .fold(0.0, f64::max),
            regions,
            estimates: self.estimates.summary(),
            state_hash: run.state_hash,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use leg_control::policy::{Policy, SHIPPED};
    use leg_control::wire::Sample;
    use leg_control::wire_controller::WireController;
    use leg_process::policy_file::AlignedBytes;

    use super::*;
    use crate::scenario::{Scenario, Settings};
    use crate::session::{Options, stepped};

    /// By an estimate the controller decides before or after the apex, by readings after it.
    #[test]
    fn each_apex_has_its_own_decision() {
        let blob: AlignedBytes = SHIPPED.into();
        for sensors in [SensorProfile::Ideal, SensorProfile::TrainedWith, SensorProfile::Imu] {
            let settings = Settings { sensors: Some(sensors), ..Settings::shore() };
            let scenario = Scenario::from_settings(&settings).unwrap();
            let config = scenario.controller_config().unwrap();
            let policy = Policy::parse(blob.as_slice()).unwrap();
            let mut controller = WireController::new(policy, config);
            let estimate = Cell::new(None);
            let law = |sample: Option<&Sample>| {
                let command = controller.tick(sample);
                estimate.set(controller.estimate());
                command
            };
            let mut recorder = TrackRecorder::default();
            let mut complete = 0;
            let outcome = stepped::run(&scenario, law, Options::default(), |tick| {
                complete += usize::from(recorder.observe(tick, estimate.take()).is_some());
            });
            let apexes = &recorder.track().apexes;
            assert_eq!(outcome.unwrap().apexes, apexes.len() as u64);
            let decided: Vec<[f64; 3]> =
                apexes.iter().filter_map(ApexMark::estimate_errors).collect();
            assert_eq!(decided.len(), complete);
            // That of the last apex may come after the end.
            assert!(
                decided.len() + 1 >= apexes.len(),
                "{sensors:?}: {} of {}",
                decided.len(),
                apexes.len()
            );
            for [vx_m_s, y_m, density_ratio] in decided {
                let errors = [vx_m_s, y_m, density_ratio].map(f64::abs);
                assert!(errors.iter().all(|error| *error < 0.06), "{sensors:?}: {errors:?}");
            }
            let has_estimates = !recorder.estimates().points().is_empty();
            assert_eq!(has_estimates, sensors != SensorProfile::Ideal);
        }
    }
}
