//! The leg on the host: its physics, and the sessions that play it to a controller.

pub mod plant;
pub mod shore;
