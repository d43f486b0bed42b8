//! The comparison of an imported actor with the actions of the framework that trained it.

use crate::cli::{Failure, columns, input};
use anyhow::{Context, anyhow};
use leg_control::actor::{Actor, Observation};
use std::path::Path;

/// Largest difference that is allowed by default, rad and m/s. Libraries that sum in their own
/// order differ by some 1e-6; a wrong activation or scaling by 1e-2 and more.
pub(super) const TOLERANCE: f64 = 1e-4;
const COLUMNS: [&str; 5] = ["vx", "y", "rho", "alpha", "rs"];

/// Compares the actor with every row of a CSV file, and returns a line about it.
///
/// # Errors
/// [`Failure::Input`] when an action differs by more than `tolerance`, and when there is no row.
pub(super) fn check(actor: &Actor<'_>, path: &Path, tolerance: f64) -> Result<String, Failure> {
    let name = path.display();
    let source = std::fs::read(path).with_context(|| name.to_string()).map_err(input)?;
    let rows = columns::read(&source, &name.to_string(), COLUMNS)?;
    let mut differing = 0;
    let mut worst: Option<(f64, usize, [f32; 2], [f32; 2])> = None;
    for &(line, [apex_vx_m_s, apex_y_m, density_ratio, alpha, rs]) in &rows {
        let action = actor.act(Observation { apex_vx_m_s, apex_y_m, density_ratio });
        let found = [action.touchdown_angle_rad, action.elongation_speed_m_s];
        let expected = [alpha, rs];
        let off = [0, 1].map(|i| (f64::from(found[i]) - f64::from(expected[i])).abs());
        let off = off[0].max(off[1]);
        differing += usize::from(off > tolerance);
        if worst.is_none_or(|(most, ..)| off > most) {
            worst = Some((off, line, expected, found));
        }
    }
    let Some((most, line, expected, found)) = worst else {
        let what = "no row to compare with; give observations and actions";
        return Err(input(anyhow!("--check: {name}: {what}")));
    };
    let count = rows.len();
    if differing == 0 {
        return Ok(format!(
            "Checked: {count} actions of {name} are the same within {tolerance:e} rad and m/s, at \
             most {most:.1e} apart"
        ));
    }
    let of = |[alpha, rs]: [f32; 2]| format!("alpha {alpha:.6} rad and rs {rs:.6} m/s");
    Err(input(anyhow!(
        "--check: {name}: {differing} of {count} actions differ by more than {tolerance:e} (rad, \
         m/s). In line {line} it has {}, the imported actor gives {}. Nothing was written; check \
         the activations, the scalings and the order of the layers",
        of(expected),
        of(found)
    )))
}
