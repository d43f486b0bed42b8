//! The chart of a sweep: a small panel for each fault, a line for each medium.

use leg_charts::{Color, DrawError, Mark, Panel, Sheet, color, percent};

use super::axes::{AXES, Axis, Media};
use super::report::Report;

fn color_of(media: Media) -> Color {
    match media {
        Media::Water => color::BLUE,
        Media::Shore => color::GREEN,
        Media::Land => color::ORANGE,
    }
}

/// Draws a sweep as SVG text.
///
/// # Errors
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(report: &Report) -> Result<String, DrawError> {
    let title = format!(
        "Share of {} runs that still hop after {} hops, by fault",
        report.runs, report.hops
    );
    let note = format!("policy `{}`; the grey line marks the level without a fault", report.policy);
    let panels: Vec<Panel> = AXES.iter().map(|axis| panel(report, axis)).collect();
    let rows = panels.chunks(3).map(<[Panel]>::to_vec).collect();
    Sheet::new(title, note).width_px(1_200).shared_legend().rows(200, rows).draw()
}

fn panel(report: &Report, axis: &Axis) -> Panel {
    let [first, last] = [axis.levels[0], axis.levels[axis.levels.len() - 1]];
    let margin = 0.03 * (last - first);
    let x = leg_charts::Axis::new(axis.unit, first - margin..last + margin);
    let y = leg_charts::Axis::new("", -0.04..1.04).written(percent);
    let none = Mark::line(vec![(axis.none, -0.04), (axis.none, 1.04)], color::GREY);
    let mut panel = Panel::new(axis.name, x, y).with(none.width_px(1.0));
    for media in report.media() {
        let color = color_of(media);
        let points: Vec<_> = report.line(axis, media).map(|row| (row.level, row.share())).collect();
        panel = panel
            .with(Mark::line(points.clone(), color.with_opacity(0.85)).label(media.name()))
            .with(Mark::dots(points, color));
    }
    panel
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robustness::report::Row;

    #[test]
    fn draws_a_dot_for_each_row() {
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
