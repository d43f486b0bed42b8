//! Faults of the leg's sensors, which act on samples.

use super::pipeline::{FaultStage, Now, Passed};
use super::rng::FaultRng;
use leg_control::wire::{Sample, flags};

/// A reading of a sample.
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
    /// Number of readings.
    const COUNT: usize = 5;

    /// The readings that every leg has.
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

/// A fault of a reading. Values are in the unit of the reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReadingFault {
    /// Adds normal noise of this standard deviation, independent in every tick.
    Noise(f64),
    /// Adds normal noise of this standard deviation, of which a share of `exp(-1 / ticks)`
    /// stays from each tick to the next (first-order autoregressive).
    Correlated {
        /// Standard deviation.
        deviation: f64,
        /// Correlation time, ticks; above 0.
        ticks: f64,
    },
    /// Adds uniform noise of at most this size, independent in every tick.
    Uniform(f64),
    /// Adds this constant.
    Bias(f64),
    /// Replaces the reading by NaN in this share of the samples, 0 to 1.
    NotANumber(f64),
}

/// Applies a [`ReadingFault`] to readings.
#[derive(Debug)]
pub struct FaultyReadings {
    readings: &'static [Reading],
    fault: ReadingFault,
    rng: FaultRng,
    /// The correlated noise of each reading in the last tick, and that tick.
    state: [f64; Reading::COUNT],
    last_tick: Option<u64>,
}

impl FaultyReadings {
    /// Applies `fault` to `readings`.
    #[must_use]
    pub fn new(readings: &'static [Reading], fault: ReadingFault, rng: FaultRng) -> Self {
        Self { readings, fault, rng, state: [0.0; Reading::COUNT], last_tick: None }
    }

    /// Draws the correlated noise of a tick.
    fn correlate(&mut self, tick: u64, deviation: f64, ticks: f64) {
        let stays = match self.last_tick.replace(tick) {
            Some(last) => libm::exp(-(tick.saturating_sub(last) as f64) / ticks),
            None => 0.0,
        };
        let comes = deviation * libm::sqrt(1.0 - stays * stays);
        for state in self.state.iter_mut().take(self.readings.len()) {
            *state = stays * *state + comes * self.rng.normal();
        }
    }
}

impl FaultStage<Sample> for FaultyReadings {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        if let ReadingFault::NotANumber(share) = self.fault
            && !self.rng.occurs(share)
        {
            return Passed::untouched(message);
        }
        if let ReadingFault::Correlated { deviation, ticks } = self.fault {
            self.correlate(now.tick, deviation, ticks);
        }
        for (reading, correlated) in self.readings.iter().zip(self.state) {
            let value = reading.of(&mut sample);
            *value = match self.fault {
                ReadingFault::Correlated { .. } => (f64::from(*value) + correlated) as f32,
                ReadingFault::Uniform(most) => {
                    (f64::from(*value) + most * (2.0 * self.rng.uniform() - 1.0)) as f32
                }
                ReadingFault::Noise(deviation) => {
                    (f64::from(*value) + deviation * self.rng.normal()) as f32
                }
                ReadingFault::Bias(by) => (f64::from(*value) + by) as f32,
                ReadingFault::NotANumber(_) => f32::NAN,
            };
        }
        Passed::touched(Some(sample))
    }
}

/// Inverts the contact reading.
#[derive(Debug)]
pub struct ContactNoise {
    share: f64,
    rng: FaultRng,
}

impl ContactNoise {
    /// Inverts the reading in this share of the samples, 0 to 1.
    #[must_use]
    pub fn new(share: f64, rng: FaultRng) -> Self {
        Self { share, rng }
    }
}

impl FaultStage<Sample> for ContactNoise {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message else { return Passed::untouched(None) };
        if !(now.active && self.rng.occurs(self.share)) {
            return Passed::untouched(message);
        }
        sample.header.flags ^= flags::IN_CONTACT;
        Passed::touched(Some(sample))
    }
}

/// The readings that get stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StuckTarget {
    /// Numeric readings.
    Readings(&'static [Reading]),
    /// The contact reading.
    Contact,
}

/// Makes readings keep their value for some ticks, at random instants.
#[derive(Debug)]
pub struct Stuck {
    target: StuckTarget,
    ticks: u64,
    chance: f64,
    rng: FaultRng,
    until: u64,
    held: Sample,
}

impl Stuck {
    /// Holds the readings for `ticks` ticks; every other tick starts this with probability
    /// `chance`.
    #[must_use]
    pub fn new(target: StuckTarget, ticks: u64, chance: f64, rng: FaultRng) -> Self {
        Self { target, ticks, chance, rng, until: 0, held: Sample::default() }
    }
}

impl FaultStage<Sample> for Stuck {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message else { return Passed::untouched(None) };
        if now.tick >= self.until {
            self.held = sample;
            if now.active && self.rng.occurs(self.chance) {
                self.until = now.tick + self.ticks;
            }
        }
        if now.tick >= self.until {
            return Passed::untouched(message);
        }
        match self.target {
            StuckTarget::Readings(readings) => {
                for reading in readings {
                    *reading.of(&mut sample) = *reading.of(&mut self.held);
                }
            }
            StuckTarget::Contact => {
                let others = sample.header.flags & !flags::IN_CONTACT;
                sample.header.flags = others | self.held.header.flags & flags::IN_CONTACT;
            }
        }
        Passed::touched(Some(sample))
    }
}
