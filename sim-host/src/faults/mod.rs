#![doc = include_str!("README.md")]

mod catalog;
mod check;
mod field;
mod setting;
pub mod stage;
mod terrain;

use std::fmt;

use crate::faults::stage::actuator::{Backlash, Bandwidth, DeadTime, Drive, Lag, Limit, Saturate};
use crate::faults::stage::message::{Corrupt, Delay, Duplicate, Freeze, FreezeMode, Loss, Reorder};
use crate::faults::stage::sensor::{
    ContactNoise, Dead, FaultyReadings, Reading, ReadingFault, SensorTarget, Stuck, StuckSwitch,
};
use crate::faults::stage::{FaultPipeline, FaultPlan, FaultRng, FaultStage, Window, WireMessage};
use leg_plant::{LegParameters, Losses};
use serde::Serialize;

pub use catalog::{FaultKind, help};
pub(crate) use check::RunParameters;
pub use setting::{FaultError, FaultSetting};
pub use terrain::{RandomTerrain, Terrain};

/// The checked faults of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    all: Vec<Fault>,
    seed: u64,
    rate_hz: u32,
}

#[derive(Clone, Debug, PartialEq)]
struct Fault {
    setting: FaultSetting,
    effect: FaultEffect,
}

#[derive(Clone, Debug, PartialEq)]
enum FaultEffect {
    Message { direction: Direction, fault: MessageFault, window: Window },
    Sensor { fault: SensorFault, window: Window },
    Actuator { fault: ActuatorFault, window: Window },
    Leg(LegFault),
    Ground(Terrain),
    Medium { density_ratio: f64, from: Trigger, until: Option<Trigger> },
}

impl FaultEffect {
    /// Returns true if a run can have only one fault of this kind.
    fn is_single(&self) -> bool {
        match self {
            Self::Leg(fault) => !fault.multiplies(),
            other => matches!(other, Self::Ground(_)),
        }
    }
}

/// How the simulated leg, or its gravity, differs from what the controller is configured for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LegFault {
    /// Factors.
    Mass(f64),
    Stiffness(f64),
    Drag(f64),
    Gravity(f64),
    /// Losses that the model does not have, in N s/m, kg, 1 and N.
    Damping(f64),
    FootMass(f64),
    Friction(f64),
    DriveForce(f64),
}

impl LegFault {
    /// Returns whether a run can have several of them, which multiply.
    fn multiplies(self) -> bool {
        matches!(self, Self::Mass(_) | Self::Stiffness(_) | Self::Drag(_))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Samples,
    Commands,
    Both,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum MessageFault {
    Drop(f64),
    Delay { ticks: u32, jitter_ticks: u32 },
    Duplicate(f64),
    Reorder(f64),
    Corrupt { share: f64, bits: u32 },
    Freeze { ticks: u32, chance: f64, mode: FreezeMode },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SensorFault {
    Readings(&'static [Reading], ReadingFault),
    ContactNoise(f64),
    Stuck { target: SensorTarget, ticks: u32, chance: f64 },
    Dead(SensorTarget),
    Switch { is_closed: bool },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ActuatorFault {
    Lag(f64),
    Saturate(Limit),
    Bandwidth(f64),
    DeadTime { ticks: u32 },
    Backlash(Drive, f64),
}

/// A time (s) or a place (m) at which a fault begins or ends.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trigger {
    Time(f64),
    Place(f64),
}

impl Trigger {
    fn is_reached(self, t_s: f64, x_m: f64) -> bool {
        match self {
            Self::Time(from_s) => t_s >= from_s,
            Self::Place(from_m) => x_m >= from_m,
        }
    }
}

/// How often a fault acted in a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FaultCount {
    /// The fault as the user wrote it.
    pub fault: String,
    /// Number of messages, samples, commands, ticks or touchdowns affected.
    pub touched: u64,
    /// Noun for the things counted, such as "messages".
    pub counted: &'static str,
}

impl fmt::Display for FaultCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { fault, touched, counted } = self;
        match touched {
            0 => write!(f, "fault {fault}: never fired"),
            _ => write!(f, "fault {fault}: {touched} {counted}"),
        }
    }
}

impl Faults {
    /// Returns true if there is no fault.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Creates the stages of the faults of sensors, which act on each sample before it is sent.
    /// Nothing is drawn yet.
    #[must_use]
    pub fn of_sensors(&self) -> FaultPipeline<leg_control::wire::Sample> {
        let mut stages = FaultPipeline::default();
        for (id, fault) in self.all.iter().enumerate() {
            if let FaultEffect::Sensor { fault, window } = fault.effect {
                stages.push(id, window, fault.stage(self.rng(id, 0)));
            }
        }
        stages
    }

