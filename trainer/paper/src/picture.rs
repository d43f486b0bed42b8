//! Pictures said, not drawn: panels with axes and marks, laid out and drawn as
//! SVG in one place, so that every figure looks like its neighbours.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub use trainer::curves::picture::COLORS;

/// Why a picture could not be laid out, in the library's words.
pub type DrawError = Box<dyn std::error::Error + Send + Sync>;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'c, 'a> = ChartContext<'c, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The library draws on whole units: several of them a pixel make curves smooth.
const UNITS_PER_PX: u32 = 4;
const MARGIN_PX: u32 = 12;
const TITLE_PX: u32 = 28;
const NOTE_PX: u32 = 22;
const LEFT_PX: u32 = 58;
const LEGEND_ROW_PX: u32 = 18;
const SCALE_PX: u32 = 64;
const FONT: &str = "sans-serif";

/// Text and axes.
pub const INK: RGBColor = RGBColor(38, 44, 56);
/// What is not our own: the authors' data.
pub const AUTHORS: RGBColor = RGBColor(20, 20, 20);
const FAINT: RGBColor = RGBColor(214, 218, 226);

/// A picture: a title, a note on how to read it, and rows of panels.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    /// Above all.
    pub title: String,
    /// Below the title; how to read the picture.
    pub note: String,
    /// Rows of panels, top down; each row as wide as the sheet.
    pub rows: Vec<Vec<Panel>>,
    /// Height of a row, px; 0 is the usual 300.
    pub row_px: u32,
}

/// A panel: axes, and marks drawn in their order.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// What is drawn.
    pub marks: Vec<Mark>,
}

/// An axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What it is, with its unit.
    pub label: String,
    /// From where to where.
    pub range: Range<f64>,
}

impl Axis {
    /// An axis.
    #[must_use]
    pub fn new(label: &str, range: Range<f64>) -> Self {
        Self { label: label.to_owned(), range }
    }

    /// An axis that holds all these values, with a little room; never empty.
    #[must_use]
    pub fn around(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let finite = values.into_iter().filter(|v| v.is_finite());
        let (low, high) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Self::new(label, 0.0..1.0);
        }
        let room = (0.05 * (high - low)).max(1e-6 * high.abs()).max(1e-9);
        Self::new(label, low - room..high + room)
    }
}

/// Something drawn in a panel. What has a label is in the legend.
#[derive(Clone, Debug)]
pub enum Mark {
    /// A line through points; it breaks where one is not finite.
    Line {
        /// Its points.
        points: Vec<(f64, f64)>,
        /// Its colour.
        color: RGBColor,
        /// Dashes instead.
        dashed: bool,
        /// Its name.
        label: Option<String>,
    },
    /// The space between two lines: place, low, high.
    Band {
        /// Its points.
        points: Vec<(f64, f64, f64)>,
        /// Its colour, drawn faint.
        color: RGBColor,
    },
    /// Dots.
    Dots {
        /// Where.
        points: Vec<(f64, f64)>,
        /// Their colour.
        color: RGBColor,
        /// Their radius, px.
        radius_px: u32,
        /// Their name.
        label: Option<String>,
    },
    /// Bars that stand on 0.
    Bars {
        /// From, to, height.
        bars: Vec<(f64, f64, f64)>,
        /// Their colour.
        color: RGBColor,
        /// Their name.
        label: Option<String>,
    },
    /// A plane of equal cells, coloured by value, with a scale beside the panel.
    Cells {
        /// Where the plane lies, across.
        x: Range<f64>,
        /// And up.
        y: Range<f64>,
        /// Cells across.
        columns: usize,
        /// Values, row by row from below; what is not finite is left white.
        values: Vec<f64>,
        /// The values at the two ends of the scale.
        scale: Range<f64>,
        /// What is coloured, with its unit.
        label: String,
    },
}

impl Mark {
    /// A plain line.
    #[must_use]
    pub fn line(points: Vec<(f64, f64)>, color: RGBColor, label: impl Into<String>) -> Self {
        Self::Line { points, color, dashed: false, label: Some(label.into()) }
    }

    /// A dashed line without a name, such as a limit.
    #[must_use]
    pub fn guide(points: Vec<(f64, f64)>) -> Self {
        Self::Line { points, color: INK, dashed: true, label: None }
    }

