//! Charts and table of the landscapes: the planes of the first starts, and the statistics
//! of all starts.

use std::fmt::Write as _;

use super::landscape::{Objective, Plane, Transition, bounds, hops, mean_over, starts};
use crate::{Extent, FiguresError};
use leg_charts::color::SERIES;
use leg_charts::{Axis, Mark, Panel, Sheet};

/// Density ratios that are drawn, from water to air.
const DRAWN: [f64; 6] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0];
/// Rewards at the ends of the scale; a reward of 2 is a step within 1 cm/s.
const SCALE: std::ops::Range<f64> = 0.0..2.0;
/// Number of panels in a row.
const ACROSS: usize = 3;

/// Returns SVG and CSV: the planes of the objective, and the statistics of its transitions
/// beside those of another objective.
pub(crate) fn draw_with_table(
    title: &str,
    extent: Extent,
    objective: &Objective,
    own: (&str, &[Transition]),
    other: (&str, &[Transition]),
) -> Result<(String, String), FiguresError> {
    let plane = extent.of(Plane { angles: 90, speeds: 24 }, Plane { angles: 48, speeds: 12 });
    let mut csv = String::from("quantity,start,density_ratio,alpha_rad,rs_m_s,value\n");
    let mut panels = Vec::new();
    for (i, start) in starts(extent.of(3, 2)).into_iter().enumerate() {
        for density in DRAWN {
            let rewards = objective.rewards(&hops(plane, start, density), plane, density);
            for (action, reward) in plane.actions().zip(&rewards) {
                let (alpha, rs) = (action.touchdown_angle_rad, action.elongation_speed_m_s);
                let _ = writeln!(csv, "reward,{i},{density},{alpha:.5},{rs:.4},{reward:.4}");
            }
            let [alpha, rs] = bounds();
            panels.push(Panel {
                title: format!("ρ = {density}; start {:.2} m/s, {:.2} m", start.vx_m_s, start.y_m),
                x: Axis::new("elongation speed, m/s", rs.clone()),
                y: Axis::new("touchdown angle, rad", alpha.clone()),
                marks: vec![Mark::cells((rs, alpha), plane.speeds, rewards, SCALE, "reward")],
            });
        }
    }
    let mut rows: Vec<Vec<Panel>> = panels.chunks(ACROSS).map(<[Panel]>::to_vec).collect();
    rows.push(statistics(own, other));
    for (name, transitions) in [own, other] {
        for (i, transition) in transitions.iter().enumerate() {
            write_statistics(&mut csv, name, i, transition);
        }
    }
    let note = "reward of one step for every action; a fall has no reward; last row: means over all starts";
    Ok((Sheet::new(title, note).rows(170, rows).draw()?, csv))
}

fn statistics(own: (&str, &[Transition]), other: (&str, &[Transition])) -> Vec<Panel> {
    type Statistic = fn(&Transition, usize) -> f64;
    let kinds: [(&str, Statistic, bool); 3] = [
        ("share of actions with a high reward", |t, i| t.stats[i].high, false),
        ("change of the reward to the next density", |t, i| t.changes[i], true),
        ("correlation with the next density", |t, i| t.correlations[i], true),
    ];
    let panel = |(title, number, between): (&str, Statistic, bool)| {
        let curves = [own, other].map(|(name, transitions)| {
            let grid = &transitions[0].densities;
            let points: Vec<(f64, f64)> = (0..grid.len() - usize::from(between))
                .map(|i| {
                    let at = if between { f64::midpoint(grid[i], grid[i + 1]) } else { grid[i] };
                    (at, mean_over(transitions, |t| number(t, i)))
                })
                .collect();
            (name, points)
        });
        let values = curves.iter().flat_map(|(_, points)| points.iter().map(|(_, y)| *y));
        let y = Axis::around("", values);
        let marks = curves.into_iter().zip(SERIES);
        Panel {
            title: title.to_owned(),
            x: Axis::new("density ratio (1 water, 0 air)", 0.0..1.0),
            y,
            marks: marks
                .map(|((name, points), color)| Mark::line(points, color).label(name))
                .collect(),
        }
    };
    kinds.map(panel).into()
}

fn write_statistics(csv: &mut String, name: &str, start: usize, transition: &Transition) {
    // The name without the note on the figure.
    let name = name.split(',').next().unwrap_or(name).replace(' ', "_");
    for (i, (density, look)) in transition.densities.iter().zip(&transition.stats).enumerate() {
        let mut row = |quantity: &str, value: f64| {
            let _ = writeln!(csv, "{name}:{quantity},{start},{density:.2},,,{value}");
        };
        row("high_share", look.high);
        row("pieces", look.pieces);
        row("largest_piece_share", look.largest);
        row("slope_per_0.1_rad", look.slope);
        row("variance_by_angle", look.by_angle);
        if let (Some(change), Some(correlations)) =
            (transition.changes.get(i), transition.correlations.get(i))
        {
            row("change_to_next", *change);
            row("correlation_with_next", *correlations);
        }
    }
}