    /// Creates the random sequence of a fault for samples (`lane` 0) or commands (1).
    fn rng(&self, id: usize, lane: u64) -> FaultRng {
        FaultRng::new(self.seed, 2 * id as u64 + lane)
    }

    /// Creates the stages of the faults of the link: those of messages and of actuators. Nothing
    /// is drawn yet.
    #[must_use]
    pub fn plan(&self) -> FaultPlan {
        let mut plan = FaultPlan::default();
        let tick_s = 1.0 / f64::from(self.rate_hz.max(1));
        for (id, fault) in self.all.iter().enumerate() {
            let rng = |lane| self.rng(id, lane);
            match fault.effect {
                FaultEffect::Message { direction, fault, window } => {
                    if direction != Direction::Commands {
                        fault.push_to(&mut plan.samples, id, window, rng(0));
                    }
                    if direction != Direction::Samples {
                        fault.push_to(&mut plan.commands, id, window, rng(1));
                    }
                }
                FaultEffect::Actuator { fault, window } => {
                    plan.commands.push(id, window, fault.stage(tick_s));
                }
                FaultEffect::Sensor { .. }
                | FaultEffect::Leg(_)
                | FaultEffect::Ground(_)
                | FaultEffect::Medium { .. } => (),
            }
        }
        plan
    }

    fn of_leg(&self) -> impl Iterator<Item = LegFault> {
        self.all.iter().filter_map(|fault| match fault.effect {
            FaultEffect::Leg(fault) => Some(fault),
            _ => None,
        })
    }

    /// Changes the parameters of the configured leg to those of the simulated one.
    pub(crate) fn change_leg(&self, leg: &mut LegParameters) {
        for fault in self.of_leg() {
            match fault {
                LegFault::Mass(factor) => leg.mass_kg *= factor,
                LegFault::Stiffness(factor) => leg.stiffness_n_m *= factor,
                LegFault::Drag(factor) => {
                    leg.drag_x *= factor;
                    leg.drag_y *= factor;
                }
                _ => (),
            }
        }
    }

    /// Returns the gravity of the simulated leg over the configured one.
    pub(crate) fn gravity_factor(&self) -> f64 {
        let gravity = self.of_leg().find_map(|fault| match fault {
            LegFault::Gravity(factor) => Some(factor),
            _ => None,
        });
        gravity.unwrap_or(1.0)
    }

    /// Returns the losses of the simulated leg.
    pub(crate) fn losses(&self) -> Losses {
        self.of_leg().fold(Losses::NONE, |losses, fault| {
            let with = match fault {
                LegFault::Damping(n_s_m) => losses.with_damping(n_s_m),
                LegFault::FootMass(kg) => losses.with_foot_mass(kg),
                LegFault::Friction(coefficient) => losses.with_friction(coefficient),
                LegFault::DriveForce(n) => losses.with_drive_force(n),
                _ => Ok(losses),
            };
            with.expect("checked with the settings, by the same limits")
        })
    }

    pub(crate) fn terrain(&self) -> Option<Terrain> {
        self.all.iter().find_map(|fault| match fault.effect {
            FaultEffect::Ground(terrain) => Some(terrain),
            _ => None,
        })
    }

    /// Returns the density ratio that a change of the medium sets at a time and place, with the id
    /// of its fault. If several apply, the last one counts.
    pub(crate) fn density(&self, t_s: f64, x_m: f64) -> Option<(usize, f64)> {
        self.all.iter().enumerate().rev().find_map(|(id, fault)| match fault.effect {
            FaultEffect::Medium { density_ratio, from, until }
                if from.is_reached(t_s, x_m)
                    && !until.is_some_and(|until| until.is_reached(t_s, x_m)) =>
            {
                Some((id, density_ratio))
            }
            _ => None,
        })
    }

