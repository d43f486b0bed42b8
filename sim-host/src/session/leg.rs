//! The leg in a session: plant, sensors, the command in force, and what has
//! come of it. It knows no clock and no link; a session brings it commands and
//! says when a tick is over.

use std::time::Duration;

use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};

use super::hash::StateHash;
use super::held::Held;
use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::{Terrain, WorldCounts};
use crate::scenario::{DensitySense, Scenario, SetPointCursor};
use leg_plant::{Body, EventKind, Flat, Ground, Medium, Phase, TickEvents, TickPlant};

/// All there is to know of one tick.
#[derive(Debug)]
pub struct TickRecord<'a> {
    /// Its number.
    pub seq: u64,
    /// Time at its start, s.
    pub t_s: f64,
    /// Length of the tick, s.
    pub dt_s: f64,
    /// The true state at its start, which the sample rounds.
    pub body: Body,
    /// What the leg was doing at its start.
    pub phase: Phase,
    /// The medium over the tick.
    pub medium: Medium,
    /// What the controller was told.
    pub sample: &'a Sample,
    /// The command in force over this tick: its answer or, where that is late,
    /// one before it, or the leg's own safe command.
    pub command: &'a Command,
    /// Whether that command is new in this tick.
    pub is_new: bool,
    /// What happened in the tick; event times count from its start.
    pub events: &'a TickEvents,
    /// The state at its end.
    pub after: Body,
    /// How long the answer took; 0 where nobody waits for one.
    pub round_trip: Duration,
}

/// A leg under way through a scenario.
#[derive(Debug)]
pub struct Leg<'a> {
    scenario: &'a Scenario,
    run_id: u32,
    set_points: SetPointCursor<'a>,
    /// Asked for by hand, instead of the scenario's.
    ordered_m_s: Option<f64>,
    plant: TickPlant,
    medium: Medium,
    terrain: Option<Terrain>,
    changes_medium: bool,
    world: WorldCounts,
    held: Held,
    seq: u64,
    /// Played before the last restart.
    ticks_before: u64,
    restarts: u32,
    sample: Sample,
    touchdowns: u64,
    apexes: u64,
    safe_ticks: u64,
    rejected: u32,
    hash: StateHash,
}

impl<'a> Leg<'a> {
    /// A leg at its scenario's start. `run_id` numbers the run: it goes out with
    /// every sample, and only commands that carry it count.
    #[must_use]
    pub fn new(scenario: &'a Scenario, run_id: u32) -> Self {
        let mut leg = Self {
            scenario,
            run_id,
            set_points: scenario.set_points.begin(scenario.start.x_m),
            ordered_m_s: None,
            plant: TickPlant::new(scenario.played_leg(), scenario.start),
            medium: scenario.medium_at(scenario.start.x_m),
            terrain: scenario.faults.terrain(),
            changes_medium: scenario.faults.change_the_medium(),
            world: WorldCounts::default(),
            held: Held::default(),
            seq: 0,
            ticks_before: 0,
            restarts: 0,
            sample: Sample::default(),
            touchdowns: 0,
            apexes: 0,
            safe_ticks: 0,
            rejected: 0,
            hash: StateHash::default(),
        };
        leg.look_around();
        leg.sense();
        leg
    }

    /// Number of the tick that is to be played next.
    #[must_use]
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// Simulated time at its start, s.
    #[must_use]
    pub fn t_s(&self) -> f64 {
        self.seq as f64 / f64::from(self.scenario.rate_hz)
    }

    /// The true state at its start.
    #[must_use]
    pub fn body(&self) -> Body {
        self.plant.body()
    }

    /// What the sensors say at its start.
    #[must_use]
    pub fn sample(&self) -> &Sample {
        &self.sample
    }

    /// What ends the controller's part of the run.
    #[must_use]
    pub fn farewell(&self) -> Sample {
        Sample { header: self.header(flags::END), ..Sample::default() }
    }

    /// Whether the run is over, and why.
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