    fn legend(&self) -> Option<(&str, RGBColor)> {
        match self {
            Self::Line { label, color, .. }
            | Self::Dots { label, color, .. }
            | Self::Bars { label, color, .. } => label.as_deref().map(|label| (label, *color)),
            Self::Band { .. } | Self::Cells { .. } => None,
        }
    }
}

const fn px(pixels: u32) -> u32 {
    UNITS_PER_PX * pixels
}

const fn at(pixels: u32) -> i32 {
    px(pixels).cast_signed()
}

impl Sheet {
    const WIDTH_PX: u32 = 1_000;

    fn row_px(&self) -> u32 {
        if self.row_px == 0 { 300 } else { self.row_px }
    }

    /// Draws it, as SVG text.
    ///
    /// # Errors
    /// When the drawing library cannot lay out a panel.
    pub fn draw(&self) -> Result<String, DrawError> {
        let legends: Vec<u32> = self.rows.iter().map(|row| legend_px(row)).collect();
        let head = TITLE_PX + NOTE_PX * u32::from(!self.note.is_empty());
        let height =
            head + legends.iter().map(|legend| self.row_px() + legend).sum::<u32>() + 2 * MARGIN_PX;
        let size = (px(Self::WIDTH_PX), px(height));
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            root.fill(&WHITE)?;
            let margin = px(MARGIN_PX);
            let root = root.margin(margin, margin, margin, margin);
            let (top, mut rest) = root.split_vertically(px(head));
            write(&top, &self.title, (8, 0), 17.0)?;
            write(&top, &self.note, (8, TITLE_PX), 12.5)?;
            for (row, legend) in self.rows.iter().zip(legends) {
                let (area, below) = rest.split_vertically(px(self.row_px() + legend));
                for (area, panel) in area.split_evenly((1, row.len())).iter().zip(row) {
                    panel.draw(area, legend)?;
                }
                rest = below;
            }
            root.present()?;
        }
        let drawn = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
        let shown = format!("width=\"{}\" height=\"{height}\"", Self::WIDTH_PX);
        let svg = svg.replacen(&drawn, &shown, 1);
        // Cells side by side would let the ground shine through between them.
        Ok(svg.replacen('>', "><style>rect{shape-rendering:crispEdges}</style>", 1))
    }
}

/// Height of the legends of a row: of the longest.
fn legend_px(row: &[Panel]) -> u32 {
    let entries = |panel: &Panel| panel.marks.iter().filter(|m| m.legend().is_some()).count();
    LEGEND_ROW_PX * row.iter().map(entries).max().unwrap_or(0) as u32
}

impl Panel {
    fn draw(&self, area: &Area<'_>, legend_px: u32) -> Result<(), DrawError> {
        let scaled = self.marks.iter().find_map(|mark| match mark {
            Mark::Cells { scale, label, .. } => Some((scale, label)),
            _ => None,
        });
        let (head, body) = area.split_vertically(px(22 + legend_px));
        write(&head, &self.title, (LEFT_PX, 2), 14.0)?;
        let labelled = self.marks.iter().filter_map(Mark::legend);
        for (i, (label, color)) in labelled.enumerate() {
            let y = 24 + LEGEND_ROW_PX * i as u32;
            let (x, middle) = (at(LEFT_PX), at(y + 5));
            let line = [(x, middle), (x + at(18), middle)];
            head.draw(&PathElement::new(line, color.stroke_width(px(3))))?;
            write(&head, label, (LEFT_PX + 24, y), 12.0)?;
        }
        let (width, _) = body.dim_in_pixel();
        let right = if scaled.is_some() { px(SCALE_PX) } else { 0 };
        let (body, scale_area) = body.split_horizontally(width - right);
        let mut chart = ChartBuilder::on(&body)
            .margin_top(px(6))
            .margin_right(px(14))
            .margin_bottom(px(8))
            .x_label_area_size(px(38))
            .y_label_area_size(px(LEFT_PX))
            .build_cartesian_2d(self.x.range.clone(), self.y.range.clone())?;
        let cells = |mark: &&Mark| matches!(mark, Mark::Cells { .. });
        // Planes lie below the mesh, all else above it.
        for mark in self.marks.iter().filter(cells) {
            mark.draw(&mut chart)?;
        }
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(FAINT.mix(0.6))
            .axis_style(INK.mix(0.5))
            .label_style((FONT, px(12)).into_font().color(&INK))
            .x_labels(7)
            .y_labels(6)
            .x_label_formatter(&|x| number(*x))
            .y_label_formatter(&|y| number(*y))
            .x_desc(self.x.label.as_str())
            .y_desc(self.y.label.as_str())
            .draw()?;
        for mark in self.marks.iter().filter(|mark| !cells(mark)) {
            mark.draw(&mut chart)?;
        }
        if let Some((scale, label)) = scaled {
            draw_scale(&scale_area, scale, label)?;
        }
        Ok(())
    }
}

