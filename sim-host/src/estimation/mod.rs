//! What the state estimator is good for: seeded runs with noisy, late and lost readings, in
//! each medium, with and without it.
//!
//! Each [`Case`] is a set of faults with a goal. A run counts as hopping if the
//! leg passes the case's number of apexes without a fall; shares come with Wilson's 95 %
//! interval (Wilson, JASA 22, 1927). Beside the share, each row has what the estimate is
//! worth: the root mean square of the error at the apex, the mean square of the innovations
//! of the vertical velocity in standard deviations (1 for a consistent filter), and how many
//! apexes had another number of decisions than one.

pub mod cases;
pub mod report;
mod run;

pub use cases::{CASES, Case};
pub use report::{Report, Row};
pub use run::{Size, study};
