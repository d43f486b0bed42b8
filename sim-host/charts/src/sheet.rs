//! A sheet: a title, a note, and rows of panels.

use crate::canvas::{Area, DrawError, svg, width_px, write};
use crate::legend::{Legend, ROW_PX};
use crate::mark::Mark;
use crate::panel::{LABEL_PX, LEFT_PX, NUMBERS_PX, Panel, RIGHT_PX};
use crate::units::px;

const MARGIN_PX: f64 = 14.0;
const TITLE_PX: f64 = 16.0;
const NOTE_PX: f64 = 12.0;
const PANEL_TITLE_PX: f64 = 13.0;
/// Room below a row of panels.
const GAP_PX: f64 = 18.0;

/// A sheet of charts.
#[derive(Clone, Debug)]
pub struct Sheet {
    title: String,
    note: String,
    width_px: u32,
    shared_legend: bool,
    rows: Vec<Row>,
}

#[derive(Clone, Debug)]
struct Row {
    height: Height,
    panels: Vec<Panel>,
}

#[derive(Clone, Copy, Debug)]
enum Height {
    Px(u32),
    ToScale,
}

impl Sheet {
    /// Returns a sheet without panels, 1,000 px wide: its title, and below it a note on
    /// how to read it, if that is not empty.
    #[must_use]
    pub fn new(title: impl Into<String>, note: impl Into<String>) -> Self {
        let (title, note) = (title.into(), note.into());
        Self { title, note, width_px: 1_000, shared_legend: false, rows: Vec::new() }
    }

    /// Sets the width, px.
    #[must_use]
    pub fn width_px(mut self, width_px: u32) -> Self {
        self.width_px = width_px;
        self
    }

    /// Puts one legend for all panels below the title, instead of one above each panel.
    #[must_use]
    pub fn shared_legend(mut self) -> Self {
        self.shared_legend = true;
        self
    }

    /// Adds a row of panels of equal width. The height is that of the panels' frames, px,
    /// without title, legend and numbers.
    #[must_use]
    pub fn row(mut self, height_px: u32, panels: Vec<Panel>) -> Self {
        self.rows.push(Row { height: Height::Px(height_px), panels });
        self
    }

    /// Adds several rows of the same height.
    #[must_use]
    pub fn rows(self, height_px: u32, rows: Vec<Vec<Panel>>) -> Self {
        rows.into_iter().fold(self, |sheet, panels| sheet.row(height_px, panels))
    }

    /// Adds a panel as wide as the sheet in which one unit is as long up as across.
    #[must_use]
    pub fn row_to_scale(mut self, panel: Panel) -> Self {
        self.rows.push(Row { height: Height::ToScale, panels: vec![panel] });
        self
    }

