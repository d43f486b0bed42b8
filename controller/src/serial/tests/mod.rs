//! Tests of the station, with flash in memory.

mod desk;
mod frame;
mod pilot;
mod power;
mod rig;
mod spec;
