//! The robustness of a policy: a sweep of seeded runs under increasing levels of one fault at a time,
//! in each medium; and two sweeps side by side.

mod axes;
pub mod compare;
pub mod picture;
pub mod report;
mod sweep;

pub use axes::Media;
pub use compare::Comparison;
pub use report::{Report, Row};
pub use sweep::{Size, sweep};

/// Apexes after which a leg counts as still hopping.
pub const HOPS: u32 = 30;
