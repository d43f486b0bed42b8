//! The leg on the host: its physics, and the sessions that play it to a controller.

pub mod bench;
pub mod bridge;
pub mod cli;
pub mod faults;
pub mod operate;
pub mod plot;
pub mod record;
pub mod replay;
pub mod robustness;
pub mod scenario;
pub mod session;
pub mod shore;
pub mod watch;
