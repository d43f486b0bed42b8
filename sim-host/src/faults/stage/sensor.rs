//! Faults of the leg's sensors, which act on samples.

use super::pipeline::{FaultStage, Now, Passed};
use super::reading::Slot;
use super::rng::FaultRng;
use leg_control::measurement::SpecificImpulse;
use leg_control::wire::{Sample, flags};

pub use super::reading::Reading;

/// A fault of a reading. Values are in the unit of the reading; those of the accelerometer, of
/// which a sample has the sum, in m/s2.
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
    /// Replaces the reading by NaN in this share of the samples, 0 to 1. A sum stays.
    NotANumber(f64),
}

/// Applies a [`ReadingFault`] to readings, in those samples that have them.
#[derive(Debug)]
pub struct FaultyReadings {
    readings: &'static [Reading],
    fault: ReadingFault,
    rng: FaultRng,
    /// The correlated noise of each reading in the last tick, and that tick.
    state: [f64; Reading::COUNT],
    last_tick: Option<u64>,
    /// The time of the sample before, and what the fault has added to each sum by then, counts.
    last_ns: Option<u64>,
    added: [f64; Reading::COUNT],
}

impl FaultyReadings {
    /// Applies `fault` to `readings`.
    #[must_use]
    pub fn new(readings: &'static [Reading], fault: ReadingFault, rng: FaultRng) -> Self {
        let zero = [0.0; Reading::COUNT];
        Self { readings, fault, rng, state: zero, last_tick: None, last_ns: None, added: zero }
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

impl FaultyReadings {
    /// Draws the error of reading number `i` in this tick.
    fn error(&mut self, i: usize) -> f64 {
        match self.fault {
            ReadingFault::Correlated { .. } => self.state[i],
            ReadingFault::Uniform(most) => most * (2.0 * self.rng.uniform() - 1.0),
            ReadingFault::Noise(deviation) => deviation * self.rng.normal(),
            ReadingFault::Bias(by) => by,
            ReadingFault::NotANumber(_) => f64::NAN,
        }
    }

    /// Adds to the sums what the fault has added so far, which stays when the fault is over.
    fn shift_sums(&self, sample: &mut Sample) {
        for (reading, added) in self.readings.iter().zip(self.added) {
            if reading.is_in(sample)
                && let Slot::Sum(sum) = reading.of(sample)
            {
                *sum = sum.wrapping_add(libm::round(added) as i64 as i32);
            }
        }
    }
}

impl FaultStage<Sample> for FaultyReadings {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message else { return Passed::untouched(message) };
        let since_ns = sample.header.t_ns.saturating_sub(self.last_ns.unwrap_or(u64::MAX));
        self.last_ns = Some(sample.header.t_ns);
        let is_nan = matches!(self.fault, ReadingFault::NotANumber(_));
        let acts = now.active
            && match self.fault {
                ReadingFault::NotANumber(share) => self.rng.occurs(share),
                _ => true,
            };
        let mut is_touched = false;
        if acts {
            if let ReadingFault::Correlated { deviation, ticks } = self.fault {
                self.correlate(now.tick, deviation, ticks);
            }
            for (i, reading) in self.readings.iter().enumerate() {
                if !reading.is_in(&sample) {
                    continue;
                }
                let error = self.error(i);
                match reading.of(&mut sample) {
                    Slot::Value(value) if is_nan => *value = f32::NAN,
                    Slot::Value(value) => *value = (f64::from(*value) + error) as f32,
                    Slot::Sum(_) if is_nan => continue,
                    Slot::Sum(_) => {
                        // An acceleration, since the sample before.
                        let added_m_s = error * 1e-9 * since_ns as f64;
                        self.added[i] += added_m_s / f64::from(SpecificImpulse::UNIT_M_S);
                    }
                }
                is_touched = true;
            }
        }
        self.shift_sums(&mut sample);
        if is_touched { Passed::touched(Some(sample)) } else { Passed::untouched(Some(sample)) }
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

/// The readings that a fault acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorTarget {
    /// Numeric readings.
    Readings(&'static [Reading]),
    /// The contact reading.
    Contact,
}

/// Makes readings keep their value for some ticks, at random instants.
#[derive(Debug)]
pub struct Stuck {
    target: SensorTarget,
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
    pub fn new(target: SensorTarget, ticks: u64, chance: f64, rng: FaultRng) -> Self {
        Self { target, ticks, chance, rng, until: 0, held: Sample::default() }
    }
}

impl Stuck {
    /// Keeps those readings of a sample that it has.
    fn hold(&mut self, sample: Sample) {
        match self.target {
            SensorTarget::Readings(readings) => {
                for reading in readings.iter().filter(|reading| reading.is_in(&sample)) {
                    reading.copy(sample, &mut self.held);
                    self.held.header.flags |= reading.flag();
                }
            }
            SensorTarget::Contact => self.held.header.flags = sample.header.flags,
        }
    }

    /// Returns a sample with the readings that are kept.
    fn stuck(&self, read: Sample) -> Sample {
        let mut sample = read;
        match self.target {
            SensorTarget::Readings(readings) => {
                // A slow sensor may not have read before.
                let is_held =
                    |reading: &&Reading| reading.is_in(&read) && reading.is_in(&self.held);
                for reading in readings.iter().filter(is_held) {
                    reading.copy(self.held, &mut sample);
                }
            }
            SensorTarget::Contact => {
                let others = sample.header.flags & !flags::IN_CONTACT;
                sample.header.flags = others | self.held.header.flags & flags::IN_CONTACT;
            }
        }
        sample
    }
}

impl FaultStage<Sample> for Stuck {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(sample) = message else { return Passed::untouched(None) };
        if now.tick >= self.until {
            self.hold(sample);
            if now.active && self.rng.occurs(self.chance) {
                self.until = now.tick + self.ticks;
            }
        }
        if now.tick >= self.until {
            return Passed::untouched(message);
        }
        Passed::touched(Some(self.stuck(sample)))
    }
}

/// Takes readings out of every sample, as a sensor that is dead.
#[derive(Debug)]
pub struct Dead(pub SensorTarget);

impl FaultStage<Sample> for Dead {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let Some(mut sample) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        match self.0 {
            SensorTarget::Readings(readings) => {
                for reading in readings {
                    reading.remove(&mut sample);
                }
            }
            SensorTarget::Contact => {
                sample.header.flags &= !(flags::CONTACT_SENSED | flags::IN_CONTACT);
            }
        }
        Passed::touched(Some(sample))
    }
}

/// Holds the contact switch closed or open.
#[derive(Debug)]
pub struct StuckSwitch {
    /// Whether it is stuck closed.
    pub is_closed: bool,
}

impl FaultStage<Sample> for StuckSwitch {
    fn pass(&mut self, now: Now, message: Option<Sample>) -> Passed<Sample> {
        let senses = |sample: &Sample| sample.header.flags & flags::CONTACT_SENSED != 0;
        let Some(mut sample) = message.filter(|sample| now.active && senses(sample)) else {
            return Passed::untouched(message);
        };
        sample.header.flags &= !flags::IN_CONTACT;
        sample.header.flags |= if self.is_closed { flags::IN_CONTACT } else { 0 };
        Passed::touched(Some(sample))
    }
}
