//! Marks: what is drawn in a panel.

use std::ops::Range;

use plotters::element::{
    Circle, Cross, DashedPathElement, PathElement, Polygon, Rectangle as Filled,
};

use crate::canvas::{DrawError, Plane};
use crate::color::{Color, INK, shade};
use crate::units::px;

/// A place on both axes of a panel.
pub type Point = (f64, f64);

/// Something drawn in a panel: a shape, its colour, and its name in the legend.
///
/// Cells and shades lie below the grid; everything else lies above it.
#[derive(Clone, Debug)]
pub struct Mark {
    pub(crate) shape: Shape,
    pub(crate) color: Color,
    pub(crate) label: Option<String>,
}

#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Line { points: Vec<Point>, width_px: f64, dashed: bool },
    Segments { segments: Vec<[Point; 2]>, width_px: f64, dashed: bool },
    Area { points: Vec<Point>, base: f64 },
    Band(Vec<(f64, f64, f64)>),
    Dots { points: Vec<Point>, radius_px: f64, rings: bool },
    Crosses { points: Vec<Point>, radius_px: f64 },
    Boxes(Vec<[Point; 2]>),
    Shades(Vec<[Point; 2]>),
    Cells(Cells),
}

#[derive(Clone, Debug)]
pub(crate) struct Cells {
    x: Range<f64>,
    y: Range<f64>,
    columns: usize,
    values: Vec<f64>,
    pub(crate) scale: Range<f64>,
    pub(crate) label: String,
}

impl Mark {
    fn new(shape: Shape, color: Color) -> Self {
        Self { shape, color, label: None }
    }

    /// Returns a line through points, 2 px wide. It breaks where a point is not finite.
    #[must_use]
    pub fn line(points: Vec<Point>, color: Color) -> Self {
        Self::new(Shape::Line { points, width_px: 2.0, dashed: false }, color)
    }

    /// Returns a dashed line in ink, for a limit or a set-point.
    #[must_use]
    pub fn guide(points: Vec<Point>) -> Self {
        Self::line(points, INK).width_px(1.5).dashed()
    }

    /// Returns straight lines between pairs of points, 2 px wide.
    #[must_use]
    pub fn segments(segments: Vec<[Point; 2]>, color: Color) -> Self {
        Self::new(Shape::Segments { segments, width_px: 2.0, dashed: false }, color)
    }

    /// Returns the area between a line and a base, filled faintly, and the line.
    #[must_use]
    pub fn area(points: Vec<Point>, base: f64, color: Color) -> Self {
        Self::new(Shape::Area { points, base }, color)
    }

    /// Returns the area between two lines, filled faintly: place, low, high.
    #[must_use]
    pub fn band(points: Vec<(f64, f64, f64)>, color: Color) -> Self {
        Self::new(Shape::Band(points), color)
    }

    /// Returns dots of a radius of 3 px. A point that is not finite is left out.
    #[must_use]
    pub fn dots(points: Vec<Point>, color: Color) -> Self {
        Self::new(Shape::Dots { points, radius_px: 3.0, rings: false }, color)
    }

    /// Returns crosses, from their middle to a corner 4 px across and up.
    #[must_use]
    pub fn crosses(points: Vec<Point>, color: Color) -> Self {
        Self::new(Shape::Crosses { points, radius_px: 4.0 }, color)
    }

    /// Returns bars that stand on 0: from, to, height.
    #[must_use]
    pub fn bars(bars: Vec<(f64, f64, f64)>, color: Color) -> Self {
        let corners = |(from, to, height)| [(from, 0.0), (to, height)];
        Self::new(Shape::Shades(bars.into_iter().map(corners).collect()), color)
    }

    /// Returns boxes with an outline, by two opposite corners each.
    #[must_use]
    pub fn boxes(corners: Vec<[Point; 2]>, color: Color) -> Self {
        Self::new(Shape::Boxes(corners), color)
    }

