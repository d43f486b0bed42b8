//! Fault injection as middleware around any link.
//!
//! A [`FaultPipeline`] holds the faults of one direction: stages in series, each of which receives
//! at most one message a tick and releases at most one, as a link does that holds one message. A
//! [`FaultPlan`] holds both directions. [`message`] has the faults of the transport (loss, delay,
//! duplication, damage), [`sensor`] those of the leg's sensors and [`actuator`] those of its
//! actuators.
//!
//! [`FaultyLink`] wraps a link; [`SteppedLink`] wraps a control law in this thread. Every fault
//! draws from a [`FaultRng`] of its own, so the same seed gives the same faults, bit for bit.

pub mod actuator;
mod link;
pub mod message;
mod pipeline;
mod reading;
mod rng;
pub mod sensor;
mod stepped;
mod wire;

pub use link::FaultyLink;
pub use pipeline::{FaultPipeline, FaultPlan, FaultStage, Now, Passed, Window};
pub use rng::FaultRng;
pub use stepped::SteppedLink;
pub use wire::WireMessage;

#[cfg(test)]
mod tests;