    /// Ticks played, those before a restart included.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.ticks_before + self.seq
    }

    /// Puts the leg back to its scenario's start, as the run `run_id`. The time
    /// that is left, and what was counted, go on.
    pub fn restart(&mut self, run_id: u32) {
        self.run_id = run_id;
        self.restarts += 1;
        self.ticks_before = self.ticks();
        self.seq = 0;
        let start = self.scenario.start;
        self.set_points = self.scenario.set_points.begin(start.x_m);
        self.plant = TickPlant::new(self.scenario.played_leg(), start);
        self.look_around();
        self.held.forget();
        self.sense();
    }

    /// Asks for this speed from now on, m/s, whatever the scenario says; `None`
    /// gives the word back to it.
    pub fn order(&mut self, set_point_m_s: Option<f64>) {
        self.ordered_m_s = set_point_m_s;
        self.sense();
    }

    /// Whether a command answers this very tick.
    #[must_use]
    pub fn is_answered_by(&self, command: &Command) -> bool {
        let Header { version, run_id, seq, .. } = command.header;
        (version, run_id, seq) == (WIRE_VERSION, self.run_id, self.seq)
    }

    /// Counts a command that a session does not bring to [`Leg::step`].
    pub fn refuse(&mut self, _command: &Command) {
        self.held.refused += 1;
    }

    /// Plays a tick, under the newest command: `fresh` if one has come that
    /// counts, else the one before.
    pub fn step(
        &mut self,
        fresh: Option<Command>,
        round_trip: Duration,
        observe: &mut impl FnMut(&TickRecord),
    ) {
        let (seq, t_s, dt_s) = (self.seq, self.t_s(), self.scenario.tick_s());
        let (body, phase, medium) = (self.plant.body(), self.plant.phase(), self.medium);
        let is_new = self.held.take(&self.sample.header, fresh);
        let command = self.held.in_force(&self.sample.header);
        let acts = self.held.acting(&self.sample.header);

        let events = match &self.terrain {
            None => self.plant.step(dt_s, acts, medium, &Flat),
            Some(terrain) => self.plant.step(dt_s, acts, medium, terrain),
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
        self.look_around();
        self.sense();
    }

    /// What has come of it, at the end.
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
            held_ticks: self.held.ticks,
            silences: self.held.silences,
            rejected: self.rejected,
            foreign_commands: self.held.refused,
            state_hash: self.hash.value(),
            faults: self.scenario.faults.rows(&self.world),
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

    /// Finds the medium for the tick that comes.
    fn look_around(&mut self) {
        let x_m = self.plant.body().x_m;
        self.medium = self.scenario.medium_at(x_m);
        let since_s = self.ticks() as f64 / f64::from(self.scenario.rate_hz);
        if self.changes_medium
            && let Some((tag, density_ratio)) = self.scenario.faults.density(since_s, x_m)
        {
            self.medium = self.scenario.medium_of(density_ratio);
            self.world.count_medium(tag);
        }
    }

    fn sense(&mut self) {
        let body = self.plant.body();
        let ground_m = self.terrain.map_or(0.0, |terrain| terrain.height_m(body.x_m));
        let mut seen = flags::CONTACT_SENSED | flags::LEG_LENGTH_SENSED;
        if matches!(self.plant.phase(), Phase::Stance { .. }) {
            seen |= flags::IN_CONTACT;
        }
        let told = self.scenario.density_sense == DensitySense::Told;
        if told {
            seen |= flags::DENSITY_SENSED;
        }
        let scheduled_m_s = self.set_points.at(self.t_s(), body.x_m);
        self.sample = Sample {
            header: self.header(seen),
            set_point_m_s: self.ordered_m_s.unwrap_or(scheduled_m_s) as f32,
            vx_m_s: body.vx_m_s as f32,
            y_m: (body.y_m - ground_m) as f32,
            vy_m_s: body.vy_m_s as f32,
            leg_length_m: self.plant.leg_length_m() as f32,
            density_ratio: if told { self.medium.density_ratio() as f32 } else { 0.0 },
        };
    }
}
