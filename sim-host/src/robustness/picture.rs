//! The picture of the sweep: a small panel for each fault, a line for each
//! medium.

use std::ops::Range;

use plotters::prelude::*;

use super::report::{Report, Row};
use super::sweep::{AXES, Axis, Media};

type DrawError = Box<dyn std::error::Error + Send + Sync>;
type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// The library draws on whole units: several of them a pixel make lines smooth.
const UNITS_PER_PX: u32 = 4;
const SIZE: (u32, u32) = (px(1_200), px(660));
const FONT: &str = "sans-serif";
const INK: RGBColor = RGBColor(38, 44, 56);
const FAINT: RGBColor = RGBColor(214, 218, 226);

const fn px(pixels: u32) -> u32 {
    UNITS_PER_PX * pixels
}

fn colour(media: Media) -> RGBColor {
    match media {
        Media::Water => RGBColor(40, 116, 190),
        Media::Shore => RGBColor(20, 138, 118),
        Media::Land => RGBColor(214, 96, 38),
    }
}

/// Draws a sweep as SVG text.
///
/// # Errors
/// When the drawing library cannot lay out a panel.
pub fn draw(report: &Report) -> Result<String, DrawError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(px(10), px(10), px(10), px(16));
        let (head, body) = root.split_vertically(px(58));
        draw_head(&head, report)?;
        for (area, axis) in body.split_evenly((2, 3)).iter().zip(&AXES) {
            draw_panel(area, report, axis)?;
        }
        root.present()?;
    }
    let [width, height] = [SIZE.0, SIZE.1].map(|units| units / UNITS_PER_PX);
    let drawn = format!("width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1);
    Ok(svg.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

fn draw_head(area: &Area<'_>, report: &Report) -> Result<(), DrawError> {
    let title = format!(
        "What the policy stands: share of {} runs still hopping after {} hops",
        report.runs, report.hops
    );
    let font = |size| (FONT, px(size)).into_font().color(&INK);
    area.draw(&Text::new(title, (px(8).cast_signed(), px(4).cast_signed()), font(20)))?;
    for (i, media) in report.media().into_iter().enumerate() {
        let x = px(12 + 90 * i as u32).cast_signed();
        let y = px(42).cast_signed();
        let line = [(x, y), (x + px(22).cast_signed(), y)];
        area.draw(&PathElement::new(line, colour(media).stroke_width(px(3))))?;
        let at = (x + px(28).cast_signed(), y - px(8).cast_signed());
        area.draw(&Text::new(media.name(), at, font(15)))?;
    }
    Ok(())
}

fn draw_panel(area: &Area<'_>, report: &Report, axis: &Axis) -> Result<(), DrawError> {
    let [first, last] = [axis.levels[0], axis.levels[axis.levels.len() - 1]];
    let margin = 0.03 * (last - first);
    let x: Range<f64> = first - margin..last + margin;
    let mut panel = ChartBuilder::on(area)
        .caption(axis.name, (FONT, px(17)).into_font().color(&INK))
        .margin_right(px(14))
        .margin_bottom(px(12))
        .x_label_area_size(px(40))
        .y_label_area_size(px(48))
        .build_cartesian_2d(x, -4.0..104.0)?;
    panel
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.mix(0.6))
        .axis_style(INK.mix(0.5))
        .label_style((FONT, px(12)).into_font().color(&INK))
        .x_labels(7)
        .y_labels(6)
        .y_label_formatter(&|share| format!("{share:.0} %"))
        .x_desc(axis.unit)
        .draw()?;
    let none = [(axis.none, -4.0), (axis.none, 104.0)];
    panel.draw_series([PathElement::new(none, FAINT.stroke_width(px(2)))])?;
    for media in report.media() {
        let colour = colour(media);
        let points = || report.line(axis, media).map(|row: &Row| (row.level, 100.0 * row.share()));
        panel.draw_series(LineSeries::new(points(), colour.mix(0.85).stroke_width(px(2))))?;
        panel.draw_series(points().map(|at| Circle::new(at, px(3), colour.filled())))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_its_dot() {
        let media = [Media::Water, Media::Land];
        let rows = media.into_iter().flat_map(|media| {
            AXES.iter().flat_map(move |axis| {
                axis.levels.into_iter().map(move |level| Row {
                    fault: axis.name,
                    level,
                    media,
                    runs: 4,
                    hopping: 3,
                })
            })
        });
        let report = Report { policy: "p".to_owned(), hops: 30, runs: 4, rows: rows.collect() };
        let svg = draw(&report).unwrap();
        assert_eq!(svg.matches("<circle").count(), report.rows.len());
        assert!(AXES.iter().all(|axis| svg.contains(axis.unit)));
        assert_eq!(report.csv().lines().count(), 1 + report.rows.len());
        assert!(report.csv().contains("delay,6,land,4,3,0.75"), "{}", report.csv());
        assert!(report.to_string().contains("75 %"));
    }
}
