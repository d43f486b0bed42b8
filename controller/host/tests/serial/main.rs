//! Tests of the serial protocol, with flash in memory.

#[path = "../../src/fixture.rs"]
#[allow(dead_code)]
mod fixture;
mod frame;
mod handler;
mod node;
mod power;
mod rig;
mod spec;
