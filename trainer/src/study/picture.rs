//! A summary as a picture: every seed's every metric, the quartiles, the goals.

use super::folder::SeedReport;
use super::summary::{Row, Summary};
use crate::evaluate::metric::Metric;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Panel<'c, 'a> = ChartContext<'c, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type DrawError = Box<dyn std::error::Error + Send + Sync>;

/// The library draws on whole units: several of them a pixel make edges smooth.
const UNITS_PER_PX: u32 = 4;
const SIZE: (u32, u32) = (px(1_400), px(1_180));
const MARGIN: u32 = px(14);
const HEAD: u32 = px(66);
const FONT: &str = "sans-serif";

const INK: RGBColor = RGBColor(38, 44, 56);
const FAINT: RGBColor = RGBColor(214, 218, 226);
const SEED: RGBColor = RGBColor(40, 116, 190);
const MISSES: RGBColor = RGBColor(214, 96, 38);
const GOAL: RGBColor = RGBColor(20, 138, 118);

/// Half the width of a box, of a goal, and of the strip that seeds are spread over;
/// a metric's column is 1 wide.
const BOX: f64 = 0.3;
const MARK: f64 = 0.42;
const STRIP: f64 = 0.22;
/// With more seeds than this, those between the quartiles are left to the box.
const MOST_DOTS: usize = 250;

const fn px(pixels: u32) -> u32 {
    UNITS_PER_PX * pixels
}

/// The same, as a place or an offset.
const fn at_px(pixels: u32) -> i32 {
    px(pixels).cast_signed()
}

/// How values are laid out upwards.
#[derive(Clone, Copy)]
enum Scale {
    /// Shares by their distance to 1, which is what matters: 0.9, 0.99, 0.999 are
    /// equally far apart. The highest place, that of exactly 1, is for so many starts.
    Nines(f64),
    /// By tens, not below the least that is told apart.
    Tens(f64),
    Plain,
}

impl Scale {
    /// Where a value is. By `libm`, so that the picture is the same everywhere.
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Nines(starts) => -libm::log10((1.0 - value).max(0.5 / starts)),
            Self::Tens(least) => libm::log10(value.max(least)),
            Self::Plain => value,
        }
    }

    fn ticks(self) -> Vec<f64> {
        match self {
            Self::Nines(_) => vec![0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0],
            Self::Tens(_) => vec![1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0],
            Self::Plain => Vec::new(),
        }
    }
}

/// A panel: metrics side by side on one scale.
struct Part {
    title: &'static str,
    scale: Scale,
    has: fn(Metric) -> bool,
    label: fn(Metric) -> String,
}

fn parts(starts: f64) -> [Part; 6] {
    let density = |metric: Metric| match metric {
        Metric::Survive30(rho) | Metric::AbsVMedian(rho) | Metric::MaxSpeed(rho) => rho.to_string(),
        other => other.to_string(),
    };
    let condition = |metric: Metric| match metric {
        Metric::Survive30In(c) | Metric::AbsVMedianIn(c) => {
            let text = c.change.to_string();
            text.replace("000 N/m", "").replace("k ", "k\u{a0}").replace(" kg", "")
        }
        other => other.to_string(),
    };
    [
        Part {
            title: "Still hopping after 30 hops, by density ratio",
            scale: Scale::Nines(starts),
            has: |f| matches!(f, Metric::Survive30(_)),
            label: density,
        },
        Part {
            title: "Median |v| after 30 hops, m/s, by density ratio",
            scale: Scale::Tens(1e-5),
            has: |f| matches!(f, Metric::AbsVMedian(_)),
            label: density,
        },
        Part {
            title: "Still hopping on land: springs (k, kN/m), masses (m, kg), worlds",
            scale: Scale::Nines(starts),
            has: |f| matches!(f, Metric::Survive30In(_)),
            label: condition,
        },
        Part {
            title: "Median |v| on land, m/s: springs (k, kN/m), masses (m, kg), worlds",
            scale: Scale::Tens(1e-5),
            has: |f| matches!(f, Metric::AbsVMedianIn(_)),
            label: condition,
        },
        Part {
            title: "Highest speed, m/s, by density ratio",
            scale: Scale::Plain,
            has: |f| matches!(f, Metric::MaxSpeed(_)),
            label: density,
        },
        Part {
            title: "Of the 42 set-points with a known steady gait",
            scale: Scale::Plain,
            has: |f| matches!(f, Metric::Tracked | Metric::Falls),
            label: |f| if f == Metric::Tracked { "tracked".into() } else { "fell".into() },
        },
    ]
}

