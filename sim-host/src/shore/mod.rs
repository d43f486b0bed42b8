//! The demonstration, which `sim-host` runs without a subcommand: the leg hops out
//! of the water, over the shore, onto land.

pub mod picture;
pub mod report;
pub mod track;

use crate::session::{Outcome, TickRecord};
use leg_plant::{Event, EventKind, Phase};
use report::{Regions, Report};
use track::{ApexMark, LegPose, Track};

/// Ticks between two points of the plotted path.
const PATH_STRIDE: u64 = 8;

/// Observes a run and keeps the data for the table and the picture.
#[derive(Clone, Debug, Default)]
pub struct TrackRecorder {
    track: Track,
    /// Apexes for which the controller's estimate has not arrived yet.
    awaiting_estimate: usize,
    last_apexes: u32,
}

impl TrackRecorder {
    /// Adds a tick. Returns the apex that the controller has just answered.
    pub fn observe(&mut self, tick: &TickRecord<'_>) -> Option<ApexMark> {
        let seen = self.take_estimate(tick);
        if tick.seq.is_multiple_of(PATH_STRIDE) {
            self.track.path.push((tick.body.x_m, tick.body.y_m));
        }
        let mut foot = match tick.phase {
            Phase::Stance { foot_x_m, foot_y_m } => (foot_x_m, foot_y_m),
            Phase::Flight | Phase::Fallen => (tick.body.x_m, 0.0),
        };
        for event in tick.events.iter() {
            self.mark(event, &mut foot, tick);
        }
        seen
    }

    /// Takes the density estimate; the controller answers an apex in the tick after it.
    fn take_estimate(&mut self, tick: &TickRecord<'_>) -> Option<ApexMark> {
        if tick.command.apexes == self.last_apexes {
            return None;
        }
        self.last_apexes = tick.command.apexes;
        if self.awaiting_estimate == 0 {
            // The start counts as an apex only for the controller.
            return None;
        }
        self.awaiting_estimate = 0;
        let apex = self.track.apexes.last_mut()?;
        apex.density_estimate = tick.command.density_ratio.into();
        Some(*apex)
    }

    fn mark(&mut self, event: &Event, foot: &mut track::Point, tick: &TickRecord<'_>) {
        let mass = (event.body.x_m, event.body.y_m);
        match event.kind {
            EventKind::Touchdown { foot_x_m, foot_y_m } => {
                *foot = (foot_x_m, foot_y_m);
                self.track.touchdowns.push(LegPose { foot: *foot, mass });
            }
            EventKind::LiftOff => self.track.liftoffs.push(LegPose { foot: *foot, mass }),
            EventKind::Apex => {
                self.awaiting_estimate += 1;
                self.track.apexes.push(ApexMark {
                    t_s: tick.t_s + event.t_s,
                    x_m: mass.0,
                    y_m: mass.1,
                    vx_m_s: event.body.vx_m_s,
                    set_point_m_s: tick.sample.set_point_m_s.into(),
                    density_ratio: tick.medium.density_ratio(),
                    density_estimate: tick.command.density_ratio.into(),
                });
            }
            EventKind::Fall => self.track.fall = Some(mass),
        }
    }

    /// Returns the track so far.
    #[must_use]
    pub fn track(&self) -> &Track {
        &self.track
    }

    /// Returns the report; `end_rho` is the density ratio where the run ended.
    #[must_use]
    pub fn report(&self, outcome: &Outcome, end_rho: f64) -> Report {
        let run = outcome.report();
        let regions = Regions::of(&self.track);
        let density_errors = self.track.apexes.iter().map(ApexMark::density_error);
        Report {
            falls: run.falls,
            hops: self.track.apexes.len(),
            distance_m: run.distance_m,
            end_rho,
            sim_time_s: run.sim_time_s,
            ticks: run.ticks,
            ticks_per_s: run.ticks_per_s,
            round_trip_us: run.round_trip_us,
            tracking: regions.tracking(),
            regions,
            rho_error_max: density_errors.fold(0.0, f64::max),
            state_hash: run.state_hash,
        }
    }
}