    /// Returns filled rectangles, by two opposite corners each.
    #[must_use]
    pub fn shades(corners: Vec<[Point; 2]>, color: Color) -> Self {
        Self::new(Shape::Shades(corners), color)
    }

    /// Returns a plane of equal cells, coloured by value, with the scale beside the
    /// panel. `x` and `y` are the ranges of the plane, `columns` is the number of cells across.
    /// Values go row by row from below; those that are not finite stay white. `scale`
    /// holds the values at the two ends of the colours, `label` names quantity and unit.
    #[must_use]
    pub fn cells(
        (x, y): (Range<f64>, Range<f64>),
        columns: usize,
        values: Vec<f64>,
        scale: Range<f64>,
        label: &str,
    ) -> Self {
        let label = label.to_owned();
        Self::new(Shape::Cells(Cells { x, y, columns, values, scale, label }), INK)
    }

    /// Names the mark in the legend.
    #[must_use]
    pub fn label(mut self, label: impl Into<String>) -> Self {
        self.label = Some(label.into());
        self
    }

    /// Draws a line or segments with dashes.
    #[must_use]
    pub fn dashed(mut self) -> Self {
        if let Shape::Line { dashed, .. } | Shape::Segments { dashed, .. } = &mut self.shape {
            *dashed = true;
        }
        self
    }

    /// Draws dots as rings.
    #[must_use]
    pub fn as_rings(mut self) -> Self {
        if let Shape::Dots { rings, .. } = &mut self.shape {
            *rings = true;
        }
        self
    }

    /// Sets the width of a line or of segments, px.
    #[must_use]
    pub fn width_px(mut self, width: f64) -> Self {
        if let Shape::Line { width_px, .. } | Shape::Segments { width_px, .. } = &mut self.shape {
            *width_px = width;
        }
        self
    }

    /// Sets the radius of dots or crosses, px.
    #[must_use]
    pub fn radius_px(mut self, radius: f64) -> Self {
        if let Shape::Dots { radius_px, .. } | Shape::Crosses { radius_px, .. } = &mut self.shape {
            *radius_px = radius;
        }
        self
    }

    /// Returns where the mark lies, point by point; empty for cells.
    pub fn points(&self) -> impl Iterator<Item = Point> + '_ {
        let points: Vec<Point> = match &self.shape {
            Shape::Line { points, .. }
            | Shape::Area { points, .. }
            | Shape::Dots { points, .. }
            | Shape::Crosses { points, .. } => points.clone(),
            Shape::Band(points) => {
                points.iter().flat_map(|(x, low, high)| [(*x, *low), (*x, *high)]).collect()
            }
            Shape::Segments { segments: pairs, .. }
            | Shape::Boxes(pairs)
            | Shape::Shades(pairs) => pairs.iter().flatten().copied().collect(),
            Shape::Cells(_) => Vec::new(),
        };
        points.into_iter()
    }

    pub(crate) fn is_below_grid(&self) -> bool {
        matches!(self.shape, Shape::Cells(_) | Shape::Shades(_))
    }

    pub(crate) fn draw(&self, plane: &Plane<'_>) -> Result<(), DrawError> {
        let color = self.color;
        match &self.shape {
            Shape::Line { points, width_px, dashed } => {
                for stretch in points.split(|point| !is_finite(point)) {
                    path(plane, stretch, (color, *width_px, *dashed))?;
                }
            }
            Shape::Segments { segments, width_px, dashed } => {
                for segment in segments {
                    path(plane, segment, (color, *width_px, *dashed))?;
                }
            }
            Shape::Area { points, .. } if points.is_empty() => {}
            Shape::Area { points, base } => {
                let ends = [points.last(), points.first()].into_iter().flatten();
                let below = ends.map(|(x, _)| (*x, *base));
                let outline: Vec<Point> = points.iter().copied().chain(below).collect();
                plane.draw(&Polygon::new(outline, color.with_opacity(0.2).filled()))?;
                path(plane, points, (color, 1.5, false))?;
            }
            Shape::Band(points) => {
                let below = points.iter().map(|(x, low, _)| (*x, *low));
                let above = points.iter().rev().map(|(x, _, high)| (*x, *high));
                let outline: Vec<Point> = below.chain(above).collect();
                plane.draw(&Polygon::new(outline, color.with_opacity(0.2).filled()))?;
            }
            Shape::Dots { points, radius_px, rings } => {
                let style = if *rings { color.stroke(1.0) } else { color.filled() };
                for point in points.iter().filter(|point| is_finite(point)) {
                    plane.draw(&Circle::new(*point, px(*radius_px), style))?;
                }
            }
            Shape::Crosses { points, radius_px } => {
                for point in points.iter().filter(|point| is_finite(point)) {
                    plane.draw(&Cross::new(*point, px(*radius_px), color.stroke(2.0)))?;
                }
            }
            Shape::Boxes(corners) => {
                for [a, b] in corners {
                    plane.draw(&Filled::new([*a, *b], color.with_opacity(0.12).filled()))?;
                    let outline = [*a, (b.0, a.1), *b, (a.0, b.1), *a];
                    path(plane, &outline, (color.with_opacity(0.35), 1.0, false))?;
                }
            }
            Shape::Shades(corners) => {
                for corners in corners {
                    plane.draw(&Filled::new(*corners, color.filled()))?;
                }
            }
            Shape::Cells(cells) => cells.draw(plane)?,
        }
        Ok(())
    }
}

