//! Actors and environments shared with other programs.

mod c;
mod c_firmware;
mod exchange;
mod import;
mod python;
