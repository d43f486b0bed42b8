//! The chart of the shore: path, velocity and density along the way.

use std::ops::Range;

use leg_charts::{Axis, DrawError, Mark, Panel, Point, Sheet, color, steps};

use super::track::{LegPose, Track};

/// How far below 0 the ground is drawn, m.
const GROUND_M: f64 = 0.15;
/// Width of a column of one density, m.
const COLUMN_M: f64 = 0.25;

/// Draws a run as SVG text; `density_at` returns the medium's density ratio at
/// a place, m.
///
/// # Errors
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(track: &Track, density_at: impl Fn(f64) -> f64) -> Result<String, DrawError> {
    let x = extent_m(track);
    Sheet::new("Out of the sea: the leg hops through water onto land", "")
        .width_px(1_400)
        .row_to_scale(path(track, &x, &density_at))
        .row(170, vec![velocity(track, &x)])
        .row(200, vec![density(track, &x, &density_at)])
        .draw()
}

/// Returns the places that the chart covers, m.
fn extent_m(track: &Track) -> Range<f64> {
    let xs = || track.path.iter().map(|p| p.0);
    let low = xs().fold(0.0, f64::min).floor() - 0.5;
    let high = xs().fold(1.0, f64::max).ceil() + 0.5;
    low..high
}

fn path(track: &Track, x: &Range<f64>, density_at: &impl Fn(f64) -> f64) -> Panel {
    let ceiling_m = track.path.iter().map(|p| p.1).fold(1.5, f64::max) + 0.3;
    let y = Axis::new("height, m", -GROUND_M..ceiling_m);
    let ground = [(x.start, -GROUND_M), (x.end, 0.0)];
    let mut panel = Panel::new("Path of the mass", Axis::new("", x.clone()), y)
        .with(Mark::shades(vec![ground], color::SAND));
    for (from, to, density) in columns(x, density_at) {
        let shade = color::BLUE.with_opacity(0.42 * density.clamp(0.0, 1.0));
        let water = Mark::shades(vec![[(from, 0.0), (to, ceiling_m)]], shade);
        panel = panel.with(if density >= 1.0 { water.label("water") } else { water });
    }
    for (poses, color, label) in [
        (&track.touchdowns, color::ORANGE, "leg at touchdown"),
        (&track.liftoffs, color::GREEN, "leg at lift-off"),
    ] {
        let leg = |pose: &LegPose| [pose.foot, pose.mass];
        let legs = poses.iter().map(leg).collect();
        let masses = poses.iter().map(|pose| pose.mass).collect();
        panel = panel
            .with(Mark::segments(legs, color.with_opacity(0.8)).label(label))
            .with(Mark::dots(masses, color));
    }
    panel = panel.with(Mark::line(track.path.clone(), color::INK).width_px(1.0));
    match track.fall {
        Some(fall) => {
            panel.with(Mark::crosses(vec![fall], color::RED).radius_px(7.0).label("fall"))
        }
        None => panel,
    }
}

/// Returns columns of one density: from, to, m, and the density ratio. Equal
/// neighbours are one column.
fn columns(x: &Range<f64>, density_at: &impl Fn(f64) -> f64) -> Vec<(f64, f64, f64)> {
    let count = ((x.end - x.start) / COLUMN_M).ceil() as usize;
    let mut columns: Vec<(f64, f64, f64)> = Vec::new();
    for i in 0..count {
        let from = x.start + COLUMN_M * i as f64;
        let to = (from + COLUMN_M).min(x.end);
        let density = density_at(0.5 * (from + to));
        match columns.last_mut() {
            Some((_, end, same)) if *same == density => *end = to,
            _ => columns.push((from, to, density)),
        }
    }
    columns
}

fn velocity(track: &Track, x: &Range<f64>) -> Panel {
    let speeds = || track.apexes.iter().flat_map(|a| [a.vx_m_s, a.set_point_m_s]);
    let low = speeds().fold(0.0, f64::min) - 0.1;
    let high = speeds().fold(0.5, f64::max) + 0.15;
    let set_point = steps(track.apexes.iter().map(|a| (a.x_m, a.set_point_m_s)));
    let measured: Vec<Point> = track.apexes.iter().map(|a| (a.x_m, a.vx_m_s)).collect();
    Panel::new("Velocity", Axis::new("", x.clone()), Axis::new("velocity, m/s", low..high))
        .with(Mark::line(set_point, color::ORANGE).label("set-point"))
        .with(Mark::dots(measured, color::INK).label("at each apex"))
}

fn density(track: &Track, x: &Range<f64>, density_at: &impl Fn(f64) -> f64) -> Panel {
    let samples = 600;
    let at = |i: usize| x.start + (x.end - x.start) * i as f64 / samples as f64;
    let truth = (0..=samples).map(|i| (at(i), density_at(at(i)))).collect();
    let estimates = track.apexes.iter().map(|a| (a.x_m, a.density_estimate)).collect();
    let (x, y) = (Axis::new("distance, m", x.clone()), Axis::new("density ratio", -0.05..1.1));
    Panel::new("Density of the medium over that of water", x, y)
        .with(Mark::area(truth, 0.0, color::BLUE).label("true"))
        .with(Mark::dots(estimates, color::INK).label("estimated at each apex"))
}

#[cfg(test)]
mod tests {
    use super::super::track::ApexMark;
    use super::*;

    #[test]
    fn draws_every_mark_of_the_run() {
        let pose = |x: f64| LegPose { foot: (x, 0.0), mass: (x + 0.2, 0.98) };
        let apex = |x: f64| ApexMark {
            t_s: x,
            x_m: x,
            y_m: 2.0,
            vx_m_s: 0.5,
            set_point_m_s: 0.5,
            density_ratio: 1.0,
            density_estimate: 0.99,
        };
        let track = Track {
            path: (0..400).map(|i| (0.1 * f64::from(i), 1.5)).collect(),
            touchdowns: (0..7).map(|i| pose(f64::from(i))).collect(),
            liftoffs: (0..5).map(|i| pose(f64::from(i) + 0.5)).collect(),
            apexes: (0..6).map(|i| apex(f64::from(i))).collect(),
            fall: None,
        };
        let svg = draw(&track, |x| if x < 15.0 { 1.0 } else { 0.0 }).unwrap();
        // A dot for each mass, each apex velocity and each density estimate, and two
        // in the legends.
        assert_eq!(svg.matches("<circle").count(), 7 + 5 + 6 + 6 + 2);
        assert!(svg.contains("density ratio") && svg.contains("velocity, m/s"));
    }
}
