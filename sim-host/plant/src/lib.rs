#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![allow(
    clippy::inline_always,
    reason = "what is inlined is compiled for the instruction set of a vector"
)]

#[cfg(test)]
extern crate std;

mod apex;
mod contact;
mod elongation;
mod flight;
mod ground;
#[doc(hidden)]
pub mod lanes;
mod leg;
mod losses;
mod medium;
mod pair;
mod real;
mod roots;
mod stance;
mod taylor;
mod tick;

pub use apex::{
    Action, Apex, Hop, Hopper, MAX_FLIGHT_S, MAX_STANCES, NextApex, Outcome, Tolerance, Touchdown,
};
pub use ground::{Flat, Ground};
pub use leg::{EARTH_GRAVITY_M_S2, Leg, LegParameters, ParameterError, REFERENCE_DENSITY_KG_M3};
pub use losses::Losses;
pub use medium::Medium;
pub use tick::{Body, Event, EventKind, LegCommand, Phase, TickEvents, TickPlant};
