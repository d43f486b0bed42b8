//! Tests of the station, with flash in memory.

mod desk;
#[path = "../../src/fixture.rs"]
#[allow(dead_code)]
mod fixture;
mod frame;
mod pilot;
mod power;
mod rig;
mod spec;
