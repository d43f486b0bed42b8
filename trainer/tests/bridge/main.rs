//! Actors and environments shared with other programs.

mod activations;
mod c;
mod c_firmware;
mod exchange;
mod import;
mod python;
