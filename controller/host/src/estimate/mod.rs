//! The filter of the control law over a log of measurements.
//!
//! ```text
//! CSV, JSON in MCAP -> rows -> ticks ─┐
//! recording ────────────────> ticks ──┴─> control law -> report, CSV, picture
//! ```
//!
//! The whole law runs, as in the controller: guard, estimator, gait. So an estimate has the bits
//! that the controller would have computed of these samples. What the leg did enters the
//! estimate by two of its parts, the angle at which it is held in flight and the elongation of
//! the spring in stance: they are those that the law commands, or those in the log, of a leg that
//! another controller moves.

mod assemble;
pub mod chart;
mod column;
mod csv_rows;
mod json_rows;
mod log;
mod report;
mod row;
mod run;
mod source;

use row::Row;

pub use column::{Column, help as columns};
pub use log::LogError;
pub use report::{ApexRow, Errors, Report};
pub use row::CellError;
pub use run::{Choices, EstimateError, Held, estimate};

/// The true state at a tick, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Horizontal velocity, m/s, height, m, vertical velocity, m/s, and density ratio; NaN where
    /// not known.
    pub values: [f64; 4],
    /// Whether the foot is off the ground.
    pub in_flight: Option<bool>,
}

impl Truth {
    /// Returns the truth with heights over a ground that lies at `ground_m`.
    #[must_use]
    pub fn over(self, ground_m: f64) -> Self {
        let [vx_m_s, y_m, vy_m_s, density_ratio] = self.values;
        Self { values: [vx_m_s, y_m - ground_m, vy_m_s, density_ratio], ..self }
    }

    /// Returns the truth in a row; none if it has none.
    fn of(row: &Row) -> Option<Self> {
        let columns = [Column::TrueVx, Column::TrueY, Column::TrueVy, Column::TrueDensity];
        let values = columns.map(|column| row.get(column).unwrap_or(f64::NAN));
        let in_flight = row.truth(Column::TrueContact).map(|is_loaded| !is_loaded);
        let is_known = in_flight.is_some() || values.iter().any(|value| value.is_finite());
        is_known.then_some(Self { values, in_flight })
    }
}
