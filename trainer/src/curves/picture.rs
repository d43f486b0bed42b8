//! The chart of learning curves: reward above, full episodes below.

use std::ops::Range;

use leg_charts::color::SERIES;
use leg_charts::{Axis, Color, DrawError, Mark, Panel, Sheet, grouped, percent};

use super::smooth::{Curve, Point, Smoothing, Spread};
use super::{By, Zero};

/// A quantity of a curve's points.
type Quantity = fn(&Point) -> Spread;

/// Draws curves, at most as many as there are colours in [`SERIES`], as SVG text.
///
/// # Errors
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(curves: &[Curve], how: &Smoothing, places: (f64, f64)) -> Result<String, DrawError> {
    let x = |label: &str| Axis::new(label, places.0..places.1);
    let below = match (how.by, how.zero) {
        (By::Steps, Zero::Start) => "environment steps",
        (By::Steps, Zero::LastStage) => "environment steps of the last stage",
        (By::Episodes, Zero::Start) => "episodes",
        (By::Episodes, Zero::LastStage) => "episodes of the last stage",
    };
    let reward = Axis::new("sum of rewards", reward_range(curves));
    let full = Axis::new("share", -0.03..1.05).written(percent);
    Sheet::new("Learning curves", note(curves, how))
        .shared_legend()
        .row(250, vec![panel("Reward of an episode", [x(""), reward], curves, |p| p.reward)])
        .row(250, vec![panel(&full_title(curves), [x(below), full], curves, |p| p.full)])
        .draw()
}

fn reward_range(curves: &[Curve]) -> Range<f64> {
    let points = || curves.iter().flat_map(|c| c.stretches.iter().flatten());
    let low = points().map(|p| p.reward.low).fold(0.0, f64::min);
    let high = points().map(|p| p.reward.high).fold(low + 0.1, f64::max);
    low - 0.04 * (high - low)..high + 0.06 * (high - low)
}

fn full_title(curves: &[Curve]) -> String {
    let mut steps: Vec<u64> = curves.iter().map(|c| c.full_steps).collect();
    steps.sort_unstable();
    steps.dedup();
    match steps[..] {
        [steps] => format!("Full episodes ({steps} steps without a fall)"),
        _ => "Full episodes (as many steps as the longest of the group)".into(),
    }
}

/// Explains how to read the chart.
fn note(curves: &[Curve], how: &Smoothing) -> String {
    let mut note = format!("mean over the last {} {}", grouped(how.window), how.by.unit());
    if curves.iter().any(|c| c.runs > 1) {
        note += "; line: median of the runs, band: quartiles";
    }
    if curves.iter().any(|c| !c.changes.is_empty()) {
        note += "; dashed: a new stage";
    }
    note
}

fn panel(title: &str, [x, y]: [Axis; 2], curves: &[Curve], of: Quantity) -> Panel {
    let range = y.range.clone();
    let colored = || curves.iter().zip(SERIES);
    let bands = colored().flat_map(|(curve, color)| bands(curve, color, of));
    let lines = colored().flat_map(|(curve, color)| lines(curve, color, of, &range));
    let marks = bands.chain(lines).collect();
    Panel { marks, ..Panel::new(title, x, y) }
}

fn bands(curve: &Curve, color: Color, of: Quantity) -> Vec<Mark> {
    let band = |stretch: &Vec<Point>| {
        let points = stretch.iter().map(|p| (p.x, of(p).low, of(p).high));
        Mark::band(points.collect(), color)
    };
    let stretches = curve.stretches.iter().filter(|_| curve.runs > 1);
    stretches.map(band).collect()
}

fn lines(curve: &Curve, color: Color, of: Quantity, y: &Range<f64>) -> Vec<Mark> {
    let change = |x: &f64| [(*x, y.start), (*x, y.end)];
    let changes = curve.changes.iter().map(change).collect();
    let changes = Mark::segments(changes, color).width_px(1.0).dashed();
    let runs = if curve.runs == 1 { "run" } else { "runs" };
    let line = |stretch: &Vec<Point>| {
        let points = stretch.iter().map(|p| (p.x, of(p).median)).collect();
        Mark::line(points, color).label(format!("{} ({} {runs})", curve.label, curve.runs))
    };
    std::iter::once(changes).chain(curve.stretches.iter().map(line)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(label: &str, runs: usize) -> Curve {
        let spread = |m: f64| Spread { low: m - 0.1, median: m, high: m + 0.1 };
        let point = |x: f64| Point { x, reward: spread(0.01 * x), full: spread(0.5) };
        let stretch = |from: u32| (from..from + 50).map(|x| point(x.into())).collect();
        Curve {
            label: label.into(),
            runs,
            full_steps: 5,
            stretches: vec![stretch(0), stretch(60)],
            changes: vec![55.0],
        }
    }

    #[test]
    fn draws_every_group_in_both_panels_and_names_it_in_the_legend() {
        let how = Smoothing { by: By::Steps, zero: Zero::Start, window: 1_000.0, full_steps: None };
        let curves = [curve("water <first>", 8), curve("air", 1)];
        let svg = draw(&curves, &how, (0.0, 110.0)).unwrap();
        assert_eq!(svg, draw(&curves, &how, (0.0, 110.0)).unwrap());
        // Two stretches in two panels, and the legend; the group of one run has no band.
        let lines = |c: &str| svg.matches(&format!("stroke=\"{c}\" stroke-width=\"8\"")).count();
        assert_eq!((lines("#2874BE"), lines("#D66026")), (5, 5));
        assert_eq!(svg.matches("<polygon").count(), 4);
        for text in [
            "water &lt;first&gt; (8 runs)",
            "air (1 run)",
            "mean over the last 1,000 steps; line: median of the runs, band: quartiles; dashed",
            "Full episodes (5 steps",
            "environment steps",
        ] {
            assert!(svg.contains(text), "{text}");
        }
    }
}
