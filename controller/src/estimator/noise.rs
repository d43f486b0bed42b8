//! The noise of the readings, measured while the filter runs. No model and no filter takes
//! part, so a filter that believes too much cannot hide it.
//!
//! Two measures, both blind to the motion:
//!
//! - Of three readings in a row, the distance of the middle one from the line through its
//!   neighbours. Its square over `1 + a^2 + b^2`, with the weights `a` and `b` of the
//!   neighbours on that line, has the variance of the noise as its mean. For noise that
//!   hardly changes from one reading to the next it is nearly 0.
//! - The same of the means of three blocks of readings in flight, less the motion by the
//!   model; times the readings that the filter takes in a block. For noise that is correlated
//!   over less than a block it is the variance of the white noise with the same power at low
//!   frequencies, which is what a filter must reckon with.
//!
//! The second counts only where it is clearly larger: it is the mean of few, and of white
//! noise, of which a block has every other reading, it is twice the variance.

/// Channels of the state: horizontal velocity, height, vertical velocity.
pub(super) const CHANNELS: usize = 3;

/// Readings of a channel over which the first measure is averaged.
const READINGS: u16 = 128;
/// Readings from which on the square of a single one is limited to [`MOST_SQUARE`] times
/// the mean: a flipped bit must not blind the filter.
const LIMITED_FROM: u16 = 32;
const MOST_SQUARE: f32 = 16.0;
/// Triples of blocks over which the second measure is averaged.
const TRIPLES: u16 = 8;
/// Ratio of the measures from which on the noise counts as correlated.
const CORRELATED: f32 = 8.0;
/// Length of a block, ns, and its least and most readings.
const BLOCK_NS: u32 = 48_000_000;
const BLOCK_READINGS: core::ops::RangeInclusive<u32> = 2..=256;
/// Readings of the filter for each reading of a block.
const READINGS_PER_TURN: u32 = 2;
/// Turns of the ticks.
const TURNS: u8 = 2 * CHANNELS as u8;
/// Mean square of the middle of three off the mean of the others, for a variance of 1.
const TRIPLE_VARIANCE: f32 = 1.5;

/// One number for each channel.
type PerChannel = [f32; CHANNELS];

const NONE: PerChannel = [f32::NAN; CHANNELS];

/// The measured noise of the channels.
///
/// Ticks take turns, so that each is cheap: one compares the readings of a channel, the next
/// adds to the block, and so on through the channels. The noise of a sensor does not change
/// from one millisecond to the next.
#[derive(Clone, Debug)]
pub(super) struct NoiseMeter {
    channels: [Channel; CHANNELS],
    /// Time between the last two readings, s.
    between_s: f32,
    /// Whose turn it is: at even numbers channel `turn / 2`, at odd ones the block.
    turn: u8,
    blocks: Blocks,
}

/// The first measure of a channel.
#[derive(Clone, Copy, Debug)]
struct Channel {
    /// The reading before the last, and the last; NaN where one is missing.
    before: f32,
    last: f32,
    /// Readings that were compared with their neighbours, at most [`READINGS`].
    readings: u16,
    /// Variance by the first measure.
    white: f32,
    /// Least variance: the stated one.
    stated: f32,
}

/// The measure over blocks.
#[derive(Clone, Debug)]
struct Blocks {
    /// Readings of a block.
    length: u16,
    readings: u16,
    sum: PerChannel,
    /// The mean of three blocks, the newest last; NaN where there is none.
    means: [PerChannel; 3],
    /// Triples compared.
    triples: u16,
    variance: PerChannel,
}

impl NoiseMeter {
    /// Returns a meter for a tick of this length, ns, that finds at least these variances.
    pub(super) fn new(tick_ns: u64, stated: PerChannel) -> Self {
        // In 32 bits: a Cortex-M divides 64 in software.
        let ticks = BLOCK_NS / tick_ns.clamp(1, u64::from(BLOCK_NS)) as u32 / READINGS_PER_TURN;
        let length = ticks.clamp(*BLOCK_READINGS.start(), *BLOCK_READINGS.end()) as u16;
        let channel =
            |stated| Channel { before: f32::NAN, last: f32::NAN, readings: 0, white: 0.0, stated };
        Self {
            channels: stated.map(channel),
            between_s: 0.0,
            turn: 0,
            blocks: Blocks {
                length,
                readings: 0,
                sum: [0.0; CHANNELS],
                means: [NONE; 3],
                triples: 0,
                variance: [0.0; CHANNELS],
            },
        }
    }

