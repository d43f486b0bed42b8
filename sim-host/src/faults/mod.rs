//! Faults on purpose: what a user says, checked, and what becomes of it.
//!
//! Those on messages, sensors and actuators become the middleware of
//! [`crate::faults::stage`]; those of the leg's world, its mass and spring,
//! the ground and the medium, are part of the [scenario](crate::scenario).
//! What each fault draws comes from the run's seed and the fault's place in the
//! list: the same again at every run.

mod catalog;
mod check;
mod setting;
pub mod stage;
mod terrain;

use std::fmt;

use crate::faults::stage::actuator::{Lag, Limit, Saturate};
use crate::faults::stage::message::{Corrupt, Delay, Drop, Duplicate, Freeze, Ice, Reorder};
use crate::faults::stage::sensor::{ContactNoise, Ill, Reading, Sensor, Stuck, StuckAt};
use crate::faults::stage::{Chain, Dice, WireMessage, Plan, Stage, Window};
use serde::Serialize;

pub use catalog::{Kind, help};
pub(crate) use check::Run;
pub use setting::{BadFault, FaultSetting};
pub use terrain::{Drawn, Terrain};

/// The faults of a run, checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    all: Vec<Fault>,
    seed: u64,
    rate_hz: u32,
}

#[derive(Clone, Debug, PartialEq)]
struct Fault {
    setting: FaultSetting,
    what: What,
}