    /// Draws the sheet as SVG text.
    ///
    /// # Errors
    /// [`DrawError`] if the drawing library cannot lay it out.
    pub fn draw(&self) -> Result<String, DrawError> {
        let room_px = f64::from(self.width_px) - 2.0 * MARGIN_PX;
        let all: Vec<&Mark> =
            self.rows.iter().flat_map(|row| &row.panels).flat_map(|panel| &panel.marks).collect();
        let shared = if self.shared_legend { all } else { Vec::new() };
        let legend = Legend::new(shared, room_px);
        let note = wrapped(&self.note, room_px);
        let head_px = if self.title.is_empty() { 0.0 } else { TITLE_PX + 8.0 }
            + (NOTE_PX + 4.0) * note.len() as f64
            + ROW_PX * legend.rows() as f64
            + 10.0;
        let heads: Vec<Head<'_>> =
            self.rows.iter().map(|row| Head::of(row, room_px, self.shared_legend)).collect();
        let rows = self.rows.iter().zip(&heads);
        let heights_px: Vec<f64> = rows
            .map(|(row, head)| head.height_px + row.frame_px(room_px) + row.below_px())
            .collect();
        let gaps_px = GAP_PX * self.rows.len().saturating_sub(1) as f64;
        let height_px = 2.0 * MARGIN_PX + head_px + heights_px.iter().sum::<f64>() + gaps_px;
        svg((self.width_px, height_px.ceil() as u32), |root| {
            let margin = px(MARGIN_PX);
            let mut rest = root.margin(margin, 0, margin, margin);
            write(&rest, &self.title, (0.0, 0.0), (TITLE_PX, true))?;
            let mut y_px = if self.title.is_empty() { 0.0 } else { TITLE_PX + 8.0 };
            for line in &note {
                write(&rest, line, (0.0, y_px), (NOTE_PX, false))?;
                y_px += NOTE_PX + 4.0;
            }
            legend.draw(&rest, (0.0, y_px + 3.0))?;
            rest = rest.split_vertically(px(head_px)).1;
            for ((row, head), height_px) in self.rows.iter().zip(&heads).zip(&heights_px) {
                let (area, below) = rest.split_vertically(px(*height_px));
                row.draw(&area, head)?;
                rest = below.split_vertically(px(GAP_PX)).1;
            }
            Ok(())
        })
    }
}

/// Titles and legends of a row: as high as the highest of its panels.
struct Head<'m> {
    height_px: f64,
    title_px: f64,
    legends: Vec<Legend<'m>>,
}

impl<'m> Head<'m> {
    fn of(row: &'m Row, room_px: f64, shared_legend: bool) -> Self {
        let room_px = room_px / row.panels.len() as f64 - LEFT_PX;
        let legend = |panel: &'m Panel| {
            let marks: &[Mark] = if shared_legend { &[] } else { &panel.marks };
            Legend::new(marks, room_px)
        };
        let legends: Vec<Legend<'m>> = row.panels.iter().map(legend).collect();
        let titled = row.panels.iter().any(|panel| !panel.title.is_empty());
        let title_px = if titled { PANEL_TITLE_PX + 7.0 } else { 0.0 };
        let rows = legends.iter().map(Legend::rows).max().unwrap_or(0);
        let height_px = title_px + ROW_PX * rows as f64 + 6.0;
        Self { height_px, title_px, legends }
    }
}

impl Row {
    fn frame_px(&self, room_px: f64) -> f64 {
        match (self.height, &self.panels[..]) {
            (Height::ToScale, [panel]) => {
                let [x, y] = [&panel.x, &panel.y].map(|axis| axis.range.end - axis.range.start);
                (room_px - LEFT_PX - RIGHT_PX) * y / x
            }
            (Height::Px(height_px), _) => f64::from(height_px),
            (Height::ToScale, _) => 0.0,
        }
    }

    fn below_px(&self) -> f64 {
        let labelled = self.panels.iter().any(|panel| !panel.x.label.is_empty());
        NUMBERS_PX + if labelled { LABEL_PX } else { 0.0 }
    }

    fn draw(&self, area: &Area<'_>, head: &Head<'_>) -> Result<(), DrawError> {
        let areas = area.split_evenly((1, self.panels.len()));
        for ((area, panel), legend) in areas.iter().zip(&self.panels).zip(&head.legends) {
            write(area, &panel.title, (LEFT_PX, 0.0), (PANEL_TITLE_PX, true))?;
            legend.draw(area, (LEFT_PX, head.title_px))?;
            let (_, body) = area.split_vertically(px(head.height_px));
            panel.draw(&body, self.below_px())?;
        }
        Ok(())
    }
}

