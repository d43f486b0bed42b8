//! The picture of learning curves: reward above, full episodes below.

use super::smooth::{Curve, Point, Smoothing, Spread};
use super::{By, Zero, grouped};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Panel<'c, 'a> = ChartContext<'c, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type DrawError = Box<dyn std::error::Error + Send + Sync>;

/// The library draws on whole units: several of them a pixel make curves smooth.
const UNITS_PER_PX: u32 = 4;
const WIDTH: u32 = 1_000;
const PANEL_HEIGHT: u32 = 320;
const MARGIN: u32 = 12;
/// Where the panels' frames begin and end.
const LEFT: u32 = 70;
const RIGHT: u32 = 24;
/// Rows above the panels: title, what is drawn, then the legend.
const TITLE_HEIGHT: u32 = 30;
const NOTE_HEIGHT: u32 = 24;
const LEGEND_HEIGHT: u32 = 25;
const FONT: &str = "sans-serif";

const INK: RGBColor = RGBColor(38, 44, 56);
const FAINT: RGBColor = RGBColor(214, 218, 226);
/// Of the groups, in their order: apart in hue and in lightness, so that they
/// can be told apart with any colour vision.
pub const COLORS: [RGBColor; 8] = [
    RGBColor(40, 116, 190),
    RGBColor(214, 96, 38),
    RGBColor(20, 138, 118),
    RGBColor(230, 170, 30),
    RGBColor(128, 70, 150),
    RGBColor(110, 186, 232),
    RGBColor(90, 96, 108),
    RGBColor(222, 130, 176),
];

const fn px(pixels: u32) -> u32 {
    UNITS_PER_PX * pixels
}

/// A place, px, as the library takes one.
const fn at(pixels: u32) -> i32 {
    px(pixels).cast_signed()
}

/// What a panel shows of a point.
struct Quantity {
    title: String,
    axis: &'static str,
    of: fn(&Point) -> Spread,
    range: Range<f64>,
    label: fn(&f64) -> String,
}

/// Draws curves, at most as many as there are [`COLORS`], as SVG text.
///
/// # Errors
/// When the drawing library cannot lay out a panel.
pub fn draw(curves: &[Curve], how: &Smoothing, options: (f64, f64)) -> Result<String, DrawError> {
    let legend = Legend::new(curves);
    let head = TITLE_HEIGHT + NOTE_HEIGHT + LEGEND_HEIGHT * legend.rows();
    let (width, height) = (WIDTH, head + 2 * PANEL_HEIGHT + 2 * MARGIN);
    let size = (px(width), px(height));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(px(MARGIN), px(MARGIN), px(MARGIN), px(MARGIN));
        let (top, panels) = root.split_vertically(px(head));
        text(&top, "Learning curves", (LEFT, 2), (17.0, INK))?;
        text(&top, &note(curves, how), (LEFT, TITLE_HEIGHT), (13.0, INK))?;
        legend.draw(&top, TITLE_HEIGHT + NOTE_HEIGHT)?;
        let (upper, lower) = panels.split_vertically(px(PANEL_HEIGHT));
        draw_panel(&upper, curves, how, options, &reward(curves))?;
        draw_panel(&lower, curves, how, options, &full(curves))?;
        root.present()?;
    }
    let drawn = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(svg.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

fn reward(curves: &[Curve]) -> Quantity {
    let points = || curves.iter().flat_map(|c| c.stretches.iter().flatten());
    let low = points().map(|p| p.reward.low).fold(0.0, f64::min);
    let high = points().map(|p| p.reward.high).fold(low + 0.1, f64::max);
    Quantity {
        title: "Reward of an episode".into(),
        axis: "sum of rewards",
        of: |point| point.reward,
        range: low - 0.04 * (high - low)..high + 0.06 * (high - low),
        label: |y| format!("{}", (y * 1e6).round() / 1e6),
    }
}

fn full(curves: &[Curve]) -> Quantity {
    let mut steps: Vec<u64> = curves.iter().map(|c| c.full_steps).collect();
    steps.sort_unstable();
    steps.dedup();
    let title = match steps[..] {
        [steps] => format!("Full episodes ({steps} steps without a fall before)"),
        _ => "Full episodes (as many steps as the longest of the group)".into(),
    };
    Quantity {
        title,
        axis: "share, %",
        of: |point| point.full,
        // A little room below zero keeps the corner's two labels apart.
        range: -0.03..1.05,
        label: |y| format!("{:.0}", 100.0 * y),
    }
}

/// How to read the picture.
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

fn draw_panel(
    area: &Area<'_>,
    curves: &[Curve],
    how: &Smoothing,
    options: (f64, f64),
    quantity: &Quantity,
) -> Result<(), DrawError> {
    let mut panel = ChartBuilder::on(area)
        .caption(&quantity.title, (FONT, px(15)).into_font().color(&INK))
        .margin_top(px(16))
        .margin_right(px(RIGHT))
        .x_label_area_size(px(42))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(options.0..options.1, quantity.range.clone())?;
    panel
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.mix(0.6))
        .axis_style(INK.mix(0.5))
        .label_style((FONT, px(13)).into_font().color(&INK))
        .x_labels(10)
        .y_labels(6)
        .x_label_formatter(&|x| grouped(*x))
        .y_label_formatter(&quantity.label)
        .x_desc(match (how.by, how.zero) {
            (By::Steps, Zero::Start) => "environment steps",
            (By::Steps, Zero::LastStage) => "environment steps of the last stage",
            (By::Episodes, Zero::Start) => "episodes",
            (By::Episodes, Zero::LastStage) => "episodes of the last stage",
        })
        .y_desc(quantity.axis)
        .draw()?;
    for (curve, color) in curves.iter().zip(COLORS) {
        draw_band(&mut panel, curve, color, quantity.of)?;
    }
    for (curve, color) in curves.iter().zip(COLORS) {
        draw_changes(&mut panel, curve, color, &quantity.range)?;
        for stretch in &curve.stretches {
            let line = stretch.iter().map(|p| (p.x, (quantity.of)(p).median));
            panel.draw_series(LineSeries::new(line, color.stroke_width(px(2))))?;
        }
    }
    Ok(())
}

