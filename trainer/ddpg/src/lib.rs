//! Deep deterministic policy gradient (DDPG) for the leg: the networks, the replay buffer, and the
//! agent with its update.
//!
//! [`agent`] creates an agent of one of the [`Shape`]s. Each shape is compiled for each
//! instruction set, here and nowhere else, because that takes the compiler longer than the rest of
//! the trainer.

// Code that is generic over the instruction set must be inlined into the function that is
// compiled for it, else it uses the baseline.
#![allow(clippy::inline_always, reason = "see `leg_simd`")]

mod agent;
mod net;
mod replay;
mod shape;

pub use agent::{ACTOR_HIDDEN, Agent, AgentState, Rates, UnitOutput, Update};
pub use net::mlp::Layer;
pub use replay::{Replay, ReplayState, Transition};
pub use shape::{BATCHES, Critic, Shape, agent};