    /// Returns true if any fault changes the medium.
    pub(crate) fn changes_medium(&self) -> bool {
        self.all.iter().any(|fault| matches!(fault.effect, FaultEffect::Medium { .. }))
    }

    /// Returns the count of each fault, those of sensors from their stages. Faults on the link are
    /// 0 until [`add_counts`].
    pub(crate) fn counts(
        &self,
        world: &WorldCounts,
        sensors: &FaultPipeline<leg_control::wire::Sample>,
    ) -> Vec<FaultCount> {
        let count = |(id, fault): (usize, &Fault)| FaultCount {
            fault: fault.setting.to_string(),
            touched: match fault.effect {
                FaultEffect::Leg(_) => world.ticks,
                FaultEffect::Ground(_) => world.uneven_touchdowns,
                FaultEffect::Medium { .. } => world.medium_ticks.get(id).copied().unwrap_or(0),
                _ => sensors.count(id),
            },
            counted: fault.setting.kind.counted(),
        };
        self.all.iter().enumerate().map(count).collect()
    }
}

/// Adds the counts of a plan to those of its faults.
pub fn add_counts(counts: &mut [FaultCount], plan: &FaultPlan) {
    for (id, count) in counts.iter_mut().enumerate() {
        count.touched += plan.count(id);
    }
}

/// Counts of the faults of leg, ground and medium.
#[derive(Clone, Debug, Default)]
pub(crate) struct WorldCounts {
    pub(crate) ticks: u64,
    pub(crate) uneven_touchdowns: u64,
    /// Ticks in which a change of the medium was in force, by fault id.
    pub(crate) medium_ticks: Vec<u64>,
}

impl WorldCounts {
    pub(crate) fn count_medium(&mut self, id: usize) {
        if self.medium_ticks.len() <= id {
            self.medium_ticks.resize(id + 1, 0);
        }
        self.medium_ticks[id] += 1;
    }
}

impl MessageFault {
    fn push_to<M: WireMessage>(
        self,
        pipeline: &mut FaultPipeline<M>,
        id: usize,
        window: Window,
        rng: FaultRng,
    ) {
        let stage: Box<dyn FaultStage<M>> = match self {
            Self::Drop(share) => Box::new(Loss::new(share, rng)),
            Self::Delay { ticks, jitter_ticks } => Box::new(Delay::new(ticks, jitter_ticks, rng)),
            Self::Duplicate(share) => Box::new(Duplicate::new(share, rng)),
            Self::Reorder(share) => Box::new(Reorder::new(share, rng)),
            Self::Corrupt { share, bits } => Box::new(Corrupt::new(share, bits, rng)),
            Self::Freeze { ticks, chance, mode } => {
                Box::new(Freeze::new(ticks.into(), chance, mode, rng))
            }
        };
        pipeline.push(id, window, stage);
    }
}

impl SensorFault {
    fn stage(self, rng: FaultRng) -> Box<dyn FaultStage<leg_control::wire::Sample>> {
        match self {
            Self::Readings(readings, fault) => Box::new(FaultyReadings::new(readings, fault, rng)),
            Self::ContactNoise(share) => Box::new(ContactNoise::new(share, rng)),
            Self::Stuck { target, ticks, chance } => {
                Box::new(Stuck::new(target, ticks.into(), chance, rng))
            }
            Self::Dead(target) => Box::new(Dead(target)),
            Self::Switch { is_closed } => Box::new(StuckSwitch { is_closed }),
        }
    }
}

impl ActuatorFault {
    fn stage(self, tick_s: f64) -> Box<dyn FaultStage<leg_control::wire::Command>> {
        match self {
            Self::Lag(time_constant_s) => Box::new(Lag::new(time_constant_s, tick_s)),
            Self::Saturate(limit) => Box::new(Saturate::new(limit, tick_s)),
            Self::Bandwidth(hz) => Box::new(Bandwidth::new(hz, tick_s)),
            Self::DeadTime { ticks } => Box::new(DeadTime::new(ticks, tick_s)),
            Self::Backlash(drive, gap) => Box::new(Backlash::new(drive, gap, tick_s)),
        }
    }
}

#[cfg(test)]
mod tests;
