//! The chart of the shore: path, velocity and density along the way.

use std::ops::Range;

use leg_charts::{Axis, Color, DrawError, Mark, Panel, Point, Sheet, color, steps};

use super::TrackRecorder;
use super::estimates::{BAND, EstimatePoint, Estimated};
use super::track::{LegPose, Track};

/// How far below 0 the ground is drawn, m.
const GROUND_M: f64 = 0.15;
/// Width of a column of one density, m.
const COLUMN_M: f64 = 0.25;
/// Estimates and their bands.
const ESTIMATE: Color = color::SERIES[4];
const BAND_LABEL: &str = "\u{b1}2 standard deviations";

/// Draws a run as SVG text, with a note below its title; `density_at` returns the medium's
/// density ratio at a place, m.
///
/// # Errors
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(
    recorder: &TrackRecorder,
    note: &str,
    density_at: impl Fn(f64) -> f64,
) -> Result<String, DrawError> {
    let (track, estimates) = (recorder.track(), recorder.estimates().points());
    let x = extent_m(track);
    let sheet = Sheet::new("Out of the sea: the leg hops through water onto land", note)
        .width_px(1_400)
        .row_to_scale(path(track, estimates, &x, &density_at))
        .row(170, vec![velocity(track, estimates, &x)])
        .row(170, vec![density(track, estimates, &x, &density_at)]);
    if estimates.is_empty() { sheet.draw() } else { sheet.row(150, errors(estimates)).draw() }
}

/// Returns the places that the chart covers, m.
fn extent_m(track: &Track) -> Range<f64> {
    let xs = || track.path.iter().map(|p| p.0);
    let low = xs().fold(0.0, f64::min).floor() - 0.5;
    let high = xs().fold(1.0, f64::max).ceil() + 0.5;
    low..high
}

