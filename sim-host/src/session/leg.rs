//! The leg in a session: plant, sensors, the command in force, and counts. It
//! has no clock and no link; a session passes it commands and steps it.

use std::time::Duration;

use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};

use super::command_hold::CommandHold;
use super::hash::StateHash;
use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::stage::FaultPipeline;
use crate::faults::{Terrain, WorldCounts};
use crate::scenario::{DensitySense, Scenario, SetPointCursor};
use crate::sensors::{SensorModels, Truth};
use leg_plant::{Body, EventKind, Flat, Ground, Medium, Phase, TickEvents, TickPlant};

/// One tick of a run, as observers see it.
#[derive(Debug)]
pub struct TickRecord<'a> {
    /// Number of the tick in its run.
    pub seq: u64,
    /// Time at its start, s.
    pub t_s: f64,
    /// Length of the tick, s.
    pub dt_s: f64,
    /// The true state at its start, which the sensors read.
    pub body: Body,
    /// The phase of the gait at its start.
    pub phase: Phase,
    /// The medium during the tick.
    pub medium: Medium,
    /// The sample sent to the controller.
    pub sample: &'a Sample,
    /// The command in force during the tick: the answer to its sample or, if that
    /// is late, an earlier one or the leg's own safe command.
    pub command: &'a Command,
    /// Whether the command arrived for this tick.
    pub is_new: bool,
    /// The events in the tick; their times count from its start.
    pub events: &'a TickEvents,
    /// The true state at its end.
    pub after: Body,
    /// From sending the sample to receiving the command; 0 where it is not
    /// measured.
    pub round_trip: Duration,
}

/// Angle of the safe command: upright.
const SAFE_ANGLE_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// A leg that plays a scenario.
#[derive(Debug)]
pub struct Leg<'a> {
    scenario: &'a Scenario,
    run_id: u32,
    set_points: SetPointCursor<'a>,
    /// Set-point that replaces the scenario's.
    override_m_s: Option<f64>,
    plant: TickPlant,
    medium: Medium,
    terrain: Option<Terrain>,
    changes_medium: bool,
    world: WorldCounts,
    hold: CommandHold,
    sensors: SensorModels,
    sensor_faults: FaultPipeline<Sample>,
    /// Angle of the last command, which the leg holds in flight.
    held_angle_rad: f64,
    seq: u64,
    /// Ticks of the runs before the last restart.
    earlier_ticks: u64,
    restarts: u32,
    sample: Sample,
    touchdowns: u64,
    apexes: u64,
    safe_ticks: u64,
    rejected: u32,
    hash: StateHash,
}

impl<'a> Leg<'a> {
    /// Creates a leg at its scenario's start. Every sample carries `run_id`, and
    /// only commands with it are accepted.
    #[must_use]
    pub fn new(scenario: &'a Scenario, run_id: u32) -> Self {
        let mut leg = Self {
            scenario,
            run_id,
            set_points: scenario.set_points.begin(scenario.start.x_m),
            override_m_s: None,
            plant: scenario.plant(),
            medium: scenario.medium_at(scenario.start.x_m),
            terrain: scenario.faults.terrain(),
            changes_medium: scenario.faults.changes_medium(),
            world: WorldCounts::default(),
            hold: CommandHold::new(
                1_000_000_000 / u64::from(scenario.rate_hz),
                scenario.stale_limit_ns,
            ),
            sensors: SensorModels::new(&scenario.sensors, scenario.rate_hz, scenario.seed),
            sensor_faults: scenario.faults.of_sensors(),
            held_angle_rad: SAFE_ANGLE_RAD,
            seq: 0,
            earlier_ticks: 0,
            restarts: 0,
            sample: Sample::default(),
            touchdowns: 0,
            apexes: 0,
            safe_ticks: 0,
            rejected: 0,
            hash: StateHash::default(),
        };
        leg.update_medium();
        leg.sense([0.0; 2]);
        leg
    }

    /// Returns the number of the next tick.
    #[must_use]
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// Returns the simulated time at the start of the next tick, s.
    #[must_use]
    pub fn t_s(&self) -> f64 {
        self.seq as f64 / f64::from(self.scenario.rate_hz)
    }