#[derive(Clone, Debug, PartialEq)]
enum What {
    Message { direction: Direction, trouble: Trouble, window: Window },
    Sensor { ill: SensorIll, window: Window },
    Actuator { ill: ActuatorIll, window: Window },
    Mass(f64),
    Stiffness(f64),
    Ground(Terrain),
    Medium { density_ratio: f64, from: Mark, until: Option<Mark> },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Samples,
    Commands,
    Both,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    Drop(f64),
    Delay { ticks: u32, jitter_ticks: u32 },
    Duplicate(f64),
    Reorder(f64),
    Corrupt { share: f64, bits: u32 },
    Freeze { ticks: u32, chance: f64, ice: Ice },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SensorIll {
    Readings(&'static [Reading], Ill),
    ContactNoise(f64),
    Stuck { at: StuckAt, ticks: u32, chance: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ActuatorIll {
    Lag(f64),
    Saturate(Limit),
}

/// A time, s, or a place, m.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mark {
    Time(f64),
    Place(f64),
}

impl Mark {
    fn is_reached(self, t_s: f64, x_m: f64) -> bool {
        match self {
            Self::Time(from_s) => t_s >= from_s,
            Self::Place(from_m) => x_m >= from_m,
        }
    }
}

/// What a fault came to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FaultCount {
    /// As it was said.
    pub fault: String,
    /// How often it has done something.
    pub touched: u64,
    /// What is counted.
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
    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Those of messages, sensors and actuators, new: nothing drawn yet.
    #[must_use]
    pub fn plan(&self) -> Plan {
        let mut plan = Plan::default();
        let tick_s = 1.0 / f64::from(self.rate_hz.max(1));
        for (tag, fault) in self.all.iter().enumerate() {
            // Two sequences a fault: samples and commands meet independent fates.
            let dice = |lane: u64| Dice::new(self.seed, 2 * tag as u64 + lane);
            match fault.what {
                What::Message { direction, trouble, window } => {
                    if direction != Direction::Commands {
                        trouble.put(&mut plan.samples, tag, window, dice(0));
                    }
                    if direction != Direction::Samples {
                        trouble.put(&mut plan.commands, tag, window, dice(1));
                    }
                }
                What::Sensor { ill, window } => {
                    plan.samples.push(tag, window, ill.stage(dice(0)));
                }
                What::Actuator { ill, window } => {
                    plan.commands.push(tag, window, ill.stage(tick_s));
                }
                What::Mass(_) | What::Stiffness(_) | What::Ground(_) | What::Medium { .. } => (),
            }
        }
        plan
    }

    /// How much heavier, and how much stiffer, the leg is than it is said to be.
    pub(crate) fn leg_factors(&self) -> [f64; 2] {
        self.all.iter().fold([1.0; 2], |[mass, stiffness], fault| match fault.what {
            What::Mass(factor) => [mass * factor, stiffness],
            What::Stiffness(factor) => [mass, stiffness * factor],
            _ => [mass, stiffness],
        })
    }

    pub(crate) fn terrain(&self) -> Option<Terrain> {
        self.all.iter().find_map(|fault| match fault.what {
            What::Ground(terrain) => Some(terrain),
            _ => None,
        })
    }

    /// The density that a sudden change makes at a time and place, and whose it
    /// is: of those that hold, the one said last.
    pub(crate) fn density(&self, t_s: f64, x_m: f64) -> Option<(usize, f64)> {
        self.all.iter().enumerate().rev().find_map(|(tag, fault)| match fault.what {
            What::Medium { density_ratio, from, until }
                if from.is_reached(t_s, x_m)
                    && !until.is_some_and(|until| until.is_reached(t_s, x_m)) =>
            {
                Some((tag, density_ratio))
            }
            _ => None,
        })
    }

    /// Whether any of them is a change of the medium.
    pub(crate) fn change_the_medium(&self) -> bool {
        self.all.iter().any(|fault| matches!(fault.what, What::Medium { .. }))
    }

    /// A row for each, nothing counted of those on the link yet.
    pub(crate) fn rows(&self, world: &WorldCounts) -> Vec<FaultCount> {
        let row = |(tag, fault): (usize, &Fault)| FaultCount {
            fault: fault.setting.to_string(),
            touched: match fault.what {
                What::Mass(_) | What::Stiffness(_) => world.ticks,
                What::Ground(_) => world.uneven_touchdowns,
                What::Medium { .. } => world.medium_ticks.get(tag).copied().unwrap_or(0),
                _ => 0,
            },
            counted: fault.setting.kind.counted(),
        };
        self.all.iter().enumerate().map(row).collect()
    }
}

/// Adds what a plan has counted to the rows of its faults.
pub fn add_counts(rows: &mut [FaultCount], plan: &Plan) {
    for (tag, row) in rows.iter_mut().enumerate() {
        row.touched += plan.count(tag);
    }
}

/// What the leg's world has done to it.
#[derive(Clone, Debug, Default)]
pub(crate) struct WorldCounts {
    pub(crate) ticks: u64,
    pub(crate) uneven_touchdowns: u64,
    /// By the fault's place in the list.
    pub(crate) medium_ticks: Vec<u64>,
}

impl WorldCounts {
    pub(crate) fn count_medium(&mut self, tag: usize) {
        if self.medium_ticks.len() <= tag {
            self.medium_ticks.resize(tag + 1, 0);
        }
        self.medium_ticks[tag] += 1;
    }
}

impl Trouble {
    fn put<M: WireMessage>(self, chain: &mut Chain<M>, tag: usize, window: Window, dice: Dice) {
        let stage: Box<dyn Stage<M>> = match self {
            Self::Drop(share) => Box::new(Drop::new(share, dice)),
            Self::Delay { ticks, jitter_ticks } => Box::new(Delay::new(ticks, jitter_ticks, dice)),
            Self::Duplicate(share) => Box::new(Duplicate::new(share, dice)),
            Self::Reorder(share) => Box::new(Reorder::new(share, dice)),
            Self::Corrupt { share, bits } => Box::new(Corrupt::new(share, bits, dice)),
            Self::Freeze { ticks, chance, ice } => {
                Box::new(Freeze::new(ticks.into(), chance, ice, dice))
            }
        };
        chain.push(tag, window, stage);
    }
}

impl SensorIll {
    fn stage(self, dice: Dice) -> Box<dyn Stage<leg_control::wire::Sample>> {
        match self {
            Self::Readings(readings, ill) => Box::new(Sensor::new(readings, ill, dice)),
            Self::ContactNoise(share) => Box::new(ContactNoise::new(share, dice)),
            Self::Stuck { at, ticks, chance } => {
                Box::new(Stuck::new(at, ticks.into(), chance, dice))
            }
        }
    }
}

impl ActuatorIll {
    fn stage(self, tick_s: f64) -> Box<dyn Stage<leg_control::wire::Command>> {
        match self {
            Self::Lag(time_constant_s) => Box::new(Lag::new(time_constant_s, tick_s)),
            Self::Saturate(limit) => Box::new(Saturate::new(limit, tick_s)),
        }
    }
}

#[cfg(test)]
mod tests;
