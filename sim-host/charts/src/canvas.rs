//! The drawing library's canvas: units, text, and the finished SVG.

use std::error::Error;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::FontStyle;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::color::Color as Ink;
use crate::color::INK;
use crate::units::{UNITS_PER_PX, px};

/// A rectangle of the canvas.
pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// The plane between two axes.
pub(crate) type Plane<'a> =
    DrawingArea<SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The library writes sizes divided by this into the SVG.
const FONT_SCALE: f64 = 1.24;
const FONT: &str = "Helvetica, Arial, sans-serif";

/// The drawing library could not lay out a sheet.
#[derive(Debug)]
pub struct DrawError(Box<dyn Error + Send + Sync>);

impl std::fmt::Display for DrawError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "cannot lay out the chart: {}", self.0)
    }
}

impl Error for DrawError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        Some(self.0.as_ref())
    }
}

impl<E: Error + Send + Sync + 'static> From<DrawingAreaErrorKind<E>> for DrawError {
    fn from(cause: DrawingAreaErrorKind<E>) -> Self {
        Self(Box::new(cause))
    }
}

/// Draws on a white canvas and returns it as SVG text.
pub(crate) fn svg(
    (width_px, height_px): (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<(), DrawError>,
) -> Result<String, DrawError> {
    let [width, height] = [width_px, height_px].map(|side| px(side.into()).cast_unsigned());
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        draw(&root)?;
        root.present()?;
    }
    let drawn = format!("width=\"{width}\" height=\"{height}\"");
    let shown = format!("width=\"{width_px}\" height=\"{height_px}\"");
    // Antialiased edges of touching rectangles would show as seams.
    let style = "><style>rect{shape-rendering:crispEdges}</style>";
    Ok(svg.replacen(&drawn, &shown, 1).replacen('>', style, 1))
}

/// Returns a text style: the size in pixels, and where the text lies beside its anchor.
pub(crate) fn text(size_px: f64, bold: bool, pos: (HPos, VPos)) -> TextStyle<'static> {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    let size = size_px * UNITS_PER_PX * FONT_SCALE;
    let mut text = TextStyle::from((FONT, size, style).into_font()).pos(Pos::new(pos.0, pos.1));
    text.color = INK.as_rgb().to_backend_color();
    text
}

/// Writes a line of text to the right of and below a place, px.
pub(crate) fn write(
    area: &Area<'_>,
    words: &str,
    (x_px, y_px): (f64, f64),
    (size_px, bold): (f64, bool),
) -> Result<(), DrawError> {
    let style = text(size_px, bold, (HPos::Left, VPos::Top));
    area.draw(&Text::new(words.to_owned(), (px(x_px), px(y_px)), style))?;
    Ok(())
}

/// Draws a straight line, px.
pub(crate) fn rule(
    area: &Area<'_>,
    ends_px: [(f64, f64); 2],
    (color, width_px): (Ink, f64),
) -> Result<(), DrawError> {
    let ends = ends_px.map(|(x, y)| (px(x), px(y)));
    area.draw(&PathElement::new(ends, color.stroke(width_px)))?;
    Ok(())
}

/// Estimates the width of a text, px, with room to spare in any usual font.
pub(crate) fn width_px(words: &str, size_px: f64) -> f64 {
    0.56 * size_px * words.chars().count() as f64
}
