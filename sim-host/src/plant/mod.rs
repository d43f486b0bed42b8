//! The spring-legged hopper (SLIP/USLIP) in any medium.

mod apex;
mod elongation;
mod flight;
mod ground;
mod leg;
mod medium;
mod pair;
mod roots;
mod stance;
mod taylor;
mod tick;

pub use apex::{
    Action, Apex, Hop, Hopper, LONGEST_SWIM_S, MOST_STANCES, NextApex, Outcome, Tolerance,
    Touchdown,
};
pub use ground::{Flat, Ground};
pub use leg::{EARTH_GRAVITY_M_S2, Leg, LegParameters, ParameterError, REFERENCE_DENSITY_KG_M3};
pub use medium::Medium;
pub use tick::{Body, Event, EventKind, LegCommand, Phase, TickEvents, TickPlant};