    /// Returns the true state at the start of the next tick.
    #[must_use]
    pub fn body(&self) -> Body {
        self.plant.body()
    }

    /// Returns the sensor readings at the start of the next tick, with the faults of sensors.
    #[must_use]
    pub fn sample(&self) -> &Sample {
        &self.sample
    }

    /// Returns the sample that announces the end of the run to the controller.
    #[must_use]
    pub fn end_sample(&self) -> Sample {
        Sample { header: self.header(flags::END), ..Sample::default() }
    }

    /// Returns why the run is over, or `None` while it is not.
    #[must_use]
    pub fn ending(&self) -> Option<Ending> {
        let way_m = (self.plant.body().x_m - self.scenario.start.x_m).abs();
        if self.plant.phase() == Phase::Fallen {
            Some(Ending::Fall)
        } else if self.scenario.distance_m.is_some_and(|distance_m| way_m >= distance_m) {
            Some(Ending::Distance)
        } else if self.ticks() >= self.scenario.ticks() {
            Some(Ending::Duration)
        } else {
            None
        }
    }

    /// Returns the ticks played, including those before a restart.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.earlier_ticks + self.seq
    }

    /// Puts the leg back to its scenario's start, as the run `run_id`. Time and
    /// counts continue.
    pub fn restart(&mut self, run_id: u32) {
        self.run_id = run_id;
        self.restarts += 1;
        self.earlier_ticks = self.ticks();
        self.seq = 0;
        let start = self.scenario.start;
        self.set_points = self.scenario.set_points.begin(start.x_m);
        self.plant = self.scenario.plant();
        self.update_medium();
        self.hold.reset();
        self.held_angle_rad = SAFE_ANGLE_RAD;
        self.sensors.clear();
        self.sense([0.0; 2]);
    }

    /// Replaces the scenario's set-point from now on, m/s; `None` returns to the
    /// scenario's.
    pub fn override_set_point(&mut self, set_point_m_s: Option<f64>) {
        self.override_m_s = set_point_m_s;
        self.update_set_point();
    }

    /// Returns whether a command answers the current sample.
    #[must_use]
    pub fn is_answered_by(&self, command: &Command) -> bool {
        let Header { version, run_id, seq, .. } = command.header;
        (version, run_id, seq) == (WIRE_VERSION, self.run_id, self.seq)
    }

    /// Counts a command that the session rejected.
    pub fn count_refused(&mut self, _command: &Command) {
        self.hold.refused += 1;
    }

    /// Plays one tick under `fresh`, if that is a valid command, or else under the
    /// command in force.
    pub fn step(
        &mut self,
        fresh: Option<Command>,
        round_trip: Duration,
        observe: &mut impl FnMut(&TickRecord),
    ) {
        let (seq, t_s, dt_s) = (self.seq, self.t_s(), self.scenario.tick_s());
        let (body, phase, medium) = (self.plant.body(), self.plant.phase(), self.medium);
        let now = self.header(0);
        let is_new = self.hold.update(&now, fresh);
        let command = self.hold.in_force(&now);
        let plant_command = self.hold.plant_command(&now);

        let events = match &self.terrain {
            None => self.plant.step(dt_s, plant_command, medium, &Flat),
            Some(terrain) => self.plant.step(dt_s, plant_command, medium, terrain),
        };
        let after = self.plant.body();
        self.hash.body(&body);
        self.hash.command(&command);
        self.safe_ticks += u64::from(command.is_safe());
        if is_new {
            self.rejected = command.rejected;
        }
        for event in events.iter() {
            match event.kind {
                EventKind::Touchdown { foot_y_m, .. } => {
                    self.touchdowns += 1;
                    self.world.uneven_touchdowns += u64::from(foot_y_m != 0.0);
                }
                EventKind::Apex => self.apexes += 1,
                EventKind::LiftOff | EventKind::Fall => (),
            }
        }
        let (sample, command, events) = (&self.sample, &command, &events);
        observe(&TickRecord {
            seq,
            t_s,
            dt_s,
            body,
            phase,
            medium,
            sample,
            command,
            is_new,
            events,
            after,
            round_trip,
        });
        self.seq += 1;
        self.world.ticks += 1;
        self.held_angle_rad = plant_command.leg_angle_rad;
        self.update_medium();
        let fallen_m_s = -self.scenario.played_gravity_m_s2() * dt_s;
        self.sense([after.vx_m_s - body.vx_m_s, after.vy_m_s - body.vy_m_s - fallen_m_s]);
    }

    /// Returns the result of the run.
    #[must_use]
    pub fn outcome(mut self, ending: Ending, wall_time_s: f64, round_trips: RoundTrips) -> Outcome {
        let body = self.plant.body();
        self.hash.body(&body);
        Outcome {
            ending,
            restarts: self.restarts,
            ticks: self.ticks(),
            sim_time_s: self.ticks() as f64 / f64::from(self.scenario.rate_hz),
            wall_time_s,
            distance_m: body.x_m - self.scenario.start.x_m,
            body,
            touchdowns: self.touchdowns,
            apexes: self.apexes,
            safe_ticks: self.safe_ticks,
            held_ticks: self.hold.held_ticks,
            silences: self.hold.silences,
            rejected: self.rejected,
            foreign_commands: self.hold.refused,
            state_hash: self.hash.value(),
            faults: self.scenario.faults.counts(&self.world, &self.sensor_faults),
            round_trips,
        }
    }

    fn header(&self, flags: u16) -> Header {
        Header {
            version: WIRE_VERSION,
            flags,
            run_id: self.run_id,
            seq: self.seq,
            t_ns: self.seq * 1_000_000_000 / u64::from(self.scenario.rate_hz),
        }
    }

    /// Sets the medium for the next tick.
    fn update_medium(&mut self) {
        let x_m = self.plant.body().x_m;
        self.medium = self.scenario.medium_at(x_m);
        let since_s = self.ticks() as f64 / f64::from(self.scenario.rate_hz);
        if self.changes_medium
            && let Some((id, density_ratio)) = self.scenario.faults.density(since_s, x_m)
        {
            self.medium = self.scenario.medium_of(density_ratio);
            self.world.count_medium(id);
        }
    }

    /// Reads the sensors, once for each tick; the velocity changed by `impulse_m_s` more than
    /// by gravity in the tick before.
    fn sense(&mut self, impulse_m_s: [f64; 2]) {
        let body = self.plant.body();
        let ground_m = self.terrain.map_or(0.0, |terrain| terrain.height_m(body.x_m));
        let (is_on_ground, leg_angle_rad) = match self.plant.phase() {
            Phase::Stance { foot_x_m, foot_y_m } => {
                (true, libm::atan2(body.y_m - foot_y_m, body.x_m - foot_x_m))
            }
            Phase::Flight | Phase::Fallen => (false, self.held_angle_rad),
        };
        let truth = Truth {
            tick: self.world.ticks,
            velocity_m_s: [body.vx_m_s, body.vy_m_s],
            height_m: body.y_m - ground_m,
            y_m: body.y_m,
            is_on_ground,
            leg_length_m: self.plant.leg_length_m(),
            leg_angle_rad,
            // The body of this plant is a point: it keeps level.
            pitch_rad: 0.0,
            pitch_rate_rad_s: 0.0,
            impulse_m_s,
            gravity_m_s2: self.scenario.played_gravity_m_s2(),
            density_ratio: self.medium.density_ratio(),
        };
        let mut sample = Sample { header: self.header(0), ..Sample::default() };
        self.sensors.read(&truth, &mut sample);
        if self.scenario.density_sense == DensitySense::Measured {
            sample.header.flags |= flags::DENSITY_SENSED;
            sample.density_ratio = self.medium.density_ratio() as f32;
        }
        let sample = self.sensors.sent(sample);
        // Where the run is over no sample follows.
        let faulty = self
            .ending()
            .is_none()
            .then(|| self.sensor_faults.pass(self.world.ticks, Some(sample)))
            .flatten();
        self.sample = faulty.unwrap_or(sample);
        self.update_set_point();
    }

    fn update_set_point(&mut self) {
        let scheduled_m_s = self.set_points.at(self.t_s(), self.plant.body().x_m);
        self.sample.set_point_m_s = self.override_m_s.unwrap_or(scheduled_m_s) as f32;
    }
}
