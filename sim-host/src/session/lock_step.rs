//! The lock-step session: a sample out, its command back, one step of the
//! plant, as fast as the machine.
//!
//! Sim time is tick number over rate. A command is taken only for its tick and
//! epoch, however long it takes to come, so a run is the same, bit for bit,
//! over any transport and at any speed.

use std::time::{Duration, Instant};

use controller::host::{LegLink, LinkError, Role};
use controller::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use serde::Serialize;

use super::hash::StateHash;
use super::timing::{RoundTripUs, RoundTrips};
use crate::plant::{Body, EventKind, Flat, LegCommand, Medium, Phase, TickEvents, TickPlant};
use crate::scenario::{DensitySense, Scenario};

/// How a session is played.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of the run, carried by every message.
    pub epoch: u32,
    /// How long to wait for a command.
    pub timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self { epoch: 1, timeout: Duration::from_secs(10) }
    }
}

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
    /// What it answered; acts over this tick.
    pub command: &'a Command,
    /// What happened in the tick; event times count from its start.
    pub events: &'a TickEvents,
    /// The state at its end.
    pub after: Body,
    /// How long the answer took.
    pub round_trip: Duration,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// Its time was over.
    Duration,
    /// It had come as far as it should.
    Distance,
    /// The leg fell.
    Fall,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Why it ended.
    pub ending: Ending,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Real time, s.
    pub wall_time_s: f64,
    /// Way from the start along x, m.
    pub distance_m: f64,
    /// The state at the end.
    pub body: Body,
    /// Times that the foot came down.
    pub touchdowns: u64,
    /// Apexes.
    pub apexes: u64,
    /// Ticks in which the controller sent its safe command.
    pub safe_ticks: u64,
    /// Samples that the controller's guard rejected, by its last command.
    pub rejected: u32,
    /// Commands dropped because they answered another tick or epoch.
    pub foreign_commands: u64,
    /// Hash of every state and command.
    pub state_hash: u64,
    /// How long the answers took.
    pub round_trips: RoundTrips,
}

impl Outcome {
    /// Ticks a second of real time.
    #[must_use]
    pub fn ticks_per_s(&self) -> f64 {
        self.ticks as f64 / self.wall_time_s
    }

    /// Whether the controller sent its safe command throughout.
    #[must_use]
    pub fn all_safe(&self) -> bool {
        self.ticks > 0 && self.safe_ticks == self.ticks
    }

    /// The figures, for a script.
    #[must_use]
    pub fn report(&self) -> Report {
        Report {
            ending: self.ending,
            falls: u32::from(self.ending == Ending::Fall),
            hops: self.touchdowns,
            apexes: self.apexes,
            distance_m: self.distance_m,
            ticks: self.ticks,
            sim_time_s: self.sim_time_s,
            ticks_per_s: self.ticks_per_s(),
            safe_ticks: self.safe_ticks,
            rejected: self.rejected,
            round_trip_us: self.round_trips.quantiles_us(),
            state_hash: format!("{:016x}", self.state_hash),
        }
    }
}

/// The figures of an [`Outcome`], by the names that scripts read.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Why the run ended.
    pub ending: Ending,
    /// Falls: 0 or 1, a fall ends the run.
    pub falls: u32,
    /// Times that the foot came down.
    pub hops: u64,
    /// Apexes.
    pub apexes: u64,
    /// Way along x, m.
    pub distance_m: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Ticks a second of real time.
    pub ticks_per_s: f64,
    /// Ticks under the safe command.
    pub safe_ticks: u64,
    /// Samples that the controller's guard rejected.
    pub rejected: u32,
    /// Time from sample to command.
    pub round_trip_us: RoundTripUs,
    /// Hash of every state and command, hexadecimal.
    pub state_hash: String,
}

/// Why a run broke off.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The link is broken, or the controller gone.
    #[error("at tick {tick}: {cause}")]
    Link {
        /// The tick.
        tick: u64,
        /// What happened.
        cause: LinkError,
    },
    /// The controller is there, but sends nothing that fits.
    #[error(
        "at tick {tick}: the {role} lives but has not answered for {waited_s} s; is it stopped? --timeout sets the patience",
        role = Role::Controller
    )]
    NoAnswer {
        /// The tick.
        tick: u64,
        /// How long, s.
        waited_s: f64,
    },
}

/// Plays `scenario` to the controller at the other end of `link`. `observe`
/// sees every tick; it may be slow, the run waits for it.
///
/// # Errors
/// [`SessionError`] when the controller goes or does not answer in time.
pub fn run(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    mut observe: impl FnMut(&TickRecord),
) -> Result<Outcome, SessionError> {
    let mut run = Run::new(scenario, options);
    let begun = Instant::now();
    let ending = loop {
        if let Some(ending) = run.ending() {
            break ending;
        }
        run.tick(link, &mut observe)?;
    };
    let wall_time_s = begun.elapsed().as_secs_f64();
    let farewell = Sample { header: run.header(flags::END), ..Sample::default() };
    link.send(&farewell).map_err(|cause| SessionError::Link { tick: run.seq, cause })?;
    Ok(run.outcome(ending, wall_time_s))
}

/// A run under way.
struct Run<'a> {
    scenario: &'a Scenario,
    options: Options,
    ticks: u64,
    dt_s: f64,
    set_point: crate::scenario::SetPointCursor<'a>,
    plant: TickPlant,
    seq: u64,
    touchdowns: u64,
    apexes: u64,
    safe_ticks: u64,
    rejected: u32,
    foreign_commands: u64,
    hash: StateHash,
    round_trips: RoundTrips,
}

