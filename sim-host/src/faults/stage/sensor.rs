//! Faults of the leg's sensors: on samples.

use super::chain::{Now, Passed, Stage};
use super::dice::Dice;
use leg_control::wire::{Sample, flags};

/// A reading in a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// `vx_m_s`.
    Vx,
    /// `y_m`.
    Y,
    /// `vy_m_s`.
    Vy,
    /// `leg_length_m`.
    LegLength,
    /// `density_ratio`.
    Density,
}

impl Reading {
    /// Those that every leg has.
    pub const MOTION: &'static [Self] = &[Self::Vx, Self::Y, Self::Vy, Self::LegLength];

    fn of(self, sample: &mut Sample) -> &mut f32 {
        match self {
            Self::Vx => &mut sample.vx_m_s,
            Self::Y => &mut sample.y_m,
            Self::Vy => &mut sample.vy_m_s,
            Self::LegLength => &mut sample.leg_length_m,
            Self::Density => &mut sample.density_ratio,
        }
    }
}

/// What is wrong with a reading; figures in its own unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ill {
    /// Normal noise of this standard deviation, another at every tick.
    Noise(f64),
    /// This much too high.
    Bias(f64),
    /// In this share of the samples it is no number.
    NotANumber(f64),
}

/// Readings that are wrong.
#[derive(Debug)]
pub struct Sensor {
    readings: &'static [Reading],
    ill: Ill,
    dice: Dice,
}

impl Sensor {
    /// These readings, in this way.
    #[must_use]
    pub fn new(readings: &'static [Reading], ill: Ill, dice: Dice) -> Self {
        Self { readings, ill, dice }
    }
}

impl Stage<Sample> for Sensor {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        if let Ill::NotANumber(share) = self.ill
            && !self.dice.happens(share)
        {
            return Passed::untouched(message);
        }
        for reading in self.readings {
            let value = reading.of(&mut sample);
            *value = match self.ill {
                Ill::Noise(deviation) => {
                    (f64::from(*value) + deviation * self.dice.normal()) as f32
                }
                Ill::Bias(by) => (f64::from(*value) + by) as f32,
                Ill::NotANumber(_) => f32::NAN,
            };
        }
        Passed::touched(Some(sample))
    }
}

/// Contact readings turned over.
#[derive(Debug)]
pub struct ContactNoise {
    share: f64,
    dice: Dice,
}

impl ContactNoise {
    /// In this share of the samples, 0 to 1.
    #[must_use]
    pub fn new(share: f64, dice: Dice) -> Self {
        Self { share, dice }
    }
}

impl Stage<Sample> for ContactNoise {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message else { return Passed::untouched(None) };
        if !(now.active && self.dice.happens(self.share)) {
            return Passed::untouched(message);
        }
        sample.header.flags ^= flags::IN_CONTACT;
        Passed::touched(Some(sample))
    }
}

/// What is stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StuckAt {
    /// These readings.
    Readings(&'static [Reading]),
    /// The contact reading.
    Contact,
}

/// Readings that keep their value for a while, now and then.
#[derive(Debug)]
pub struct Stuck {
    at: StuckAt,
    ticks: u64,
    chance: f64,
    dice: Dice,
    until: u64,
    held: Sample,
}

impl Stuck {
    /// For so many ticks; each tick begins it by this chance.
    #[must_use]
    pub fn new(at: StuckAt, ticks: u64, chance: f64, dice: Dice) -> Self {
        Self { at, ticks, chance, dice, until: 0, held: Sample::default() }
    }
}

impl Stage<Sample> for Stuck {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message else { return Passed::untouched(None) };
        if now.tick >= self.until {
            self.held = sample;
            if now.active && self.dice.happens(self.chance) {
                self.until = now.tick + self.ticks;
            }
        }
        if now.tick >= self.until {
            return Passed::untouched(message);
        }
        match self.at {
            StuckAt::Readings(readings) => {
                for reading in readings {
                    *reading.of(&mut sample) = *reading.of(&mut self.held);
                }
            }
            StuckAt::Contact => {
                let others = sample.header.flags & !flags::IN_CONTACT;
                sample.header.flags = others | self.held.header.flags & flags::IN_CONTACT;
            }
        }
        Passed::touched(Some(sample))
    }
}
