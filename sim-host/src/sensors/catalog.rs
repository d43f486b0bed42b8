//! The table of all figures: the values of a good part, their ranges and their sources.

use super::figure::{Figure, Quantity, Sensor};
use super::profile::SensorProfile;

/// A row of the table: a figure as a good part has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) figure: Figure,
    /// The value in each profile that has the sensor, unless the profile states its own.
    pub(super) value: f64,
    /// The largest value; the least is 0.
    pub(super) most: f64,
    /// Where the value comes from.
    pub(super) source: &'static str,
}

/// A rate above that of every run: the sensor reads at every tick.
pub(super) const EVERY_TICK_HZ: f64 = 20_000.0;
/// Standard gravity, for data sheets in g, m/s2.
const G: f64 = 9.806_65;
const DEGREE: f64 = std::f64::consts::PI / 180.0;
const TURN: f64 = 2.0 * std::f64::consts::PI;

const NONE: &str = "none";
const EXACT: &str = "exact";
const ABSENT: &str = "absent unless the profile has it";
const CHOSEN: &str = "chosen";

/// Largest latency and largest jitter, s: an age is at most 2^32 ns.
const MOST_DELAY_S: f64 = 2.0;

const fn row(
    sensor: Sensor,
    quantity: Quantity,
    value: f64,
    most: f64,
    source: &'static str,
) -> Row {
    Row { figure: Figure { sensor, quantity }, value, most, source }
}