impl Mark {
    fn draw(&self, chart: &mut Chart<'_, '_>) -> Result<(), DrawError> {
        match self {
            Self::Line { points, color, dashed, .. } => {
                let style = color.stroke_width(px(2));
                for stretch in points.split(|(x, y)| !(x.is_finite() && y.is_finite())) {
                    let points = stretch.iter().copied();
                    if *dashed {
                        chart.draw_series(DashedLineSeries::new(points, at(5), at(4), style))?;
                    } else {
                        chart.draw_series(LineSeries::new(points, style))?;
                    }
                }
            }
            Self::Band { points, color } => {
                let below = points.iter().map(|(x, low, _)| (*x, *low));
                let above = points.iter().rev().map(|(x, _, high)| (*x, *high));
                let outline: Vec<(f64, f64)> = below.chain(above).collect();
                chart.draw_series([Polygon::new(outline, color.mix(0.2).filled())])?;
            }
            Self::Dots { points, color, radius_px, .. } => {
                let finite = points.iter().filter(|(x, y)| x.is_finite() && y.is_finite());
                let dot = |point: &(f64, f64)| Circle::new(*point, px(*radius_px), color.filled());
                chart.draw_series(finite.map(dot))?;
            }
            Self::Bars { bars, color, .. } => {
                let bar = |&(from, to, height): &(f64, f64, f64)| {
                    Rectangle::new([(from, 0.0), (to, height)], color.mix(0.75).filled())
                };
                chart.draw_series(bars.iter().map(bar))?;
            }
            Self::Cells { x, y, columns, values, scale, .. } => {
                let rows = values.len() / columns;
                let (dx, dy) =
                    ((x.end - x.start) / *columns as f64, (y.end - y.start) / rows as f64);
                let runs = values.chunks(*columns).enumerate().flat_map(|(row, values)| {
                    runs(values, scale)
                        .into_iter()
                        .map(move |(from, to, color)| (row, from, to, color))
                });
                chart.draw_series(runs.map(|(row, from, to, color)| {
                    let low = (x.start + from as f64 * dx, y.start + row as f64 * dy);
                    let high = (x.start + to as f64 * dx, y.start + (row + 1) as f64 * dy);
                    Rectangle::new([low, high], color.filled())
                }))?;
            }
        }
        Ok(())
    }
}

/// Neighbouring cells of a row that look the same, as one: from, to, colour.
fn runs(values: &[f64], scale: &Range<f64>) -> Vec<(usize, usize, RGBColor)> {
    let mut runs: Vec<(usize, usize, RGBColor)> = Vec::new();
    for (i, value) in values.iter().enumerate() {
        let Some(color) = shade(*value, scale) else { continue };
        match runs.last_mut() {
            Some((_, to, last)) if *to == i && *last == color => *to = i + 1,
            _ => runs.push((i, i + 1, color)),
        }
    }
    runs
}

/// Shades that are told apart on a scale.
const SHADES: u32 = 64;

/// The colour of a value on a scale; none for what is not finite.
#[must_use]
pub fn shade(value: f64, scale: &Range<f64>) -> Option<RGBColor> {
    // Dark blue over green to yellow: even in lightness, for any colour vision.
    const STOPS: [(f64, f64, f64); 5] = [
        (68.0, 1.0, 84.0),
        (59.0, 82.0, 139.0),
        (33.0, 145.0, 140.0),
        (94.0, 201.0, 98.0),
        (253.0, 231.0, 37.0),
    ];
    if !value.is_finite() {
        return None;
    }
    let share = ((value - scale.start) / (scale.end - scale.start)).clamp(0.0, 1.0);
    let share = (share * f64::from(SHADES)).round() / f64::from(SHADES);
    let place = share * (STOPS.len() - 1) as f64;
    let low = (place as usize).min(STOPS.len() - 2);
    let part = place - low as f64;
    let (a, b) = (STOPS[low], STOPS[low + 1]);
    let mix = |a: f64, b: f64| (a + part * (b - a)).round() as u8;
    Some(RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2)))
}

