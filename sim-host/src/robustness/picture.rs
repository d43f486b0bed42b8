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
        "Share of {} runs that still hop after {} hops, by fault and sensors",
        report.runs, report.hops
    );
    let other = report
        .against
        .as_ref()
        .map_or(String::new(), |against| format!("; dashed lines: policy `{}`", against.policy));
    let note =
        format!("policy `{}`{other}; the grey line marks the level without a fault", report.policy);
    let panels: Vec<Panel> = AXES.iter().map(|axis| panel(report, axis)).collect();
    let rows = panels.chunks(3).map(<[Panel]>::to_vec).collect();
    Sheet::new(title, note).width_px(1_200).shared_legend().rows(200, rows).draw()
}

fn panel(report: &Report, axis: &Axis) -> Panel {
    let [first, last] = [axis.levels[0], axis.levels[axis.levels.len() - 1]];
    let margin = 0.03 * (last - first);
    let mut x = leg_charts::Axis::new(axis.unit, first - margin..last + margin);
    if let Some(names) = axis.names() {
        x = x.with_ticks(names);
    }
    let y = leg_charts::Axis::new("", -0.04..1.04).written(percent);
    let mut panel = Panel::new(axis.name, x, y);
    if let Some(none) = axis.none {
        let line = Mark::line(vec![(none, -0.04), (none, 1.04)], color::GREY);
        panel = panel.with(line.width_px(1.0));
    }
    for media in report.media() {
        let color = color_of(media);
        let points: Vec<_> = report.line(axis, media).map(|row| (row.level, row.share())).collect();
        panel = panel
            .with(Mark::line(points.clone(), color.with_opacity(0.85)).label(media.name()))
            .with(Mark::dots(points, color));
        if let Some(against) = &report.against {
            let rows = report.line(axis, media).filter_map(|row| against.row(row));
            let points = rows.map(|row| (row.level, row.other)).collect();
            panel = panel.with(Mark::line(points, color.with_opacity(0.85)).dashed());
        }
    }
    panel
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robustness::Comparison;
    use crate::robustness::report::Row;

    #[test]
    fn draws_a_dot_for_each_row() {
        let media = [Media::Water, Media::Land];
        let rows = media.into_iter().flat_map(|media| {
            AXES.iter().flat_map(move |axis| {
                axis.levels.iter().map(move |&level| Row {
                    fault: axis.name.into(),
                    level,
                    media,
                    runs: 4,
                    hopping: 3,
                    fallen: Some(vec![1]),
                })
            })
        });
        let (policy, rows) = ("p".to_owned(), rows.collect());
        let mut report = Report { policy, hops: 30, runs: 4, rows, against: None };
        let svg = draw(&report).unwrap();
        assert_eq!(svg.matches("<circle").count(), report.rows.len());
        assert!(AXES.iter().all(|axis| svg.contains(axis.unit)));
        assert_eq!(report.csv().lines().count(), 1 + report.rows.len());
        assert!(report.csv().contains("delay,6,land,4,3,0.75"), "{}", report.csv());
        assert!(report.to_string().contains("75 %"));
        report.against = Some(Comparison::new(&report, &report.clone()).unwrap());
        let beside = draw(&report).unwrap();
        assert_eq!(beside.matches("<circle").count(), report.rows.len());
        assert!(beside.contains("dashed lines: policy `p`") && beside.len() > svg.len());
        assert!(report.csv().contains("delay,6,land,4,3,0.75,0.75,0,-"), "{}", report.csv());
    }
}
