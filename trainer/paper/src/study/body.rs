//! Other bodies: the plane of masses and springs that figures 11, 12 and beyond
//! are drawn over.

use std::ops::Range;

use leg_plant::{Hopper, Medium};
use rayon::prelude::*;

use super::flown::other_leg;
use crate::Extent;
use crate::picture::{Axis, Mark, Panel};

/// The plane: dry mass, kg, and stiffness, kN/m.
pub(crate) const MASS_KG: Range<f64> = 30.0..130.0;
pub(crate) const STIFFNESS_KN_M: Range<f64> = 2.5..42.5;

/// Equal cells over the plane; bodies at their middles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Cells each way.
    pub(crate) cells: usize,
}

impl Plane {
    pub(crate) fn of(extent: Extent) -> Self {
        Self { cells: extent.of(20, 8) }
    }

    /// Mass, kg, and stiffness, N/m, of each cell: row by row, the softest first.
    pub(crate) fn bodies(self) -> Vec<[f64; 2]> {
        let middle = |range: &Range<f64>, i: usize| {
            range.start + (range.end - range.start) * (i as f64 + 0.5) / self.cells as f64
        };
        (0..self.cells)
            .flat_map(|row| (0..self.cells).map(move |column| (row, column)))
            .map(|(row, column)| [middle(&MASS_KG, column), 1e3 * middle(&STIFFNESS_KN_M, row)])
            .collect()
    }

    /// A value for each cell.
    pub(crate) fn map(self, medium: Medium, value: impl Fn(&Hopper) -> f64 + Sync) -> Vec<f64> {
        let bodies = self.bodies();
        bodies
            .into_par_iter()
            .map(|[mass_kg, stiffness_n_m]| value(&other_leg(mass_kg, stiffness_n_m, medium)))
            .collect()
    }

    /// A panel of such values.
    pub(crate) fn panel(
        self,
        title: &str,
        values: Vec<f64>,
        scale: Range<f64>,
        label: &str,
    ) -> Panel {
        let plane = Mark::Cells {
            x: MASS_KG,
            y: STIFFNESS_KN_M,
            columns: self.cells,
            values,
            scale,
            label: label.into(),
        };
        let home = Mark::Dots {
            points: vec![(80.0, 20.0)],
            color: crate::picture::INK,
            radius_px: 4,
            label: Some("the body that was trained".into()),
        };
        Panel {
            title: title.to_owned(),
            x: Axis::new("mass, kg", MASS_KG),
            y: Axis::new("stiffness, kN/m", STIFFNESS_KN_M),
            marks: vec![plane, home],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_lie_row_by_row_and_hold_their_bodies() {
        let plane = Plane { cells: 4 };
        let bodies = plane.bodies();
        assert_eq!(bodies.len(), 16);
        assert_eq!((bodies[0], bodies[3][0], bodies[3][1]), ([42.5, 7_500.0], 117.5, 7_500.0));
        assert_eq!(bodies[15], [117.5, 37_500.0]);
    }
}