    /// Returns whether every channel has so many readings that were compared.
    pub(super) fn has_compared(&self, readings: u16) -> bool {
        self.channels.iter().all(|channel| channel.readings >= readings)
    }

    /// Returns the variance of white noise that harms a filter as the noise of each channel
    /// does.
    pub(super) fn variance(&self) -> PerChannel {
        let [vx, y, vy] = &self.channels;
        let [vx_blocks, y_blocks, vy_blocks] = self.blocks.variance;
        [vx.variance(vx_blocks), y.variance(y_blocks), vy.variance(vy_blocks)]
    }

    /// Takes the readings of a tick, `dt_s` after the last; NaN where one is missing.
    pub(super) fn push(&mut self, readings: PerChannel, dt_s: f32) {
        self.turn = if self.turn == TURNS - 1 { 0 } else { self.turn + 1 };
        if self.turn.is_multiple_of(2) {
            let turn = usize::from(self.turn / 2);
            let channel = self.channels.get_mut(turn);
            if let (Some(channel), Some(&reading)) = (channel, readings.get(turn)) {
                channel.compare(reading, dt_s, self.between_s);
            }
        }
        for (channel, reading) in self.channels.iter_mut().zip(readings) {
            (channel.before, channel.last) = (channel.last, reading);
        }
        self.between_s = dt_s;
    }

    /// Takes the readings of a tick in flight, all of them, less the motion by the model
    /// since the flight began.
    pub(super) fn push_in_flight(&mut self, rest: PerChannel) {
        if !self.turn.is_multiple_of(2) {
            self.blocks.push(rest);
        }
    }

    /// Ends a flight: blocks before and after are not compared.
    pub(super) fn end_flight(&mut self) {
        let blocks = &mut self.blocks;
        (blocks.readings, blocks.sum) = (0, [0.0; CHANNELS]);
        blocks.means = [NONE; 3];
    }
}

impl Channel {
    /// Compares the last reading with its neighbours, of which the next is `dt_s` after it and
    /// the one before `between_s` before it.
    fn compare(&mut self, reading: f32, dt_s: f32, between_s: f32) {
        let square = if dt_s == between_s {
            let off = self.last - 0.5 * (self.before + reading);
            off * off * (1.0 / TRIPLE_VARIANCE)
        } else {
            let after_part = between_s / (dt_s + between_s);
            let before_part = 1.0 - after_part;
            let off = self.last - before_part * self.before - after_part * reading;
            off * off / (1.0 + before_part * before_part + after_part * after_part)
        };
        if square.is_nan() || square > f32::MAX {
            return;
        }
        let most = MOST_SQUARE * self.white;
        if self.readings == READINGS {
            let square = if square > most { most } else { square };
            self.white += (1.0 / READINGS as f32) * (square - self.white);
            return;
        }
        let is_limited = self.readings >= LIMITED_FROM && square > most;
        let square = if is_limited { most } else { square };
        self.readings += 1;
        self.white += (square - self.white) / f32::from(self.readings);
    }

    /// Returns the variance that counts, given that of the second measure.
    fn variance(&self, of_blocks: f32) -> f32 {
        let is_correlated = of_blocks > CORRELATED * self.white;
        let measured = if is_correlated { of_blocks } else { self.white };
        if measured > self.stated { measured } else { self.stated }
    }
}

impl Blocks {
    fn push(&mut self, rest: PerChannel) {
        for (sum, rest) in self.sum.iter_mut().zip(rest) {
            *sum += rest;
        }
        self.readings += 1;
        // The channels of a block are compared one a tick, so that no tick is costly.
        if self.readings <= CHANNELS as u16 {
            self.compare(usize::from(self.readings) - 1);
        } else if self.readings == self.length {
            self.finish();
        }
    }

    #[inline(never)]
    fn finish(&mut self) {
        let [_, middle, newest] = self.means;
        let per_reading = 1.0 / f32::from(self.length);
        self.means = [middle, newest, self.sum.map(|sum| sum * per_reading)];
        (self.readings, self.sum) = (0, [0.0; CHANNELS]);
    }

