//! Legends: which mark is which, in rows.

use plotters::element::{Circle, Cross, Rectangle};

use crate::canvas::{Area, DrawError, rule, width_px, write};
use crate::mark::{Mark, Shape};
use crate::units::px;

pub(crate) const ROW_PX: f64 = 18.0;
const SIZE_PX: f64 = 11.0;
const SWATCH_PX: f64 = 18.0;
const GAP_PX: f64 = 16.0;

/// Entries laid out in rows, as wide as there is room.
pub(crate) struct Legend<'m> {
    entries: Vec<Entry<'m>>,
}

struct Entry<'m> {
    mark: &'m Mark,
    text: &'m str,
    row: usize,
    x_px: f64,
}

impl<'m> Legend<'m> {
    /// Lays out all marks with a label; of equal labels the first is shown.
    pub(crate) fn new(marks: impl IntoIterator<Item = &'m Mark>, room_px: f64) -> Self {
        let mut entries: Vec<Entry<'m>> = Vec::new();
        let (mut row, mut x_px) = (0, 0.0);
        for mark in marks {
            let Some(text) = mark.label.as_deref() else { continue };
            if entries.iter().any(|entry| entry.text == text) {
                continue;
            }
            let width = SWATCH_PX + 6.0 + width_px(text, SIZE_PX);
            if x_px > 0.0 && x_px + width > room_px {
                (row, x_px) = (row + 1, 0.0);
            }
            entries.push(Entry { mark, text, row, x_px });
            x_px += width + GAP_PX;
        }
        Self { entries }
    }

    pub(crate) fn rows(&self) -> usize {
        self.entries.last().map_or(0, |entry| entry.row + 1)
    }

    pub(crate) fn draw(&self, area: &Area<'_>, (x, y): (f64, f64)) -> Result<(), DrawError> {
        for entry in &self.entries {
            let (x, y) = (x + entry.x_px, y + ROW_PX * entry.row as f64);
            entry.draw_swatch(area, (x, y + 0.5 * SIZE_PX))?;
            write(area, entry.text, (x + SWATCH_PX + 6.0, y), (SIZE_PX, false))?;
        }
        Ok(())
    }
}

impl Entry<'_> {
    /// Draws the mark in small, to the right of a place.
    fn draw_swatch(&self, area: &Area<'_>, (x, y): (f64, f64)) -> Result<(), DrawError> {
        let color = self.mark.color;
        let (end, middle) = (x + SWATCH_PX, x + 0.5 * SWATCH_PX);
        let corners = [(px(x), px(y - 5.0)), (px(end), px(y + 5.0))];
        match &self.mark.shape {
            Shape::Line { width_px, dashed, .. } | Shape::Segments { width_px, dashed, .. } => {
                let parts: &[[f64; 2]] =
                    if *dashed { &[[0.0, 5.0], [6.5, 11.5], [13.0, 18.0]] } else { &[[0.0, 18.0]] };
                for [from, to] in parts {
                    rule(area, [(x + from, y), (x + to, y)], (color, width_px.max(1.5)))?;
                }
            }
            Shape::Dots { radius_px, rings, .. } => {
                let style = if *rings { color.stroke(1.0) } else { color.filled() };
                area.draw(&Circle::new((px(middle), px(y)), px(*radius_px), style))?;
            }
            Shape::Crosses { radius_px, .. } => {
                let style = color.stroke(2.0);
                area.draw(&Cross::new((px(middle), px(y)), px(*radius_px), style))?;
            }
            Shape::Area { .. } | Shape::Band(_) => {
                area.draw(&Rectangle::new(corners, color.with_opacity(0.2).filled()))?;
            }
            Shape::Boxes(_) => {
                area.draw(&Rectangle::new(corners, color.with_opacity(0.12).filled()))?;
                let [top, bottom] = [y - 5.0, y + 5.0];
                for ends in [
                    [(x, top), (end, top)],
                    [(end, top), (end, bottom)],
                    [(end, bottom), (x, bottom)],
                    [(x, bottom), (x, top)],
                ] {
                    rule(area, ends, (color.with_opacity(0.35), 1.0))?;
                }
            }
            Shape::Shades(_) | Shape::Cells(_) => {
                area.draw(&Rectangle::new(corners, color.filled()))?;
            }
        }
        Ok(())
    }
}
