//! The picture of the shore: how the leg went, how fast, and what it felt.

use super::track::{LegPose, Point, Track};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::ops::Range;

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(crate) type Panel<'c, 'a> =
    ChartContext<'c, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
pub(crate) type DrawError = Box<dyn std::error::Error + Send + Sync>;

/// The library draws on whole units: several of them a pixel make curves smooth.
pub(crate) const UNITS_PER_PX: u32 = 4;
const SIZE: (u32, u32) = (px(1_400), px(780));
const MARGIN: u32 = px(12);
const LEFT: u32 = px(62);
pub(crate) const FONT: &str = "sans-serif";

pub(crate) const INK: RGBColor = RGBColor(38, 44, 56);
pub(crate) const FAINT: RGBColor = RGBColor(214, 218, 226);
pub(crate) const WATER: RGBColor = RGBColor(40, 116, 190);
pub(crate) const TOUCHDOWN: RGBColor = RGBColor(214, 96, 38);
pub(crate) const LIFTOFF: RGBColor = RGBColor(20, 138, 118);
const GROUND: RGBColor = RGBColor(196, 178, 142);

pub(crate) const fn px(pixels: u32) -> u32 {
    UNITS_PER_PX * pixels
}

/// Draws a run as SVG text; `density_at` gives the medium's density ratio at
/// a place, m.
///
/// # Errors
/// When the drawing library cannot lay out a panel.
pub fn draw(track: &Track, density_at: impl Fn(f64) -> f64) -> Result<String, DrawError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(MARGIN, MARGIN, MARGIN, MARGIN);
        let x = extent(track);
        let (top, rest) = root.split_vertically(path_height(track, &x));
        let (middle, bottom) = rest.split_vertically(px(250));
        draw_path(&top, track, &x, &density_at)?;
        draw_velocity(&middle, track, &x)?;
        draw_density(&bottom, track, &x, &density_at)?;
        root.present()?;
    }
    let [width, height] = [SIZE.0, SIZE.1].map(|units| units / UNITS_PER_PX);
    let drawn = format!("width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1);
    Ok(svg.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

/// The places that the picture covers, m.
fn extent(track: &Track) -> Range<f64> {
    let xs = || track.path.iter().map(|p| p.0);
    let low = xs().fold(0.0, f64::min).floor() - 0.5;
    let high = xs().fold(1.0, f64::max).ceil() + 0.5;
    low..high
}

fn ceiling_m(track: &Track) -> f64 {
    track.path.iter().map(|p| p.1).fold(1.5, f64::max) + 0.3
}

/// Height of the path's panel such that a metre is as long up as along.
fn path_height(track: &Track, x: &Range<f64>) -> u32 {
    let units_per_m = f64::from(SIZE.0 - 2 * MARGIN - LEFT) / (x.end - x.start);
    ((ceiling_m(track) + 0.15) * units_per_m) as u32 + px(78)
}

fn panel<'c, 'a>(
    area: &'c Area<'a>,
    title: &str,
    x: &Range<f64>,
    y: Range<f64>,
) -> Result<Panel<'c, 'a>, DrawError> {
    Ok(ChartBuilder::on(area)
        .caption(title, (FONT, px(17)).into_font().color(&INK))
        .margin_top(px(6))
        .x_label_area_size(px(38))
        .y_label_area_size(LEFT)
        .build_cartesian_2d(x.clone(), y)?)
}

fn mesh(panel: &mut Panel<'_, '_>, y: &str, y_labels: usize) -> Result<(), DrawError> {
    panel
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.mix(0.6))
        .axis_style(INK.mix(0.5))
        .label_style((FONT, px(13)).into_font().color(&INK))
        .x_labels(12)
        .y_labels(y_labels)
        .x_desc("distance, m")
        .y_desc(y)
        .draw()?;
    Ok(())
}

fn draw_path(
    area: &Area<'_>,
    track: &Track,
    x: &Range<f64>,
    density_at: &impl Fn(f64) -> f64,
) -> Result<(), DrawError> {
    let title =
        "Out of the sea: the leg at touchdown (orange) and at lift-off (green), water in blue";
    let mut panel = panel(area, title, x, -0.15..ceiling_m(track))?;
    panel.draw_series(shades(x, density_at).into_iter().map(|(from, to, density)| {
        let shade = WATER.mix(0.42 * density.clamp(0.0, 1.0));
        Rectangle::new([(from, 0.0), (to, ceiling_m(track))], shade.filled())
    }))?;
    panel.draw_series([Rectangle::new([(x.start, -0.15), (x.end, 0.0)], GROUND.filled())])?;
    mesh(&mut panel, "height, m", 4)?;
    draw_legs(&mut panel, &track.touchdowns, TOUCHDOWN)?;
    draw_legs(&mut panel, &track.liftoffs, LIFTOFF)?;
    panel.draw_series(LineSeries::new(track.path.iter().copied(), INK.stroke_width(px(1))))?;
    if let Some(fall) = track.fall {
        panel.draw_series([Cross::new(fall, px(7), RED.stroke_width(px(3)))])?;
    }
    Ok(())
}

/// Stretches of one density, m to m; narrow ones where it changes. Equal
/// neighbours are one stretch, for the seam between two would show.
fn shades(x: &Range<f64>, density_at: &impl Fn(f64) -> f64) -> Vec<(f64, f64, f64)> {
    let column_m = 0.25;
    let columns = ((x.end - x.start) / column_m).ceil() as usize;
    let mut stretches: Vec<(f64, f64, f64)> = Vec::new();
    for i in 0..columns {
        let from = x.start + column_m * i as f64;
        let to = (from + column_m).min(x.end);
        let density = density_at(0.5 * (from + to));
        match stretches.last_mut() {
            Some((_, end, same)) if *same == density => *end = to,
            _ => stretches.push((from, to, density)),
        }
    }
    stretches
}

fn draw_legs(
    panel: &mut Panel<'_, '_>,
    legs: &[LegPose],
    color: RGBColor,
) -> Result<(), DrawError> {
    panel.draw_series(
        legs.iter().map(|l| PathElement::new([l.foot, l.mass], color.mix(0.8).stroke_width(px(2)))),
    )?;
    panel.draw_series(legs.iter().map(|l| Circle::new(l.mass, px(3), color.filled())))?;
    Ok(())
}

fn draw_velocity(area: &Area<'_>, track: &Track, x: &Range<f64>) -> Result<(), DrawError> {
    let speeds = || track.apexes.iter().flat_map(|a| [a.vx_m_s, a.set_point_m_s]);
    let low = speeds().fold(0.0, f64::min) - 0.1;
    let high = speeds().fold(0.5, f64::max) + 0.15;
    let mut panel =
        panel(area, "Velocity at each apex (dots) and the set-point (line)", x, low..high)?;
    mesh(&mut panel, "velocity, m/s", 6)?;
    let asked = steps(track.apexes.iter().map(|a| (a.x_m, a.set_point_m_s)));
    panel.draw_series(LineSeries::new(asked, TOUCHDOWN.stroke_width(px(2))))?;
    panel.draw_series(
        track.apexes.iter().map(|a| Circle::new((a.x_m, a.vx_m_s), px(3), INK.filled())),
    )?;
    Ok(())
}

/// A level held from each point to the next.
pub(crate) fn steps(points: impl Iterator<Item = Point>) -> Vec<Point> {
    let mut line: Vec<Point> = Vec::new();
    for (x, y) in points {
        if let Some(&(_, level)) = line.last() {
            line.push((x, level));
        }
        line.push((x, y));
    }
    line
}

fn draw_density(
    area: &Area<'_>,
    track: &Track,
    x: &Range<f64>,
    density_at: &impl Fn(f64) -> f64,
) -> Result<(), DrawError> {
    let title = "Density over that of water: true (area) and as estimated at each apex (dots)";
    let mut panel = panel(area, title, x, -0.05..1.1)?;
    let samples = 600;
    let at = |i: usize| x.start + (x.end - x.start) * i as f64 / samples as f64;
    let truth = (0..=samples).map(|i| (at(i), density_at(at(i))));
    panel.draw_series(
        AreaSeries::new(truth, 0.0, WATER.mix(0.25)).border_style(WATER.stroke_width(px(2))),
    )?;
    mesh(&mut panel, "density ratio", 6)?;
    panel.draw_series(
        track.apexes.iter().map(|a| Circle::new((a.x_m, a.density_estimate), px(3), INK.filled())),
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::track::ApexMark;
    use super::*;

    #[test]
    fn every_mark_of_the_run_is_in_the_picture() {
        let pose = |x: f64| LegPose { foot: (x, 0.0), mass: (x + 0.2, 0.98) };
        let apex = |x: f64| ApexMark {
            t_s: x,
            x_m: x,
            y_m: 2.0,
            vx_m_s: 0.5,
            set_point_m_s: 0.5,
            density_ratio: 1.0,
            density_estimate: 0.99,
        };
        let track = Track {
            path: (0..400).map(|i| (0.1 * f64::from(i), 1.5)).collect(),
            touchdowns: (0..7).map(|i| pose(f64::from(i))).collect(),
            liftoffs: (0..5).map(|i| pose(f64::from(i) + 0.5)).collect(),
            apexes: (0..6).map(|i| apex(f64::from(i))).collect(),
            fall: None,
        };
        let svg = draw(&track, |x| if x < 15.0 { 1.0 } else { 0.0 }).unwrap();
        // A dot for each mass, each apex velocity and each density estimate.
        assert_eq!(svg.matches("<circle").count(), 7 + 5 + 6 + 6);
        assert!(svg.contains("density ratio") && svg.contains("velocity, m/s"));
    }
}