fn is_finite((x, y): &Point) -> bool {
    x.is_finite() && y.is_finite()
}

fn path(
    plane: &Plane<'_>,
    points: &[Point],
    (color, width_px, dashed): (Color, f64, bool),
) -> Result<(), DrawError> {
    let style = color.stroke(width_px);
    if points.is_empty() {
        return Ok(());
    }
    if dashed {
        let points = points.iter().copied();
        plane.draw(&DashedPathElement::new(points, px(5.0), px(4.0), style))?;
    } else {
        plane.draw(&PathElement::new(points, style))?;
    }
    Ok(())
}

impl Cells {
    fn draw(&self, plane: &Plane<'_>) -> Result<(), DrawError> {
        let Self { x, y, columns, values, scale, .. } = self;
        let rows = values.len() / columns;
        let (dx, dy) = ((x.end - x.start) / *columns as f64, (y.end - y.start) / rows as f64);
        for (row, values) in values.chunks(*columns).enumerate() {
            for (from, to, color) in runs(values, scale) {
                let low = (x.start + from as f64 * dx, y.start + row as f64 * dy);
                let high = (x.start + to as f64 * dx, y.start + (row + 1) as f64 * dy);
                plane.draw(&Filled::new([low, high], color.filled()))?;
            }
        }
        Ok(())
    }
}

/// Returns neighbouring cells of the same colour as one: from, to, colour.
fn runs(values: &[f64], scale: &Range<f64>) -> Vec<(usize, usize, Color)> {
    let mut runs: Vec<(usize, usize, Color)> = Vec::new();
    for (i, value) in values.iter().enumerate() {
        let Some(color) = shade(*value, scale) else { continue };
        match runs.last_mut() {
            Some((_, to, last)) if *to == i && *last == color => *to = i + 1,
            _ => runs.push((i, i + 1, color)),
        }
    }
    runs
}

/// Returns the corners of a staircase that keeps each value up to the next point.
#[must_use]
pub fn steps(points: impl IntoIterator<Item = Point>) -> Vec<Point> {
    let mut line: Vec<Point> = Vec::new();
    for (x, y) in points {
        if let Some(&(_, level)) = line.last() {
            line.push((x, level));
        }
        line.push((x, y));
    }
    line
}