fn draw_band(
    panel: &mut Panel<'_, '_>,
    curve: &Curve,
    color: RGBColor,
    of: fn(&Point) -> Spread,
) -> Result<(), DrawError> {
    if curve.runs < 2 {
        return Ok(());
    }
    for stretch in &curve.stretches {
        let below = stretch.iter().map(|p| (p.x, of(p).low));
        let above = stretch.iter().rev().map(|p| (p.x, of(p).high));
        let outline: Vec<(f64, f64)> = below.chain(above).collect();
        panel.draw_series([Polygon::new(outline, color.mix(0.2).filled())])?;
    }
    Ok(())
}

/// The library's dashes depend on where a line is cut: these are short lines.
fn draw_changes(
    panel: &mut Panel<'_, '_>,
    curve: &Curve,
    color: RGBColor,
    y: &Range<f64>,
) -> Result<(), DrawError> {
    let dashes = 40;
    let at = |share: f64| y.start + (y.end - y.start) * share / f64::from(dashes);
    for &x in &curve.changes {
        panel.draw_series((0..dashes).map(|i| {
            let dash = [(x, at(f64::from(i))), (x, at(f64::from(i) + 0.6))];
            PathElement::new(dash, color.stroke_width(px(1)))
        }))?;
    }
    Ok(())
}

/// Which colour is which group: entries in rows above the panels.
struct Legend(Vec<Entry>);

struct Entry {
    text: String,
    row: u32,
    x_px: u32,
}

const SWATCH_PX: u32 = 26;
const LEGEND_FONT_PX: f64 = 14.0;

impl Legend {
    fn new(curves: &[Curve]) -> Self {
        let room = WIDTH - 2 * MARGIN - RIGHT;
        let mut entries: Vec<Entry> = Vec::new();
        let (mut row, mut x_px) = (0, LEFT);
        for curve in curves {
            let runs = if curve.runs == 1 { "run" } else { "runs" };
            let text = format!("{} ({} {runs})", curve.label, curve.runs);
            // A letter is at most so wide on average, whatever the font.
            let letters = text.chars().count() as f64;
            let width = SWATCH_PX + 8 + (0.58 * LEGEND_FONT_PX * letters) as u32 + 20;
            if x_px > LEFT && x_px + width > room {
                (row, x_px) = (row + 1, LEFT);
            }
            entries.push(Entry { text, row, x_px });
            x_px += width;
        }
        Self(entries)
    }

    fn rows(&self) -> u32 {
        self.0.last().map_or(0, |entry| entry.row + 1)
    }

    fn draw(&self, area: &Area<'_>, top_px: u32) -> Result<(), DrawError> {
        for (entry, color) in self.0.iter().zip(COLORS) {
            let y = top_px + LEGEND_HEIGHT * entry.row;
            let (x, middle) = (at(entry.x_px), at(y + 6));
            let line = [(x, middle), (x + at(SWATCH_PX), middle)];
            area.draw(&PathElement::new(line, color.stroke_width(px(3))))?;
            text(area, &entry.text, (entry.x_px + SWATCH_PX + 8, y), (LEGEND_FONT_PX, INK))?;
        }
        Ok(())
    }
}

/// Writes from a place, px, on, in a size, px, and colour.
fn text(
    area: &Area<'_>,
    text: &str,
    (x, y): (u32, u32),
    (size, color): (f64, RGBColor),
) -> Result<(), DrawError> {
    let style = (FONT, size * f64::from(UNITS_PER_PX))
        .into_text_style(area)
        .color(&color)
        .pos(Pos::new(HPos::Left, VPos::Top));
    area.draw(&Text::new(text.to_owned(), (at(x), at(y)), style))?;
    Ok(())
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
    fn every_group_is_in_both_panels_and_in_the_legend() {
        let how = Smoothing { by: By::Steps, zero: Zero::Start, window: 1_000.0, full_steps: None };
        let curves = [curve("water <first>", 8), curve("air", 1)];
        let svg = draw(&curves, &how, (0.0, 110.0)).unwrap();
        assert_eq!(svg, draw(&curves, &how, (0.0, 110.0)).unwrap());
        // Two stretches in two panels; the group of one run has no band.
        let lines = |c: &str| svg.matches(&format!("stroke=\"{c}\" stroke-width=\"8\"")).count();
        assert_eq!((lines("#2874BE"), lines("#D66026")), (4, 4));
        assert_eq!(svg.matches("<polygon").count(), 4);
        for said in [
            "water &lt;first&gt; (8 runs)",
            "air (1 run)",
            "mean over the last 1,000 steps; line: median of the runs, band: quartiles; dashed",
            "Full episodes (5 steps",
            "environment steps",
        ] {
            assert!(svg.contains(said), "{said}");
        }
    }

    #[test]
    fn a_long_legend_takes_more_rows() {
        let long = "a label that says what was trained";
        let curves: Vec<Curve> = (0..4).map(|_| curve(long, 3)).collect();
        let legend = Legend::new(&curves);
        assert_eq!(legend.0.iter().map(|e| e.row).collect::<Vec<_>>(), [0, 0, 1, 1]);
    }
}
