//! Other bodies: the plane of masses and stiffnesses of figures 11, 12 and beyond.

use std::ops::Range;

use leg_plant::{Hopper, Medium};
use rayon::prelude::*;

use super::apex_run::leg_with;
use crate::Extent;
use leg_charts::{Axis, Mark, Panel, color};

/// Dry masses of the plane, kg.
pub(crate) const MASS_KG: Range<f64> = 30.0..130.0;
/// Spring stiffnesses of the plane, kN/m.
pub(crate) const STIFFNESS_KN_M: Range<f64> = 2.5..42.5;

/// A grid of equal cells over the plane. A body stands at the middle of each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Number of cells across, and up.
    pub(crate) cells: usize,
}

impl Plane {
    pub(crate) fn of(extent: Extent) -> Self {
        Self { cells: extent.of(20, 8) }
    }

    /// Returns mass, kg, and stiffness, N/m, of each cell: row by row, the softest first.
    pub(crate) fn bodies(self) -> Vec<[f64; 2]> {
        let middle = |range: &Range<f64>, i: usize| {
            range.start + (range.end - range.start) * (i as f64 + 0.5) / self.cells as f64
        };
        (0..self.cells)
            .flat_map(|row| (0..self.cells).map(move |column| (row, column)))
            .map(|(row, column)| [middle(&MASS_KG, column), 1e3 * middle(&STIFFNESS_KN_M, row)])
            .collect()
    }

    /// Computes a value for each cell, in parallel.
    pub(crate) fn map(self, medium: Medium, value: impl Fn(&Hopper) -> f64 + Sync) -> Vec<f64> {
        let bodies = self.bodies();
        bodies
            .into_par_iter()
            .map(|[mass_kg, stiffness_n_m]| value(&leg_with(mass_kg, stiffness_n_m, medium)))
            .collect()
    }

    /// Returns a panel that shows a value for each cell.
    pub(crate) fn panel(
        self,
        title: &str,
        values: Vec<f64>,
        scale: Range<f64>,
        label: &str,
    ) -> Panel {
        let (x, y) = (Axis::new("mass, kg", MASS_KG), Axis::new("stiffness, kN/m", STIFFNESS_KN_M));
        let trained = Mark::dots(vec![(80.0, 20.0)], color::INK).radius_px(4.0);
        Panel::new(title, x, y)
            .with(Mark::cells((MASS_KG, STIFFNESS_KN_M), self.cells, values, scale, label))
            .with(trained.label("the body that was trained"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_bodies_row_by_row_at_the_middles_of_the_cells() {
        let plane = Plane { cells: 4 };
        let bodies = plane.bodies();
        assert_eq!(bodies.len(), 16);
        assert_eq!((bodies[0], bodies[3][0], bodies[3][1]), ([42.5, 7_500.0], 117.5, 7_500.0));
        assert_eq!(bodies[15], [117.5, 37_500.0]);
    }
}
