//! The chart of a recording over time.

use std::ops::Range;

use leg_charts::{Axis, Color, DrawError, Mark, Panel, Sheet, color, steps};

use leg_host::estimate::chart::Line;

use super::data::PlotData;
use crate::record::schema::{Event, EventKind};

/// Touchdowns and lift-offs are marked one by one up to this many events.
const MOST_MARKS: usize = 400;

/// Draws a data as SVG text.
///
/// # Errors
/// [`DrawError`] if the drawing library cannot lay out a panel.
pub fn draw(data: &PlotData) -> Result<String, DrawError> {
    Sheet::new(&data.title, "")
        .width_px(1_400)
        .row(200, vec![height(data)])
        .row(160, vec![velocity(data)])
        .row(120, vec![density(data)])
        .row(120, vec![leg_angle(data)])
        .row(120, vec![elongation(data)])
        .rows(150, data.estimates.rows(&data.span()))
        .draw()
}

/// Returns an axis that holds `least` and all values, with some room.
fn around(label: &str, least: Range<f64>, lines: &[&Line]) -> Axis {
    let values = lines.iter().flat_map(|line| line.iter().map(|point| point.1));
    Axis::around(label, values.chain([least.start, least.end]))
}

/// Returns a panel over the data's time. Stretches that are not as usual are shaded.
fn panel(data: &PlotData, title: &str, y: Axis, is_last: bool) -> Panel {
    let shaded = |stretches: &[Range<f64>], color: Color, label: &str| {
        let corners =
            stretches.iter().map(|t| [(t.start, y.range.start), (t.end, y.range.end)]).collect();
        let shades = Mark::shades(corners, color);
        if stretches.is_empty() { shades } else { shades.label(label) }
    };
    let safe = shaded(&data.safe, color::YELLOW.with_opacity(0.28), "safe command");
    let gaps = shaded(&data.gaps, color::GREY.with_opacity(0.3), "not recorded");
    let x = Axis::new(if is_last { "time, s" } else { "" }, data.span());
    Panel::new(title, x, y).with(safe).with(gaps)
}

fn height(data: &PlotData) -> Panel {
    let y = around("height, m", 0.0..1.2, &[&data.height]);
    let bottom = y.range.start;
    let mut panel = panel(data, "Height of the mass", y, false)
        .with(Mark::line(data.height.clone(), color::INK).width_px(1.0));
    let of_kind = |kind: EventKind| -> Vec<&Event> {
        data.events.iter().filter(|event| event.kind() == kind).collect()
    };
    for (kind, color, label) in [
        (EventKind::Touchdown, color::ORANGE, "touchdown"),
        (EventKind::LiftOff, color::GREEN, "lift-off"),
    ] {
        let events = of_kind(kind);
        if events.is_empty() || data.events.len() > MOST_MARKS {
            continue;
        }
        let stems = events.iter().map(|e| [(e.t_s, bottom), (e.t_s, e.y_m)]).collect();
        let dots = events.iter().map(|e| (e.t_s, e.y_m)).collect();
        panel = panel
            .with(Mark::segments(stems, color.with_opacity(0.5)).width_px(1.0))
            .with(Mark::dots(dots, color).label(label));
    }
    let falls = of_kind(EventKind::Fall);
    if falls.is_empty() {
        return panel;
    }
    let falls = falls.into_iter().map(|event| (event.t_s, event.y_m)).collect();
    panel.with(Mark::crosses(falls, color::RED).radius_px(8.0).label("fall"))
}

fn velocity(data: &PlotData) -> Panel {
    let at_apex: Line = data.apexes.iter().map(|apex| (apex.t_s, apex.vx_m_s)).collect();
    let lines = [&data.velocity, &data.set_point, &at_apex];
    let y = around("velocity, m/s", -0.1..0.3, &lines);
    let set_point = steps(data.set_point.iter().copied());
    panel(data, "Horizontal velocity", y, false)
        .with(
            Mark::line(data.velocity.clone(), color::INK.with_opacity(0.25))
                .width_px(1.0)
                .label("at each tick"),
        )
        .with(Mark::line(set_point, color::ORANGE).label("set-point"))
        .with(Mark::dots(at_apex, color::INK).label("at each apex"))
}

fn density(data: &PlotData) -> Panel {
    let estimates = |answered: bool| -> Line {
        let apexes = data.apexes.iter().filter(|apex| apex.answered == answered);
        apexes.map(|apex| (apex.t_s, apex.density_estimate)).collect()
    };
    let [answered, unanswered] = [estimates(true), estimates(false)];
    let y = around("density ratio", 0.0..1.0, &[&data.density, &answered, &unanswered]);
    let truth = steps(data.density.iter().copied());
    let panel = panel(data, "Density of the medium over that of water", y, false)
        .with(Mark::area(truth, 0.0, color::BLUE).label("true"))
        .with(Mark::dots(answered, color::INK).label("used by the controller at each apex"));
    if unanswered.is_empty() {
        return panel;
    }
    panel.with(Mark::dots(unanswered, color::INK).as_rings().label("without a reply"))
}

fn leg_angle(data: &PlotData) -> Panel {
    let title = "Commanded leg angle from upright, positive with the foot ahead";
    let y = around("leg angle, deg", -10.0..10.0, &[&data.leg_angle]);
    let angle = steps(data.leg_angle.iter().copied());
    panel(data, title, y, false).with(Mark::line(angle, color::INK).width_px(1.0))
}

fn elongation(data: &PlotData) -> Panel {
    let y = around("elongation, cm", 0.0..10.0, &[&data.elongation]);
    panel(data, "Commanded elongation of the spring", y, true).with(Mark::area(
        data.elongation.clone(),
        0.0,
        color::GREEN,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::schema::{Apex, Event};

    #[test]
    fn draws_every_mark_of_the_course() {
        let ramp = |n: u32| (0..n).map(|i| (0.01 * f64::from(i), f64::from(i % 7))).collect();
        let apex = |t_s: f64| Apex { t_s, answered: t_s < 0.5, ..Apex::default() };
        let event =
            |t_s: f64, kind: EventKind| Event { t_s, kind: kind.into(), ..Event::default() };
        let data = PlotData {
            title: "some.mcap".to_owned(),
            height: ramp(100),
            velocity: ramp(100),
            set_point: vec![(0.0, 1.0), (0.99, 1.0)],
            density: vec![(0.0, 1.0), (0.5, 0.0), (0.99, 0.0)],
            leg_angle: ramp(100),
            elongation: ramp(100),
            apexes: vec![apex(0.2), apex(0.7)],
            events: vec![
                event(0.3, EventKind::Touchdown),
                event(0.4, EventKind::LiftOff),
                event(0.9, EventKind::Fall),
            ],
            safe: vec![0.0..0.1],
            ..PlotData::default()
        };
        let svg = draw(&data).unwrap();
        // Two events, each apex in two panels, and five entries of legends.
        assert_eq!(svg.matches("<circle").count(), 2 + 2 * 2 + 5);
        assert!(svg.contains("some.mcap") && svg.contains("elongation, cm"));
        // A safe stretch is shaded in each panel, and explained above each.
        let plain = draw(&PlotData { safe: Vec::new(), ..data }).unwrap();
        assert_eq!(svg.matches("<rect").count(), plain.matches("<rect").count() + 2 * 5);
    }
}