fn draw_scale(area: &Area<'_>, scale: &Range<f64>, label: &str) -> Result<(), DrawError> {
    let (_, height) = area.dim_in_pixel();
    let (top, bottom) = (at(20), height.cast_signed() - at(40));
    for i in 0..SHADES {
        let share = |i: u32| f64::from(i) / f64::from(SHADES);
        let y = |i: u32| bottom - ((bottom - top) as f64 * share(i)).round() as i32;
        let value = scale.start + share(i) * (scale.end - scale.start);
        let Some(color) = shade(value, scale) else { continue };
        area.draw(&Rectangle::new([(at(2), y(i)), (at(14), y(i + 1))], color.filled()))?;
    }
    let middle = f64::midpoint(scale.start, scale.end);
    for (value, y) in
        [(scale.end, top), (middle, i32::midpoint(top, bottom)), (scale.start, bottom)]
    {
        let y = (y / UNITS_PER_PX.cast_signed()).cast_unsigned();
        // Two decimals: there is no room for more beside the next panel.
        let value = (value * 100.0).round() / 100.0;
        write(area, &number(value), (18, y.saturating_sub(6)), 12.0)?;
    }
    write(area, label, (0, 2), 11.0)
}

/// A number on an axis, as short as it can be said.
#[must_use]
pub fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded.abs() >= 1e4 { trainer::curves::grouped(rounded) } else { format!("{rounded}") }
}

/// Writes from a place on, px, in a size, px.
fn write(area: &Area<'_>, text: &str, (x, y): (u32, u32), size: f64) -> Result<(), DrawError> {
    let style = (FONT, size * f64::from(UNITS_PER_PX))
        .into_text_style(area)
        .color(&INK)
        .pos(Pos::new(HPos::Left, VPos::Top));
    area.draw(&Text::new(text.to_owned(), (at(x), at(y)), style))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mark_is_drawn_and_what_has_a_name_is_in_the_legend() {
        let cells = Mark::Cells {
            x: 0.0..2.0,
            y: 0.0..1.0,
            columns: 2,
            values: vec![0.0, 1.0, f64::NAN, 1.0],
            scale: 0.0..1.0,
            label: "reward".into(),
        };
        let marks = vec![
            cells,
            Mark::line(
                vec![(0.0, 0.0), (1.0, 0.5), (f64::NAN, 0.0), (2.0, 1.0)],
                COLORS[0],
                "ours",
            ),
            Mark::Band { points: vec![(0.0, 0.1, 0.2), (1.0, 0.2, 0.3)], color: COLORS[1] },
            Mark::Dots {
                points: vec![(0.5, 0.5)],
                color: AUTHORS,
                radius_px: 3,
                label: Some("the authors'".into()),
            },
            Mark::Bars { bars: vec![(0.0, 1.0, 0.4)], color: COLORS[2], label: None },
            Mark::guide(vec![(0.0, 1.0), (2.0, 1.0)]),
        ];
        let (x, y) = (Axis::new("x, m", 0.0..2.0), Axis::new("y, m", 0.0..1.0));
        let panel = Panel { title: "a <panel>".into(), x, y, marks };
        let rows = vec![vec![panel.clone(), panel]];
        let svg = Sheet { title: "A sheet".into(), rows, ..Sheet::default() }.draw().unwrap();
        for said in ["A sheet", "a &lt;panel&gt;", "ours", "the authors", "x, m", "reward"] {
            assert!(svg.contains(said), "{said}");
        }
        assert!(svg.contains("<polygon") && svg.contains("<circle"), "{svg}");
        // Yellow: the two cells at the top of the scale, in each panel, and its end.
        let yellow = svg.matches("#FDE725").count();
        assert!(yellow >= 4, "{yellow}");
    }

    #[test]
    fn an_axis_holds_its_values() {
        let axis = Axis::around("v", [1.0, f64::NAN, 3.0]);
        assert!(axis.range.start < 1.0 && axis.range.end > 3.0 && axis.range.end < 3.2);
        assert!(!Axis::around("v", [2.0]).range.is_empty());
        assert!(!Axis::around("v", []).range.is_empty());
    }
}
