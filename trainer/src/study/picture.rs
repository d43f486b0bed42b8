//! The chart of a study: every metric of every seed, the quartiles, and the goals.

use std::ops::Range;

use leg_charts::{Axis, DrawError, Mark, Panel, Point, Sheet, color, number};

use super::folder::SeedReport;
use super::summary::{Row, Summary};
use crate::evaluate::metric::Metric;

/// Half the widths of a box, of a goal, and of the strip that seeds are spread over;
/// a metric's column is 1 wide.
const BOX: f64 = 0.3;
const MARK: f64 = 0.42;
const STRIP: f64 = 0.22;
/// With more seeds than this, those between the quartiles are left to the box.
const MOST_DOTS: usize = 250;

/// How values are laid out upwards.
#[derive(Clone, Copy)]
enum Scale {
    /// Shares by their distance to 1, which is what matters: 0.9, 0.99, 0.999 are
    /// equally far apart. The highest place, that of exactly 1, is for so many starts.
    Nines(f64),
    /// By tens, not below the smallest resolved value.
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

/// Metrics side by side on one scale.
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
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(summary: &Summary) -> Result<String, DrawError> {
    let plan = &summary.plan;
    let perfect = summary.seeds.iter().filter(|s| summary.missed(s).next().is_none()).count();
    let title = format!(
        "{}, seeds {}: {perfect} of {} seeds reach every goal",
        plan.config.preset,
        plan.seeds,
        summary.seeds.len()
    );
    let panels: Vec<Panel> =
        parts(f64::from(plan.eval_starts)).iter().map(|part| panel(summary, part)).collect();
    let rows = panels.chunks(2).map(<[Panel]>::to_vec).collect();
    Sheet::new(title, "").width_px(1_400).shared_legend().rows(280, rows).draw()
}

/// Returns the range that a panel's values cover, with some room.
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

fn panel(summary: &Summary, part: &Part) -> Panel {
    let rows: Vec<&Row> = summary.rows.iter().filter(|row| (part.has)(row.metric)).collect();
    let names = rows.iter().enumerate().map(|(i, row)| (i as f64, (part.label)(row.metric)));
    let x = Axis::new("", -0.6..rows.len() as f64 - 0.4).with_ticks(names.collect());
    let range = extent(&rows, &summary.seeds, part.scale);
    let y = match part.ticks(&range) {
        ticks if ticks.is_empty() => Axis::new("", range),
        ticks => Axis::new("", range).with_ticks(ticks),
    };
    let mut columns = Columns::default();
    let lowest = y.range.start + 0.02 * (y.range.end - y.range.start);
    for (column, row) in rows.iter().enumerate() {
        columns.add(summary, part.scale, column as f64, row, lowest);
    }
    Panel { marks: columns.marks(summary), ..Panel::new(part.title, x, y) }
}

impl Part {
    /// Returns the ticks of a scale with ticks of its own, from the top. Of texts that
    /// would touch, the higher one stays.
    fn ticks(&self, range: &Range<f64>) -> Vec<(f64, String)> {
        let touching = 0.04 * (range.end - range.start);
        let mut above = f64::INFINITY;
        let mut ticks = Vec::new();
        for tick in self.scale.ticks().into_iter().rev() {
            let at = self.scale.place(tick);
            if range.contains(&at) && above - at >= touching {
                above = at;
                ticks.push((at, number(tick)));
            }
        }
        ticks
    }
}

/// What is drawn in the columns of a panel.
#[derive(Default)]
struct Columns {
    boxes: Vec<[Point; 2]>,
    goals: Vec<[Point; 2]>,
    goals_of_worst: Vec<[Point; 2]>,
    reaching: Vec<Point>,
    missing: Vec<Point>,
    worst: Vec<Point>,
    without_value: Vec<Point>,
    medians: Vec<[Point; 2]>,
}

impl Columns {
    /// Adds one column: the box, the goals, the seeds. A seed without a value is a cross
    /// at `lowest`, near the panel's lower edge.
    fn add(&mut self, summary: &Summary, scale: Scale, x: f64, row: &Row, lowest: f64) {
        let across = |half: f64, value: f64| {
            let at = scale.place(value);
            [(x - half, at), (x + half, at)]
        };
        if let (Some(a), Some(b)) = (row.worse_quartile, row.better_quartile) {
            self.boxes.push([across(BOX, a)[0], across(BOX, b)[1]]);
        }
        self.goals.extend(row.goal.map(|goal| across(MARK, goal.limit)));
        let worst_goal = row.goal.and_then(|goal| goal.worst);
        self.goals_of_worst.extend(worst_goal.map(|limit| across(MARK, limit)));
        self.medians.extend(row.median.map(|median| across(BOX, median)));
        let count = summary.seeds.len();
        let worst_of_all = summary.worst().map(|seed| seed.seed);
        for (i, seed) in summary.seeds.iter().enumerate() {
            // Spread by the golden ratio: neighbours far apart, and always the same.
            let golden = (i as f64 * 0.618_033_988_749_894_9).fract();
            let x = if count == 1 { x } else { x + STRIP * (2.0 * golden - 1.0) };
            let Some(value) = seed.metric(row.metric) else {
                self.without_value.push((x, lowest));
                continue;
            };
            let is_worst = worst_of_all == Some(seed.seed);
            if count > MOST_DOTS && !is_worst && in_box(row, value) {
                continue;
            }
            let missed = row.goal.is_some_and(|goal| !goal.reached(Some(value)));
            let dots = if missed { &mut self.missing } else { &mut self.reaching };
            dots.push((x, scale.place(value)));
            if is_worst {
                self.worst.push((x, scale.place(value)));
            }
        }
    }

    fn marks(self, summary: &Summary) -> Vec<Mark> {
        let worst = summary.worst().map_or(0, |seed| seed.seed);
        let reaching = color::BLUE.with_opacity(0.7);
        let missing = color::ORANGE.with_opacity(0.9);
        let mut marks = vec![
            Mark::boxes(self.boxes, color::INK).label("quartiles"),
            Mark::segments(self.medians, color::INK).label("median"),
            Mark::segments(self.goals, color::GREEN).width_px(3.0).label("goal of the median"),
            Mark::segments(self.goals_of_worst, color::GREEN)
                .dashed()
                .label("goal of the worst seed"),
            Mark::dots(self.reaching, reaching).label("a seed"),
            Mark::dots(self.missing, missing).label("a seed that misses the goal"),
            Mark::dots(self.worst, color::INK)
                .radius_px(6.0)
                .as_rings()
                .label(format!("the worst seed, {worst}")),
        ];
        if !self.without_value.is_empty() {
            marks.push(
                Mark::crosses(self.without_value, color::ORANGE).label("a seed without a value"),
            );
        }
        marks
    }
}

fn in_box(row: &Row, value: f64) -> bool {
    let (Some(a), Some(b)) = (row.worse_quartile, row.better_quartile) else { return false };
    (a.min(b)..=a.max(b)).contains(&value)
}