fn path(
    track: &Track,
    estimates: &[EstimatePoint],
    x: &Range<f64>,
    density_at: &impl Fn(f64) -> f64,
) -> Panel {
    let ceiling_m = track.path.iter().map(|p| p.1).fold(1.5, f64::max) + 0.3;
    let y = Axis::new("height, m", -GROUND_M..ceiling_m);
    let ground = [(x.start, -GROUND_M), (x.end, 0.0)];
    let heights = y.range.clone();
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
    panel = panel.with(truth(track.path.clone(), estimates));
    panel = with_estimate(panel, &heights, estimates, |estimate| estimate.of.height);
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

fn velocity(track: &Track, estimates: &[EstimatePoint], x: &Range<f64>) -> Panel {
    let speeds = track.velocity.iter().map(|point| point.1);
    let set_points = track.apexes.iter().map(|a| a.set_point_m_s);
    let y = Axis::around("velocity, m/s", speeds.chain(set_points));
    let set_point = steps(track.apexes.iter().map(|a| (a.x_m, a.set_point_m_s)));
    let at_apex: Vec<Point> = track.apexes.iter().map(|a| (a.x_m, a.vx_m_s)).collect();
    let panel = Panel::new("Horizontal velocity", Axis::new("", x.clone()), y.clone());
    let panel = panel.with(truth(track.velocity.clone(), estimates));
    with_estimate(panel, &y.range, estimates, |estimate| estimate.of.velocity)
        .with(Mark::line(set_point, color::ORANGE).label("set-point"))
        .with(Mark::dots(at_apex, color::INK).label("at each apex"))
}

fn density(
    track: &Track,
    estimates: &[EstimatePoint],
    x: &Range<f64>,
    density_at: &impl Fn(f64) -> f64,
) -> Panel {
    let samples = 600;
    let at = |i: usize| x.start + (x.end - x.start) * i as f64 / samples as f64;
    let truth = (0..=samples).map(|i| (at(i), density_at(at(i)))).collect();
    let decided = |apex: &super::track::ApexMark| Some((apex.x_m, apex.decision?.density_ratio));
    let decided = track.apexes.iter().filter_map(decided).collect();
    let (x, y) = (Axis::new("distance, m", x.clone()), Axis::new("density ratio", -0.05..1.1));
    let panel = Panel::new("Density of the medium over that of water", x, y.clone())
        .with(Mark::area(truth, 0.0, color::BLUE).label("true"));
    with_estimate(panel, &y.range, estimates, |estimate| estimate.of.density)
        .with(Mark::dots(decided, color::INK).label("decided by at each apex"))
}

/// Returns the line of a true quantity, wide and faint where the estimate's is drawn over it.
fn truth(line: Vec<Point>, estimates: &[EstimatePoint]) -> Mark {
    let (opacity, width_px) = if estimates.is_empty() { (1.0, 1.0) } else { (0.35, 3.0) };
    Mark::line(line, color::INK.with_opacity(opacity)).width_px(width_px).label("true")
}

/// Adds one quantity of the estimates with its band, cut off at the ends of the axis.
fn with_estimate(
    panel: Panel,
    y: &Range<f64>,
    estimates: &[EstimatePoint],
    of: impl Fn(&EstimatePoint) -> Estimated,
) -> Panel {
    if estimates.is_empty() {
        return panel;
    }
    let cut = |value: f64| value.clamp(y.start, y.end);
    // Over the place a band has no width while the leg falls upright, or returns.
    let mut furthest_m = f64::NEG_INFINITY;
    let (mut band, mut line) = (Vec::new(), Vec::new());
    for estimate in estimates {
        let Estimated { value, deviation, .. } = of(estimate);
        line.push((estimate.x_m, cut(value)));
        if estimate.x_m > furthest_m {
            furthest_m = estimate.x_m;
            let half = BAND * deviation;
            band.push((estimate.x_m, cut(value - half), cut(value + half)));
        }
    }
    panel
        .with(Mark::band(band, ESTIMATE).label(BAND_LABEL))
        .with(Mark::line(line, ESTIMATE).width_px(1.0).label("estimate"))
}

/// Chooses a quantity.
type Of = fn(&EstimatePoint) -> Estimated;

/// Returns a panel for each quantity: estimate less truth, and the band.
fn errors(estimates: &[EstimatePoint]) -> Vec<Panel> {
    let end_s = estimates.last().map_or(1.0, |estimate| estimate.t_s);
    let quantities: [(&str, &str, Of); 3] = [
        ("Velocity: estimate less truth", "error, m/s", |estimate| estimate.of.velocity),
        ("Height: estimate less truth", "error, m", |estimate| estimate.of.height),
        ("Density: estimate less truth", "error in density ratio", |estimate| estimate.of.density),
    ];
    quantities
        .into_iter()
        .map(|(title, label, of)| {
            let one = estimates.iter().map(of);
            let largest = most(one.flat_map(|e| [e.error.abs(), BAND * e.deviation]).collect());
            let y = -1.3 * largest..1.3 * largest;
            let cut = |value: f64| value.clamp(y.start, y.end);
            let line = estimates.iter().map(|e| (e.t_s, cut(of(e).error))).collect();
            let band = estimates.iter().map(|e| {
                let half = cut(BAND * of(e).deviation);
                (e.t_s, -half, half)
            });
            let zero = vec![(0.0, 0.0), (end_s, 0.0)];
            let x = Axis::new("time, s", 0.0..end_s);
            Panel::new(title, x, Axis::new(label, y.clone()))
                .with(Mark::band(band.collect(), ESTIMATE).label(BAND_LABEL))
                .with(Mark::line(zero, color::INK.with_opacity(0.4)).width_px(1.0))
                .with(Mark::line(line, ESTIMATE).width_px(1.0).label("error"))
        })
        .collect()
}

/// Returns what most of the values do not exceed. Before the first measurements of a quantity its
/// error and band are so wide that beside them nothing else could be seen.
fn most(mut values: Vec<f64>) -> f64 {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() * 24 / 25).copied().unwrap_or(1.0).max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::super::estimates::{EstimateTrace, Quantities};
    use super::super::track::{ApexMark, Decision};
    use super::*;

    fn track() -> Track {
        let pose = |x: f64| LegPose { foot: (x, 0.0), mass: (x + 0.2, 0.98) };
        let apex = |x: f64| ApexMark {
            t_s: x,
            x_m: x,
            y_m: 2.0,
            vx_m_s: 0.5,
            set_point_m_s: 0.5,
            density_ratio: 1.0,
            decision: Some(Decision { vx_m_s: 0.5, y_m: 2.0, density_ratio: 0.99 }),
        };
        Track {
            path: (0..400).map(|i| (0.1 * f64::from(i), 1.5)).collect(),
            velocity: (0..400).map(|i| (0.1 * f64::from(i), 0.5)).collect(),
            touchdowns: (0..7).map(|i| pose(f64::from(i))).collect(),
            liftoffs: (0..5).map(|i| pose(f64::from(i) + 0.5)).collect(),
            apexes: (0..6).map(|i| apex(f64::from(i))).collect(),
            fall: None,
        }
    }

    fn draw_with(estimates: EstimateTrace) -> String {
        let recorder = TrackRecorder { track: track(), estimates, ..TrackRecorder::default() };
        draw(&recorder, "a note", |x| if x < 15.0 { 1.0 } else { 0.0 }).unwrap()
    }

    #[test]
    fn draws_every_mark_of_the_run() {
        let svg = draw_with(EstimateTrace::default());
        // A dot for each mass, each apex velocity and each density, and two in the legends.
        assert_eq!(svg.matches("<circle").count(), 7 + 5 + 6 + 6 + 2);
        assert!(svg.contains("density ratio") && svg.contains("velocity, m/s"));
        assert!(svg.contains("a note") && !svg.contains(BAND_LABEL));
    }

    #[test]
    fn draws_estimates_with_their_bands_and_errors_where_there_are_some() {
        let one = Estimated { value: 0.5, deviation: 0.1, error: 0.05 };
        let point = |i: u32| EstimatePoint {
            t_s: f64::from(i),
            x_m: f64::from(i),
            of: Quantities { velocity: one, height: one, density: one },
        };
        let svg = draw_with(EstimateTrace::with_points((0..30).map(point).collect()));
        assert_eq!(svg.matches(BAND_LABEL).count(), 3 + 3, "in the legend of each panel");
        assert!(svg.contains("Height: estimate less truth"));
        // A band in each of six panels, and the area of the density.
        assert_eq!(svg.matches("<polygon").count(), 6 + 1);
    }

    #[test]
    fn a_wide_band_at_the_beginning_does_not_flatten_the_rest() {
        let values = (0..1_000).map(|i| if i < 30 { 1e6 } else { f64::from(i % 3) });
        assert_eq!(most(values.collect()), 2.0);
        assert_eq!(most(vec![f64::NAN]), 1.0);
    }
}