    #[inline(never)]
    fn compare(&mut self, channel: usize) {
        let [before, middle, after] = &self.means;
        let of = |means: &PerChannel| means.get(channel).copied().unwrap_or(f32::NAN);
        let off = of(middle) - 0.5 * (of(before) + of(after));
        let readings = READINGS_PER_TURN as f32 * f32::from(self.length);
        let square = off * off * readings / TRIPLE_VARIANCE;
        if square <= f32::MAX
            && let Some(variance) = self.variance.get_mut(channel)
        {
            let triples = (self.triples + 1).min(TRIPLES);
            *variance += (square - *variance) / f32::from(triples);
            if channel == CHANNELS - 1 {
                self.triples = triples;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::random::Random;

    /// Returns the standard deviations that are measured of a fall of `ticks` milliseconds,
    /// of which every `every`-th is read.
    fn measured(ticks: u16, every: usize, mut noise: impl FnMut() -> f32) -> PerChannel {
        let mut meter = NoiseMeter::new(1_000_000, [0.0; CHANNELS]);
        for tick in (0..ticks).step_by(every) {
            let t = 1e-3 * f32::from(tick);
            let motion = [2.0 - 0.5 * t, 9.0 - 4.5 * t * t, -9.0 * t];
            let readings = motion.map(|x| x + noise());
            meter.push(readings, 1e-3 * every as f32);
            meter.push_in_flight([0, 1, 2].map(|i: usize| readings[i] - motion[i]));
        }
        meter.variance().map(libm::sqrtf)
    }

    #[test]
    fn the_deviation_of_white_noise_is_measured_whatever_the_motion() {
        for deviation in [1e-3_f32, 0.2, 5.0] {
            for every in [1, 3] {
                let mut random = Random::new();
                for found in measured(1_500, every, || deviation * random.normal()) {
                    let ratio = found / deviation;
                    assert!((0.8..1.25).contains(&ratio), "{found} for {deviation}");
                }
            }
        }
        assert!(measured(1_500, 1, || 0.0).iter().all(|&found| found < 1e-4));
    }

    #[test]
    fn noise_that_is_correlated_over_20_ms_counts_as_white_noise_of_the_same_power() {
        let (deviation, keeps) = (0.3, libm::expf(-1.0 / 20.0));
        let mut random = Random::new();
        let mut state = [0.0; CHANNELS];
        let mut channel = 0;
        let found = measured(10_000, 1, || {
            channel = (channel + 1) % CHANNELS;
            let step = libm::sqrtf(1.0 - keeps * keeps) * deviation * random.normal();
            state[channel] = keeps * state[channel] + step;
            state[channel]
        });
        // White noise of the same power at low frequencies: (1 + keeps) / (1 - keeps).
        let white = deviation * libm::sqrtf((1.0 + keeps) / (1.0 - keeps));
        for found in found {
            assert!((0.4 * white..1.5 * white).contains(&found), "{found} for {white}");
        }
    }

    #[test]
    fn a_single_reading_far_off_hardly_counts() {
        let mut random = Random::new();
        let mut meter = NoiseMeter::new(1_000_000, [0.0; CHANNELS]);
        for tick in 0..1_000 {
            let vx = if (700..703).contains(&tick) { 40.0 } else { 0.1 * random.normal() };
            meter.push([vx, 0.0, 0.0], 1e-3);
            let deviation = libm::sqrtf(meter.variance()[0]);
            assert!(tick < 300 || (0.08..0.13).contains(&deviation), "{deviation} in {tick}");
        }
    }

    #[test]
    fn a_missing_reading_leaves_the_other_channels_measured() {
        let mut random = Random::new();
        let mut meter = NoiseMeter::new(1_000_000, [0.0; CHANNELS]);
        for tick in 0..900 {
            let y = if tick % 3 == 0 { f32::NAN } else { random.normal() };
            meter.push([random.normal(), y, random.normal()], 1e-3);
        }
        let [vx, y, vy] = meter.variance();
        assert!((vx - 1.0).abs() < 0.4 && (vy - 1.0).abs() < 0.4, "{vx}, {vy}");
        assert_eq!(y, 0.0, "no three in a row");
        assert!(!meter.has_compared(1), "not in every channel");
    }
}
