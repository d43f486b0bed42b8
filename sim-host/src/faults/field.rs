//! The readings by the names that users type.

use crate::faults::stage::sensor::{Reading, SensorTarget};
use crate::sensors::Sensor;

/// The sum of the accelerometer.
pub(super) const ACCELERATION: &[Reading] = &[Reading::ImpulseX, Reading::ImpulseY];

/// The fields that users name, with the sensor (of the density, the setting of the run) and the
/// readings.
pub(super) const FIELDS: [(&str, Option<Sensor>, SensorTarget); 13] = {
    use SensorTarget::{Contact, Readings};
    [
        ("vx", Some(Sensor::State), Readings(&[Reading::Vx])),
        ("y", Some(Sensor::State), Readings(&[Reading::Y])),
        ("vy", Some(Sensor::State), Readings(&[Reading::Vy])),
        ("leg-length", Some(Sensor::LegLength), Readings(&[Reading::LegLength])),
        ("leg-angle", Some(Sensor::LegAngle), Readings(&[Reading::LegAngle])),
        ("acceleration", Some(Sensor::Accelerometer), Readings(ACCELERATION)),
        ("pitch", Some(Sensor::Pitch), Readings(&[Reading::Pitch])),
        ("pitch-rate", Some(Sensor::Gyro), Readings(&[Reading::PitchRate])),
        ("velocity", Some(Sensor::Velocity), Readings(&[Reading::VelocityX, Reading::VelocityY])),
        ("height", Some(Sensor::Height), Readings(&[Reading::Height])),
        ("pressure", Some(Sensor::Pressure), Readings(&[Reading::Pressure])),
        ("density", None, Readings(&[Reading::Density])),
        ("contact", Some(Sensor::Contact), Contact),
    ]
};

/// Returns the largest noise and bias of a reading.
pub(super) fn most(readings: &[Reading]) -> f64 {
    if readings.contains(&Reading::Pressure) { 1e6 } else { 100.0 }
}
