//! Faults on purpose: middleware that wraps any link and is a link again.
//!
//! A [`Chain`] is what may befall the messages of one direction: stages in a
//! row, each of which is given at most one message a tick and hands on at most
//! one, as a link that holds one message does. [`message`] has those that know
//! nothing of what is carried (lost, late, twice, damaged), [`sensor`] those of
//! a leg's sensors, [`actuator`] those of its actuators. A [`Plan`] is both
//! directions.
//!
//! [`Faulty`] puts a plan around a link, [`Stepped`] around a control law in
//! this thread. All chance comes from [`Dice`], a generator of its own for each
//! fault: the same seed gives the same faults, bit for bit.

pub mod actuator;
mod chain;
mod dice;
mod link;
pub mod message;
pub mod sensor;
mod stepped;
mod wire;
#[cfg(test)]
mod oldwire;

pub use chain::{Chain, Now, Passed, Plan, Stage, Window};
pub use dice::Dice;
pub use link::Faulty;
pub use stepped::Stepped;
pub use wire::WireMessage;

#[cfg(test)]
mod tests;
