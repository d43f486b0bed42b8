//! A panel: two axes, a grid, and marks.

use std::ops::Range;

use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::types::RangedCoordf64;
use plotters::element::{EmptyElement, PathElement, Rectangle, Text};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{FontTransform, IntoTextStyle as _};

use crate::axis::{Axis, number};
use crate::canvas::{Area, DrawError, Plane, text, write};
use crate::color::{GRID, INK, SHADES, shade};
use crate::mark::{Mark, Shape};
use crate::units::{px, to_px};

/// Room to the left of a frame, for the vertical axis.
pub(crate) const LEFT_PX: f64 = 58.0;
/// Room to the right of a frame.
pub(crate) const RIGHT_PX: f64 = 14.0;
/// Room to the right of a frame with coloured cells, for their scale.
const SCALE_PX: f64 = 64.0;
/// Room below a frame for numbers, and that for the axis' label below them.
pub(crate) const NUMBERS_PX: f64 = 20.0;
pub(crate) const LABEL_PX: f64 = 16.0;

const TEXT_PX: f64 = 11.0;
const TICK_PX: f64 = 4.0;
/// Room that a tick takes: across for a number of usual length, and up.
const TICK_ROOM_PX: (f64, f64) = (52.0, 30.0);

/// A panel of a sheet: a title, two axes, and marks that are drawn in their order.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Stands above the frame; none if empty.
    pub title: String,
    /// The axis across.
    pub x: Axis,
    /// The axis up.
    pub y: Axis,
    /// What is drawn.
    pub marks: Vec<Mark>,
}

impl Panel {
    /// Returns a panel without marks.
    #[must_use]
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, marks: Vec::new() }
    }

    /// Returns the panel with one more mark.
    #[must_use]
    pub fn with(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }

    /// Draws frame, axes and marks into an area that has room for the axes' numbers.
    pub(crate) fn draw(&self, area: &Area<'_>, below_px: f64) -> Result<(), DrawError> {
        let cells = self.marks.iter().find_map(|mark| match &mark.shape {
            Shape::Cells(cells) => Some(cells),
            _ => None,
        });
        let (width, height) = area.dim_in_pixel();
        let right = px(RIGHT_PX + if cells.is_some() { SCALE_PX } else { 0.0 });
        let frame =
            area.margin(0, px(below_px).cast_unsigned(), px(LEFT_PX).cast_unsigned(), right);
        let (x, y) = frame.get_pixel_range();
        let plane = frame.apply_coord_spec(Cartesian2d::<RangedCoordf64, RangedCoordf64>::new(
            self.x.range.clone(),
            self.y.range.clone(),
            (x, y.end..y.start),
        ));
        for mark in self.marks.iter().filter(|mark| mark.is_below_grid()) {
            mark.draw(&plane)?;
        }
        self.draw_axes(&plane, &frame, cells.is_none())?;
        for mark in self.marks.iter().filter(|mark| !mark.is_below_grid()) {
            mark.draw(&plane)?;
        }
        let middle = |range: i32| range / 2;
        let (frame_width, frame_height) = frame.dim_in_pixel();
        let style = text(TEXT_PX, false, (HPos::Center, VPos::Bottom));
        let at = (px(LEFT_PX) + middle(frame_width.cast_signed()), height.cast_signed());
        area.draw(&Text::new(self.x.label.clone(), at, style))?;
        let style = text(TEXT_PX, false, (HPos::Center, VPos::Top))
            .transform(FontTransform::Rotate270)
            .into_text_style(area);
        let at = (px(8.0), middle(frame_height.cast_signed()));
        area.draw(&Text::new(self.y.label.clone(), at, style))?;
        if let Some(cells) = cells {
            let (_, beside) = area.split_horizontally(width.cast_signed() - px(SCALE_PX));
            draw_scale(&beside, to_px(frame_height), &cells.scale, &cells.label)?;
        }
        Ok(())
    }

    /// Draws grid lines, the two axes, ticks and numbers.
    fn draw_axes(&self, plane: &Plane<'_>, frame: &Area<'_>, grid: bool) -> Result<(), DrawError> {
        let (width, height) = frame.dim_in_pixel();
        let most = |units: u32, room_px: f64| (to_px(units) / room_px) as usize + 1;
        let (x, y) = (&self.x.range, &self.y.range);
        let line = |ends: [(f64, f64); 2], style| plane.draw(&PathElement::new(ends, style));
        let beside = text(TEXT_PX, false, (HPos::Right, VPos::Center));
        for (value, number) in self.y.ticks(most(height, TICK_ROOM_PX.1).max(3)) {
            if grid {
                line([(x.start, value), (x.end, value)], GRID.stroke(1.0))?;
            }
            let words = Text::new(number, (-px(7.0), 0), beside.clone());
            plane.draw(&(EmptyElement::at((x.start, value)) + words))?;
        }
        let below = text(TEXT_PX, false, (HPos::Center, VPos::Top));
        let axis = INK.with_opacity(0.6).stroke(1.0);
        for (value, number) in self.x.ticks(most(width, TICK_ROOM_PX.0).max(3)) {
            let tick = PathElement::new([(0, 0), (0, px(TICK_PX))], axis);
            let words = Text::new(number, (0, px(TICK_PX + 2.0)), below.clone());
            plane.draw(&(EmptyElement::at((value, y.start)) + tick + words))?;
        }
        line([(x.start, y.start), (x.end, y.start)], axis)?;
        Ok(())
    }
}

/// Draws the scale of coloured cells.
fn draw_scale(
    area: &Area<'_>,
    frame_px: f64,
    scale: &Range<f64>,
    label: &str,
) -> Result<(), DrawError> {
    let (top, bottom) = (20.0, frame_px);
    for i in 0..SHADES {
        let share = |i: u32| f64::from(i) / f64::from(SHADES);
        let y = |i: u32| px(bottom - (bottom - top) * share(i));
        let value = scale.start + share(i) * (scale.end - scale.start);
        let Some(color) = shade(value, scale) else { continue };
        area.draw(&Rectangle::new([(px(2.0), y(i)), (px(14.0), y(i + 1))], color.filled()))?;
    }
    let middle = f64::midpoint(scale.start, scale.end);
    let places = [top, f64::midpoint(top, bottom), bottom];
    for (value, y) in [scale.end, middle, scale.start].into_iter().zip(places) {
        // Two decimals: there is no room for more beside the next panel.
        let value = (value * 100.0).round() / 100.0;
        write(area, &number(value), (19.0, y - 5.0), (TEXT_PX, false))?;
    }
    write(area, label, (0.0, 0.0), (TEXT_PX, false))
}
