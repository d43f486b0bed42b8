//! Models of the leg's sensors: what they make of the true state.
//!
//! A leg has the sensors of a [`SensorProfile`], of which each figure can be set by name. The
//! table in `catalog.rs` has the figures with their sources, `channel.rs` the errors of a reading
//! (noise, bias, scale, clipping, quantisation), `delivery.rs` its way into a sample (rate,
//! latency, jitter, dropouts); `accelerometer.rs` and `contact.rs` have what only these have.
//!
//! Every channel draws from a generator of its own, seeded by the run's seed. A run is therefore
//! reproducible, and the faults of a run draw the same with other sensors.
//!
//! # Add a figure or a sensor
//!
//! A figure that a sensor does not have yet is a row of the table. A sensor is a [`Sensor`], its
//! rows, its channels in `models.rs`, and in the profiles that have it, its rate.

mod accelerometer;
mod catalog;
mod channel;
mod contact;
mod delivery;
mod figure;
mod listing;
mod models;
mod profile;
mod setting;
mod stated;

pub use catalog::Figures;
pub use figure::{Figure, Quantity, Sensor};
pub use listing::{Listing, help};
pub use models::{SensorModels, Truth};
pub use profile::SensorProfile;
pub(crate) use setting::as_table;
pub use setting::{SensorError, SensorSetting};

use crate::faults::stage::FaultRng;

/// Returns the generator of a channel, number `lane` of its sensor.
fn rng(seed: u64, sensor: Sensor, lane: u64) -> FaultRng {
    // Faults count their generators from 0.
    const FIRST: u64 = 1 << 40;
    FaultRng::new(seed, FIRST + 8 * sensor as u64 + lane)
}

#[cfg(test)]
mod tests;