/// Draws a study as SVG text.
///
/// # Errors
/// When the drawing library cannot lay out a panel.
pub fn draw(summary: &Summary) -> Result<String, DrawError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(MARGIN, MARGIN, MARGIN, MARGIN);
        let (head, body) = root.split_vertically(HEAD);
        draw_head(&head, summary)?;
        let parts = parts(f64::from(summary.plan.eval_starts));
        for (area, part) in body.split_evenly((3, 2)).iter().zip(&parts) {
            draw_part(area, summary, part)?;
        }
        root.present()?;
    }
    let [width, height] = [SIZE.0, SIZE.1].map(|units| units / UNITS_PER_PX);
    let drawn = format!("width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1);
    Ok(svg.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

fn draw_head(area: &Area<'_>, summary: &Summary) -> Result<(), DrawError> {
    let plan = &summary.plan;
    let perfect = summary.seeds.iter().filter(|s| summary.missed(s).next().is_none()).count();
    let title = format!(
        "{}, seeds {}: {perfect} of {} seeds reach every goal",
        plan.config.preset,
        plan.seeds,
        summary.seeds.len()
    );
    area.draw(&Text::new(title, place(8, 2), (FONT, px(21)).into_font().color(&INK)))?;
    // The legend, from left to right.
    let y = 44;
    let small = (FONT, px(13)).into_font().color(&INK);
    let mut x = 14;
    let mut entry = |text: String, width: u32| -> Result<(i32, i32), DrawError> {
        area.draw(&Text::new(text, place(x + 12, y - 7), small.clone()))?;
        let at = place(x, y);
        x += 12 + width;
        Ok(at)
    };
    let at = entry("a seed".into(), 60)?;
    area.draw(&Circle::new(at, px(3), SEED.mix(0.8).filled()))?;
    let at = entry("a seed that misses the goal".into(), 188)?;
    area.draw(&Circle::new(at, px(3), MISSES.mix(0.9).filled()))?;
    if let Some(worst) = summary.worst() {
        let at = entry(format!("the worst seed, {}", worst.seed), 150)?;
        area.draw(&Circle::new(at, px(6), INK.stroke_width(px(1))))?;
    }
    let (x, y) = entry("quartiles and median".into(), 155)?;
    let (w, h) = (at_px(6), at_px(6));
    area.draw(&Rectangle::new([(x - w, y - h), (x + w, y + h)], INK.mix(0.12).filled()))?;
    area.draw(&PathElement::new([(x - w, y), (x + w, y)], INK.stroke_width(px(2))))?;
    let (x, y) = entry("goal of the median (solid) and of the worst seed (dashed)".into(), 0)?;
    area.draw(&PathElement::new([(x - w, y), (x + w, y)], GOAL.stroke_width(px(3))))?;
    Ok(())
}

fn place(x: u32, y: u32) -> (i32, i32) {
    (at_px(x), at_px(y))
}

/// The options that a panel's values cover, with room to spare.
fn extent(rows: &[&Row], seeds: &[SeedReport], scale: Scale) -> Range<f64> {
    let values = rows.iter().flat_map(|row| {
        let goals = row.goal.into_iter().flat_map(|goal| [Some(goal.limit), goal.worst]);
        let seeds = seeds.iter().map(|seed| seed.metric(row.metric));
        goals.chain(seeds).flatten()
    });
    let top = match scale {
        Scale::Nines(_) => scale.place(1.0),
        Scale::Tens(_) => f64::NEG_INFINITY,
        Scale::Plain => 1.0,
    };
    let bottom = if matches!(scale, Scale::Plain) { 0.0 } else { f64::INFINITY };
    let (low, high) = values
        .map(|value| scale.place(value))
        .fold((bottom, top), |(low, high), at| (low.min(at), high.max(at)));
    if low > high {
        return 0.0..1.0;
    }
    let spare = 0.06 * (high - low).max(0.5);
    low - spare..high + spare
}

fn draw_part(area: &Area<'_>, summary: &Summary, part: &Part) -> Result<(), DrawError> {
    let rows: Vec<&Row> = summary.rows.iter().filter(|row| (part.has)(row.metric)).collect();
    let y = extent(&rows, &summary.seeds, part.scale);
    let mut panel = ChartBuilder::on(area)
        .caption(part.title, (FONT, px(16)).into_font().color(&INK))
        .margin_top(px(8))
        .margin_right(px(14))
        .x_label_area_size(px(26))
        .y_label_area_size(px(52))
        .build_cartesian_2d(-0.6..rows.len() as f64 - 0.4, y.clone())?;
    draw_grid(&mut panel, part, &rows, &y)?;
    let none = y.start + 0.02 * (y.end - y.start);
    for (column, row) in rows.iter().enumerate() {
        draw_row(&mut panel, summary, part.scale, column as f64, row, none)?;
    }
    Ok(())
}

fn draw_grid(
    panel: &mut Panel<'_, '_>,
    part: &Part,
    rows: &[&Row],
    y: &Range<f64>,
) -> Result<(), DrawError> {
    let small = (FONT, px(12)).into_font().color(&INK);
    let ticks = part.scale.ticks();
    let mut mesh = panel.configure_mesh();
    mesh.disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.mix(0.6))
        .axis_style(INK.mix(0.5))
        .label_style(small.clone())
        .x_labels(0);
    if ticks.is_empty() {
        mesh.y_labels(8).y_label_formatter(&|value: &f64| value.to_string()).draw()?;
    } else {
        mesh.disable_y_mesh().y_labels(0).draw()?;
    }
    let left = -0.6;
    let right = rows.len() as f64 - 0.4;
    let beside = small.clone().pos(Pos::new(HPos::Right, VPos::Center));
    let below = small.pos(Pos::new(HPos::Center, VPos::Top));
    // From the top: of labels that would touch, the higher one stays.
    let mut above = f64::INFINITY;
    let touching = 0.04 * (y.end - y.start);
    for (tick, at) in ticks.into_iter().rev().map(|tick| (tick, part.scale.place(tick))) {
        if !y.contains(&at) || above - at < touching {
            continue;
        }
        above = at;
        panel.draw_series([PathElement::new([(left, at), (right, at)], FAINT.mix(0.6))])?;
        let text = EmptyElement::at((left, at))
            + Text::new(tick.to_string(), (-at_px(7), 0), beside.clone());
        panel.plotting_area().draw(&text)?;
    }
    for (column, row) in rows.iter().enumerate() {
        let text = EmptyElement::at((column as f64, y.start))
            + Text::new((part.label)(row.metric), (0, at_px(7)), below.clone());
        panel.plotting_area().draw(&text)?;
    }
    Ok(())
}

/// One column: the box, the goals, the seeds. A seed without the metric is a cross
/// at `none`, by the panel's lower edge.
fn draw_row(
    panel: &mut Panel<'_, '_>,
    summary: &Summary,
    scale: Scale,
    x: f64,
    row: &Row,
    none: f64,
) -> Result<(), DrawError> {
    let across = |half: f64, value: f64| {
        let at = scale.place(value);
        [(x - half, at), (x + half, at)]
    };
    if let (Some(a), Some(b)) = (row.worse_quartile, row.better_quartile) {
        let corners = [across(BOX, a)[0], across(BOX, b)[1]];
        panel.draw_series([Rectangle::new(corners, INK.mix(0.12).filled())])?;
        panel.draw_series([Rectangle::new(corners, INK.mix(0.35).stroke_width(px(1)))])?;
    }
    if let Some(goal) = row.goal {
        let line = across(MARK, goal.limit);
        panel.draw_series([PathElement::new(line, GOAL.stroke_width(px(3)))])?;
        if let Some(worst) = goal.worst {
            let line = across(MARK, worst);
            let style = GOAL.mix(0.8).stroke_width(px(2));
            panel.draw_series(DashedLineSeries::new(line, px(5), px(4), style))?;
        }
    }
    let count = summary.seeds.len();
    let worst_of_all = summary.worst().map(|seed| seed.seed);
    for (i, seed) in summary.seeds.iter().enumerate() {
        // Spread by the golden ratio: neighbours far apart, and always the same.
        let golden = (i as f64 * 0.618_033_988_749_894_9).fract();
        let x = if count == 1 { x } else { x + STRIP * (2.0 * golden - 1.0) };
        let Some(value) = seed.metric(row.metric) else {
            panel.draw_series([Cross::new((x, none), px(4), MISSES.stroke_width(px(2)))])?;
            continue;
        };
        let is_worst = worst_of_all == Some(seed.seed);
        if count > MOST_DOTS && !is_worst && in_box(row, value) {
            continue;
        }
        let missed = row.goal.is_some_and(|goal| !goal.reached(Some(value)));
        let color = if missed { MISSES.mix(0.9) } else { SEED.mix(0.7) };
        let at = (x, scale.place(value));
        panel.draw_series([Circle::new(at, px(3), color.filled())])?;
        if is_worst {
            panel.draw_series([Circle::new(at, px(6), INK.stroke_width(px(1)))])?;
        }
    }
    if let Some(median) = row.median {
        panel.draw_series([PathElement::new(across(BOX, median), INK.stroke_width(px(2)))])?;
    }
    Ok(())
}

fn in_box(row: &Row, value: f64) -> bool {
    let (Some(a), Some(b)) = (row.worse_quartile, row.better_quartile) else { return false };
    (a.min(b)..=a.max(b)).contains(&value)
}