/// Breaks a text into lines that fit.
fn wrapped(text: &str, room_px: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width_px(&format!("{line} {word}"), NOTE_PX) <= room_px => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::color::{BLACK, BLUE, GREEN, INK, ORANGE, RED};

    fn panel(title: &str) -> Panel {
        let (x, y) = (Axis::new("x, m", 0.0..2.0), Axis::new("y, m", 0.0..1.0));
        Panel::new(title, x, y)
    }

    #[test]
    fn draws_every_mark_and_puts_labels_into_the_legend() {
        let panel = panel("a <panel>")
            .with(Mark::cells(
                (0.0..2.0, 0.0..1.0),
                2,
                vec![0.0, 1.0, f64::NAN, 1.0],
                0.0..1.0,
                "reward",
            ))
            .with(Mark::line(vec![(0.0, 0.0), (f64::NAN, 0.0), (2.0, 1.0)], BLUE).label("ours"))
            .with(Mark::band(vec![(0.0, 0.1, 0.2), (1.0, 0.2, 0.3)], BLUE))
            .with(Mark::area(vec![(0.0, 0.1), (1.0, 0.2)], 0.0, GREEN))
            .with(Mark::dots(vec![(0.5, 0.5), (0.5, f64::NAN)], BLACK).label("the authors'"))
            .with(Mark::dots(vec![(0.7, 0.5)], BLACK).as_rings())
            .with(Mark::crosses(vec![(0.5, 0.7)], RED).label("falls"))
            .with(Mark::bars(vec![(0.0, 1.0, 0.4)], ORANGE))
            .with(Mark::boxes(vec![[(0.0, 0.1), (0.5, 0.3)]], INK).label("quartiles"))
            .with(Mark::segments(vec![[(0.0, 0.1), (0.5, 0.3)]], GREEN).dashed())
            .with(Mark::guide(vec![(0.0, 1.0), (2.0, 1.0)]));
        let sheet = Sheet::new("A sheet", "how to read it").row(200, vec![panel.clone(), panel]);
        let svg = sheet.draw().unwrap();
        assert_eq!(svg, sheet.draw().unwrap());
        for text in
            ["A sheet", "how to", "a &lt;panel&gt;", "ours", "the authors", "x, m", "reward"]
        {
            assert!(svg.contains(text), "{text}");
        }
        // A dot and its entry in the legend, and a ring, in each panel.
        assert_eq!(svg.matches("<circle").count(), 2 * 3);
        // A band and an area in each.
        assert_eq!(svg.matches("<polygon").count(), 2 * 2);
        // Yellow: the two cells at the top of the scale, in each panel, and its end.
        assert!(svg.matches("#FDE725").count() >= 4);
    }

    #[test]
    fn a_shared_legend_names_each_label_once() {
        let with = |label: &str| {
            panel("").with(Mark::line(vec![(0.0, 0.0), (1.0, 1.0)], BLUE).label(label))
        };
        let sheet = Sheet::new("", "").row(100, vec![with("a"), with("a"), with("b")]);
        let lines = |sheet: Sheet| {
            let svg = sheet.draw().unwrap();
            ["\na\n", "\nb\n"].map(|label| svg.matches(label).count())
        };
        assert_eq!(lines(sheet.clone()), [2, 1]);
        assert_eq!(lines(sheet.shared_legend()), [1, 1]);
    }

    #[test]
    fn long_legends_and_notes_take_more_rows() {
        let long = "a label that names what was trained, at length";
        let label = |i| format!("{i}: {long}");
        let marks: Vec<Mark> =
            (0..6).map(|i| Mark::line(vec![(0.0, 0.0)], BLUE).label(label(i))).collect();
        assert_eq!(Legend::new(&marks, 1_000.0).rows(), 3);
        assert_eq!(Legend::new(&marks, 10.0).rows(), 6);
        assert_eq!(wrapped(&[long; 6].join(" "), 1_000.0).len(), 2);
    }

    #[test]
    fn to_scale_a_unit_is_as_long_up_as_across() {
        let row = Row { height: Height::ToScale, panels: vec![panel("")] };
        let across_px = 1_000.0 - LEFT_PX - RIGHT_PX;
        assert_eq!(row.frame_px(1_000.0), across_px / 2.0);
    }
}