impl<'a> Run<'a> {
    fn new(scenario: &'a Scenario, options: Options) -> Self {
        Self {
            scenario,
            options,
            ticks: scenario.ticks(),
            dt_s: scenario.tick_s(),
            set_point: scenario.set_points.begin(scenario.start.x_m),
            plant: TickPlant::new(scenario.leg, scenario.start),
            seq: 0,
            touchdowns: 0,
            apexes: 0,
            safe_ticks: 0,
            rejected: 0,
            foreign_commands: 0,
            hash: StateHash::default(),
            round_trips: RoundTrips::default(),
        }
    }

    fn ending(&self) -> Option<Ending> {
        let way_m = (self.plant.body().x_m - self.scenario.start.x_m).abs();
        if self.plant.phase() == Phase::Fallen {
            Some(Ending::Fall)
        } else if self.scenario.distance_m.is_some_and(|distance_m| way_m >= distance_m) {
            Some(Ending::Distance)
        } else if self.seq >= self.ticks {
            Some(Ending::Duration)
        } else {
            None
        }
    }

    fn t_s(&self) -> f64 {
        self.seq as f64 / f64::from(self.scenario.rate_hz)
    }

    fn header(&self, flags: u16) -> Header {
        Header {
            version: WIRE_VERSION,
            flags,
            epoch: self.options.epoch,
            seq: self.seq,
            t_ns: self.seq * 1_000_000_000 / u64::from(self.scenario.rate_hz),
        }
    }

    fn tick(
        &mut self,
        link: &mut impl LegLink,
        observe: &mut impl FnMut(&TickRecord),
    ) -> Result<(), SessionError> {
        let (body, phase, t_s) = (self.plant.body(), self.plant.phase(), self.t_s());
        let medium = self.scenario.medium_at(body.x_m);
        let sample = self.sense(medium);

        let asked = Instant::now();
        let command = self.ask(link, &sample)?;
        let round_trip = asked.elapsed();

        let events = self.plant.step(self.dt_s, as_leg_command(&command), medium, &Flat);
        let after = self.plant.body();
        self.hash.body(&body);
        self.hash.command(&command);
        self.round_trips.record(round_trip);
        self.safe_ticks += u64::from(command.header.flags & flags::SAFE != 0);
        self.rejected = command.rejected;
        for event in events.iter() {
            match event.kind {
                EventKind::Touchdown { .. } => self.touchdowns += 1,
                EventKind::Apex => self.apexes += 1,
                EventKind::LiftOff | EventKind::Fall => (),
            }
        }
        observe(&TickRecord {
            seq: self.seq,
            t_s,
            dt_s: self.dt_s,
            body,
            phase,
            medium,
            sample: &sample,
            command: &command,
            events: &events,
            after,
            round_trip,
        });
        self.seq += 1;
        Ok(())
    }

    /// What the leg's sensors say.
    fn sense(&mut self, medium: Medium) -> Sample {
        let body = self.plant.body();
        let mut seen = flags::CONTACT_SENSED | flags::LEG_LENGTH_SENSED;
        if matches!(self.plant.phase(), Phase::Stance { .. }) {
            seen |= flags::IN_CONTACT;
        }
        let told = self.scenario.density_sense == DensitySense::Told;
        if told {
            seen |= flags::DENSITY_SENSED;
        }
        Sample {
            header: self.header(seen),
            set_point_m_s: self.set_point.at(self.t_s(), body.x_m) as f32,
            vx_m_s: body.vx_m_s as f32,
            y_m: body.y_m as f32,
            vy_m_s: body.vy_m_s as f32,
            leg_length_m: self.plant.leg_length_m() as f32,
            density_ratio: if told { medium.density_ratio() as f32 } else { 0.0 },
        }
    }

    /// The command for this very sample.
    fn ask(&mut self, link: &mut impl LegLink, sample: &Sample) -> Result<Command, SessionError> {
        let tick = self.seq;
        let broken = |cause| SessionError::Link { tick, cause };
        link.send(sample).map_err(broken)?;
        let timeout = self.options.timeout;
        let mut left = timeout;
        let mut since = None;
        loop {
            let Some(command) = link.receive(left).map_err(broken)? else {
                return Err(SessionError::NoAnswer { tick, waited_s: timeout.as_secs_f64() });
            };
            let Header { version, epoch, seq, .. } = command.header;
            if (version, epoch, seq) == (WIRE_VERSION, self.options.epoch, tick) {
                return Ok(command);
            }
            self.foreign_commands += 1;
            let since = *since.get_or_insert_with(Instant::now);
            left = timeout.saturating_sub(since.elapsed());
        }
    }

    fn outcome(mut self, ending: Ending, wall_time_s: f64) -> Outcome {
        let body = self.plant.body();
        self.hash.body(&body);
        Outcome {
            ending,
            ticks: self.seq,
            sim_time_s: self.t_s(),
            wall_time_s,
            distance_m: body.x_m - self.scenario.start.x_m,
            body,
            touchdowns: self.touchdowns,
            apexes: self.apexes,
            safe_ticks: self.safe_ticks,
            rejected: self.rejected,
            foreign_commands: self.foreign_commands,
            state_hash: self.hash.value(),
            round_trips: self.round_trips,
        }
    }
}

fn as_leg_command(command: &Command) -> LegCommand {
    LegCommand {
        leg_angle_rad: command.leg_angle_rad.into(),
        elongation_m: command.elongation_m.into(),
        elongation_rate_m_s: command.elongation_rate_m_s.into(),
    }
}

#[cfg(test)]
mod tests;
