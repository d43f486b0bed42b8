//! How much of each fault a policy stands: a sweep of seeded runs, one fault at
//! a time, in each medium.

pub mod picture;
pub mod report;
mod sweep;

pub use report::{Report, Row};
pub use sweep::{Media, Size, sweep};

/// Apexes after which a leg counts as still hopping.
pub const HOPS: u32 = 30;
