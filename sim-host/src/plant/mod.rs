//! The spring-legged hopper (SLIP/USLIP) in any medium.

mod apex;
mod flight;
mod leg;
mod medium;
mod polynomial;
mod stance;
mod taylor;

pub use apex::{
    Action, Apex, Hop, Hopper, LONGEST_SWIM_S, MOST_STANCES, NextApex, Outcome, Tolerance,
    Touchdown,
};
pub use leg::{EARTH_GRAVITY_M_S2, Leg, LegParameters, ParameterError, REFERENCE_DENSITY_KG_M3};
pub use medium::Medium;
