//! The picture of a recording, over time.

use std::ops::Range;

use plotters::prelude::*;

use super::course::{Course, Line};
use crate::record::schema::EventKind;
use crate::shore::picture::{
    Area, DrawError, FAINT, FONT, INK, LIFTOFF, Panel, TOUCHDOWN, UNITS_PER_PX, WATER, px, steps,
};

const SIZE: (u32, u32) = (px(1_400), px(1_110));
const MARGIN: u32 = px(12);
const LEFT: u32 = px(62);
const SAFE: RGBColor = RGBColor(232, 178, 40);
const GAP: RGBColor = RGBColor(120, 120, 120);
/// Touchdowns and lift-offs are marked one by one up to so many.
const MOST_MARKS: usize = 400;

/// Draws a course as SVG text.
///
/// # Errors
/// When the drawing library cannot lay out a panel.
pub fn draw(course: &Course) -> Result<String, DrawError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(MARGIN, MARGIN, MARGIN, MARGIN);
        let root = root.titled(&course.title, (FONT, px(19)).into_font().color(&INK))?;
        let (height, rest) = root.split_vertically(px(280));
        let (velocity, rest) = rest.split_vertically(px(240));
        let (density, rest) = rest.split_vertically(px(190));
        let (leg_angle, elongation) = rest.split_vertically(px(190));
        draw_height(&height, course)?;
        draw_velocity(&velocity, course)?;
        draw_density(&density, course)?;
        draw_leg_angle(&leg_angle, course)?;
        draw_elongation(&elongation, course)?;
        root.present()?;
    }
    let [width, height] = [SIZE.0, SIZE.1].map(|units| units / UNITS_PER_PX);
    let drawn = format!("width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1);
    Ok(svg.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

/// A range around all values, with some room, that is never empty.
fn around(lines: &[&Line], least: Range<f64>) -> Range<f64> {
    let values = || lines.iter().flat_map(|line| line.iter().map(|p| p.1));
    let low = values().filter(|v| v.is_finite()).fold(least.start, f64::min);
    let high = values().filter(|v| v.is_finite()).fold(least.end, f64::max);
    let room = 0.06 * (high - low);
    low - room..high + room
}

fn panel<'c, 'a>(
    area: &'c Area<'a>,
    course: &Course,
    title: &str,
    label: &str,
    y: Range<f64>,
) -> Result<Panel<'c, 'a>, DrawError> {
    let mut panel = ChartBuilder::on(area)
        .caption(title, (FONT, px(15)).into_font().color(&INK))
        .margin_top(px(4))
        .margin_right(px(16))
        .x_label_area_size(px(34))
        .y_label_area_size(LEFT)
        .build_cartesian_2d(course.span(), y.clone())?;
    // Behind all else: what is not as usual.
    let stretches = |of: &[Range<f64>], style: ShapeStyle| {
        of.iter()
            .map(|t| Rectangle::new([(t.start, y.start), (t.end, y.end)], style))
            .collect::<Vec<_>>()
    };
    panel.draw_series(stretches(&course.safe, SAFE.mix(0.28).filled()))?;
    panel.draw_series(stretches(&course.gaps, GAP.mix(0.35).filled()))?;
    panel
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.mix(0.6))
        .axis_style(INK.mix(0.5))
        .label_style((FONT, px(13)).into_font().color(&INK))
        .x_labels(14)
        .y_labels(5)
        .x_desc("time, s")
        .y_desc(label)
        .draw()?;
    Ok(panel)
}

fn line<B: DrawingBackend>(points: &Line, style: ShapeStyle) -> LineSeries<B, (f64, f64)> {
    LineSeries::new(points.iter().copied(), style)
}

fn draw_height(area: &Area<'_>, course: &Course) -> Result<(), DrawError> {
    let title = "Height of the mass; touchdown (orange), lift-off (green); under a safe command (yellow), not recorded (grey)";
    let y = around(&[&course.height], 0.0..1.2);
    let bottom = y.start;
    let mut panel = panel(area, course, title, "height, m", y)?;
    panel.draw_series(line(&course.height, INK.stroke_width(px(1))))?;
    let marks = course.events.iter().filter(|_| course.events.len() <= MOST_MARKS);
    let colored = marks.filter_map(|event| {
        let color = match event.kind() {
            EventKind::Touchdown => TOUCHDOWN,
            EventKind::LiftOff => LIFTOFF,
            EventKind::Fall | EventKind::Unknown => return None,
        };
        Some((event, color))
    });
    for (event, color) in colored {
        let foot = [(event.t_s, bottom), (event.t_s, event.y_m)];
        panel.draw_series([PathElement::new(foot, color.mix(0.5).stroke_width(px(1)))])?;
        panel.draw_series([Circle::new((event.t_s, event.y_m), px(3), color.filled())])?;
    }
    let falls = course.events.iter().filter(|event| event.kind() == EventKind::Fall);
    panel.draw_series(
        falls.map(|event| Cross::new((event.t_s, event.y_m), px(8), RED.stroke_width(px(3)))),
    )?;
    Ok(())
}

fn draw_velocity(area: &Area<'_>, course: &Course) -> Result<(), DrawError> {
    let title = "Horizontal velocity (grey), at each apex (dots), and the set-point (orange)";
    let at_apex: Line = course.apexes.iter().map(|apex| (apex.t_s, apex.vx_m_s)).collect();
    let range = around(&[&course.velocity, &course.set_point, &at_apex], -0.1..0.3);
    let mut panel = panel(area, course, title, "velocity, m/s", range)?;
    panel.draw_series(line(&course.velocity, INK.mix(0.25).stroke_width(px(1))))?;
    let asked = steps(course.set_point.iter().copied());
    panel.draw_series(LineSeries::new(asked, TOUCHDOWN.stroke_width(px(2))))?;
    panel.draw_series(at_apex.iter().map(|at| Circle::new(*at, px(3), INK.filled())))?;
    Ok(())
}

fn draw_density(area: &Area<'_>, course: &Course) -> Result<(), DrawError> {
    let title = "Density over that of water: true (area), as the controller took it at each apex (dots; rings without an answer)";
    let found: Line = course.apexes.iter().map(|apex| (apex.t_s, apex.density_estimate)).collect();
    let range = around(&[&course.density, &found], 0.0..1.0);
    let mut panel = panel(area, course, title, "density ratio", range)?;
    let truth = steps(course.density.iter().copied());
    panel.draw_series(
        AreaSeries::new(truth, 0.0, WATER.mix(0.25)).border_style(WATER.stroke_width(px(2))),
    )?;
    panel.draw_series(course.apexes.iter().zip(found).map(|(apex, at)| {
        let style = if apex.answered { INK.filled() } else { INK.stroke_width(px(1)) };
        Circle::new(at, px(3), style)
    }))?;
    Ok(())
}

fn draw_leg_angle(area: &Area<'_>, course: &Course) -> Result<(), DrawError> {
    let title =
        "Commanded leg angle from upright, foot ahead above 0; in stance the leg turns freely";
    let range = around(&[&course.leg_angle], -10.0..10.0);
    let mut panel = panel(area, course, title, "leg angle, deg", range)?;
    let angle = steps(course.leg_angle.iter().copied());
    panel.draw_series(LineSeries::new(angle, INK.stroke_width(px(1))))?;
    Ok(())
}

fn draw_elongation(area: &Area<'_>, course: &Course) -> Result<(), DrawError> {
    let range = around(&[&course.elongation], 0.0..10.0);
    let title = "Commanded elongation of the spring";
    let mut panel = panel(area, course, title, "elongation, cm", range)?;
    let elongation = course.elongation.iter().copied();
    panel.draw_series(
        AreaSeries::new(elongation, 0.0, LIFTOFF.mix(0.25))
            .border_style(LIFTOFF.stroke_width(px(1))),
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::schema::{Apex, Event};

    #[test]
    fn every_mark_of_the_course_is_in_the_picture() {
        let ramp = |n: u32| (0..n).map(|i| (0.01 * f64::from(i), f64::from(i % 7))).collect();
        let apex = |t_s: f64| Apex { t_s, answered: t_s < 0.5, ..Apex::default() };
        let event =
            |t_s: f64, kind: EventKind| Event { t_s, kind: kind.into(), ..Event::default() };
        let course = Course {
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
            ..Course::default()
        };
        let svg = draw(&course).unwrap();
        // Two events; each apex in two panels.
        assert_eq!(svg.matches("<circle").count(), 2 + 2 * 2);
        assert!(svg.contains("some.mcap") && svg.contains("elongation, cm"));
        // A safe stretch is shaded in each panel.
        let plain = draw(&Course { safe: Vec::new(), ..course }).unwrap();
        assert_eq!(svg.matches("<rect").count(), plain.matches("<rect").count() + 5);
    }
}