/// The figures by sensor. A sensor has only those figures that are in this table.
#[rustfmt::skip]
pub(super) const TABLE: &[Row] = {
    use Quantity::{
        Bias, Bounce, Chatter, Dropout, Jitter, Latency, MinDensity, Noise, NoiseShare, Range,
        Rate, Resolution, Scale, Surface, Uniform, Walk,
    };
    use Sensor::{
        Accelerometer, Contact, Gyro, Height, LegAngle, LegLength, Pitch, Pressure, Sample, State,
        Velocity,
    };
    &[
        row(Sample, Latency, 0.0, MOST_DELAY_S, NONE),

        row(State, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(State, Latency, 0.0, MOST_DELAY_S, EXACT),
        row(State, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(State, Dropout, 0.0, 1.0, NONE),
        row(State, Noise, 0.0, 100.0, EXACT),
        row(State, Uniform, 0.0, 100.0, EXACT),
        row(State, Bias, 0.0, 100.0, EXACT),
        row(State, Walk, 0.0, 100.0, EXACT),
        row(State, Scale, 0.0, 1.0, EXACT),
        row(State, Resolution, 0.0, 100.0, EXACT),
        row(State, Range, 0.0, 1e6, NONE),

        row(Contact, Rate, EVERY_TICK_HZ, EVERY_TICK_HZ, "every tick; 0: no switch"),
        row(Contact, Latency, 0.001, MOST_DELAY_S, "chosen: 1 to 3 ms with the jitter; unknown to the controller"),
        row(Contact, Jitter, 0.002, MOST_DELAY_S, "chosen, drawn for each edge"),
        row(Contact, Bounce, 0.0062, 1.0, "Ganssle, A Guide to Debouncing: of 16 switches 6200 us at most"),
        row(Contact, Chatter, 0.0, 1000.0, NONE),

        row(LegLength, Rate, EVERY_TICK_HZ, EVERY_TICK_HZ, "every tick"),
        row(LegLength, Latency, 0.0, MOST_DELAY_S, NONE),
        row(LegLength, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(LegLength, Dropout, 0.0, 1.0, NONE),
        row(LegLength, Noise, 0.001, 10.0, "chosen: 1 mm"),
        row(LegLength, Bias, 0.0, 10.0, "chosen: calibrated"),
        row(LegLength, Walk, 0.0, 10.0, "chosen: calibrated"),
        row(LegLength, Scale, 0.0, 1.0, "chosen: calibrated"),
        row(LegLength, Resolution, 0.0, 1.0, "chosen: below the noise"),
        row(LegLength, Range, 0.0, 100.0, NONE),

        row(LegAngle, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(LegAngle, Latency, 0.0, MOST_DELAY_S, NONE),
        row(LegAngle, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(LegAngle, Dropout, 0.0, 1.0, NONE),
        row(LegAngle, Noise, 0.0, 10.0, "chosen: averaged over a tick; ams AS5048A: 0.06 degrees rms at most, 11,000 times a second"),
        row(LegAngle, Bias, 0.0, 3.2, "chosen: calibrated"),
        row(LegAngle, Walk, 0.0, 1.0, "chosen: calibrated"),
        row(LegAngle, Scale, 0.0, 1.0, "chosen: calibrated"),
        row(LegAngle, Resolution, TURN / 16_384.0, 3.2, "ams AS5048A data sheet: 14 bit over a turn"),
        row(LegAngle, Range, 0.0, 100.0, NONE),

        row(Accelerometer, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Accelerometer, Latency, 0.0, MOST_DELAY_S, NONE),
        row(Accelerometer, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(Accelerometer, Dropout, 0.0, 1.0, NONE),
        row(Accelerometer, Noise, 175e-6 * G, 1.0, "Bosch BMI088 data sheet: 160 ug/sqrt(Hz) in x and y, 190 in z; product page: 175"),
        row(Accelerometer, Bias, 0.02 * G, 100.0, "Bosch BMI088 data sheet: zero-g offset of 20 mg"),
        row(Accelerometer, Walk, 0.001, 100.0, CHOSEN),
        row(Accelerometer, Scale, 0.005, 1.0, "chosen: 0.5 %"),
        row(Accelerometer, Resolution, 24.0 * G / 32_768.0, 100.0, "Bosch BMI088 data sheet: 16 bit over 24 g on both sides"),
        row(Accelerometer, Range, 24.0 * G, 1e6, "Bosch BMI088 data sheet: 24 g"),

        row(Gyro, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Gyro, Latency, 0.0, MOST_DELAY_S, NONE),
        row(Gyro, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(Gyro, Dropout, 0.0, 1.0, NONE),
        row(Gyro, Noise, 0.014 * DEGREE, 1.0, "Bosch BMI088 data sheet: 0.014 dps/sqrt(Hz)"),
        row(Gyro, Bias, 1.0 * DEGREE, 10.0, "Bosch BMI088 data sheet: zero-rate offset of 1 dps"),
        row(Gyro, Walk, 1e-5, 1.0, CHOSEN),
        row(Gyro, Scale, 0.01, 1.0, "chosen: 1 %"),
        row(Gyro, Resolution, 2000.0 * DEGREE / 32_768.0, 10.0, "Bosch BMI088 data sheet: 16 bit over 2000 dps on both sides"),
        row(Gyro, Range, 2000.0 * DEGREE, 1e6, "Bosch BMI088 data sheet: 2000 dps"),

        row(Pitch, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Pitch, Latency, 0.0, MOST_DELAY_S, NONE),
        row(Pitch, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(Pitch, Dropout, 0.0, 1.0, NONE),
        row(Pitch, Noise, 0.0, 3.2, "chosen: filtered by the attitude reference"),
        row(Pitch, Bias, 0.01, 3.2, "chosen: 0.6 degrees, constant over a run"),
        row(Pitch, Walk, 0.0002, 1.0, "chosen: 0.2 degrees in five minutes"),

        row(Velocity, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Velocity, Latency, 0.1, MOST_DELAY_S, "chosen: about one ping"),
        row(Velocity, Jitter, 0.02, MOST_DELAY_S, CHOSEN),
        row(Velocity, Dropout, 0.02, 1.0, CHOSEN),
        row(Velocity, Noise, 0.01, 10.0, CHOSEN),
        row(Velocity, NoiseShare, 0.01, 1.0, "chosen: 1 % of the speed"),
        row(Velocity, Bias, 0.001, 10.0, "Water Linked documentation, DVL A50: long-term accuracy of 0.1 cm/s"),
        row(Velocity, Scale, 0.01, 1.0, "chosen: 1 %, as by the speed of sound"),
        row(Velocity, Resolution, 0.0, 10.0, "chosen: below the noise"),
        row(Velocity, Range, 0.0, 1e6, NONE),
        row(Velocity, MinDensity, 0.5, 2.0, "chosen: acoustic, needs water"),

        row(Height, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Height, Latency, 0.05, MOST_DELAY_S, CHOSEN),
        row(Height, Jitter, 0.01, MOST_DELAY_S, CHOSEN),
        row(Height, Dropout, 0.02, 1.0, CHOSEN),
        row(Height, Noise, 0.01, 100.0, CHOSEN),
        row(Height, NoiseShare, 0.0, 1.0, CHOSEN),
        row(Height, Bias, 0.0, 100.0, CHOSEN),
        row(Height, Scale, 0.01, 1.0, "chosen: 1 %, as by the speed of sound"),
        row(Height, Resolution, 0.0, 10.0, "chosen: below the noise"),
        row(Height, Range, 0.0, 1e6, NONE),
        row(Height, MinDensity, 0.5, 2.0, "chosen: acoustic, needs water"),

        row(Pressure, Rate, 0.0, EVERY_TICK_HZ, ABSENT),
        row(Pressure, Latency, 0.02, MOST_DELAY_S, "TE MS5837-30BA data sheet: conversion of 18 ms at the finest setting, rounded up"),
        row(Pressure, Jitter, 0.0, MOST_DELAY_S, NONE),
        row(Pressure, Dropout, 0.0, 1.0, NONE),
        row(Pressure, Noise, 20.0, 1e6, "TE MS5837-30BA data sheet: resolution of 0.2 mbar"),
        row(Pressure, Bias, 5000.0, 1e6, "TE MS5837-30BA data sheet: accuracy of 50 mbar up to 6 bar"),
        row(Pressure, Walk, 2.0, 1e6, CHOSEN),
        row(Pressure, Scale, 0.0, 1.0, "in the bias"),
        row(Pressure, Resolution, 10.0, 1e6, "TE MS5837-30BA data sheet: reports 0.1 mbar"),
        row(Pressure, Range, 3e6, 1e9, "TE MS5837-30BA data sheet: 30 bar"),
        row(Pressure, Surface, 10.0, 1e4, "chosen: 10 m above level 0"),
    ]
};

/// Returns the number of a figure's row.
pub(super) fn index(sensor: Sensor, quantity: Quantity) -> Option<usize> {
    TABLE.iter().position(|row| row.figure == Figure { sensor, quantity })
}

/// Returns the number of the row with this name.
pub(super) fn named(name: &str) -> Option<usize> {
    TABLE.iter().position(|row| row.figure.to_string() == name)
}

/// The values of all figures in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures([f64; TABLE.len()]);

impl Figures {
    /// Returns the figures of a profile.
    #[must_use]
    pub fn of_profile(profile: SensorProfile) -> Self {
        let mut values = [0.0; TABLE.len()];
        for (value, row) in values.iter_mut().zip(TABLE) {
            *value = row.value;
        }
        let mut figures = Self(values);
        for own in profile.own_figures() {
            figures.set(own.figure.sensor, own.figure.quantity, own.value);
        }
        figures
    }

    /// Returns a figure; 0 for one that the sensor does not have.
    #[must_use]
    pub fn of(&self, sensor: Sensor, quantity: Quantity) -> f64 {
        index(sensor, quantity).map_or(0.0, |row| self.0[row])
    }

    /// Returns whether the leg has this sensor: whether its rate, if it has one, is above 0.
    #[must_use]
    pub fn has(&self, sensor: Sensor) -> bool {
        index(sensor, Quantity::Rate).is_none_or(|row| self.0[row] > 0.0)
    }

    fn set(&mut self, sensor: Sensor, quantity: Quantity, value: f64) {
        let row = index(sensor, quantity).expect("a profile states figures of the table");
        self.set_row(row, value);
    }

    pub(super) fn set_row(&mut self, row: usize, value: f64) {
        self.0[row] = value;
    }
}
