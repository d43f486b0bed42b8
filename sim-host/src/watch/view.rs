//! Draws a scene.

use leg_control::wire::{Sample, flags};
use leg_host::TimeMode;
use leg_process::rounded;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Circle, Context, Line as Stroke, Points};
use ratatui::widgets::{Axis, Block, Chart, Dataset, Gauge, GraphType, Paragraph, Wrap};

use super::keys::HELP;
use super::scene::Scene;

const LEG: Color = Color::Rgb(240, 240, 240);
const PUSH: Color = Color::Rgb(90, 220, 170);
const BODY: Color = Color::Rgb(255, 176, 80);
const TRAIL: Color = Color::Rgb(130, 130, 150);
const GROUND: Color = Color::Rgb(196, 178, 142);
const SET_POINT: Color = Color::Rgb(240, 130, 60);
const ALARM: Color = Color::Rgb(255, 90, 90);
/// Radius of the drawn mass, m.
const RADIUS_M: f64 = 0.11;
/// Width of the panels with values, columns.
const VALUES_WIDTH: u16 = 38;
/// Width of a value's name, columns.
const NAME_WIDTH: usize = 13;
/// Most lines of a message.
const MESSAGE_LINES: u16 = 4;
/// Lowest and highest height shown, m.
const HEIGHT_M: [f64; 2] = [-0.25, 3.0];

/// Draws `scene` over the whole frame.
pub fn draw(frame: &mut Frame<'_>, scene: &Scene) {
    let message = scene.message().unwrap_or(HELP);
    let lines = message.chars().count() / usize::from(frame.area().width.max(1)) + 1;
    let foot_height = u16::try_from(lines).unwrap_or(u16::MAX).min(MESSAGE_LINES);
    let [head, body, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(8),
        Constraint::Length(foot_height),
    ])
    .areas(frame.area());
    let [left, right] =
        Layout::horizontal([Constraint::Min(30), Constraint::Length(VALUES_WIDTH)]).areas(body);
    let loops = times::loops(scene);
    let height = if loops.is_empty() { 0 } else { times::LOOPS_HEIGHT };
    let [above, below] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(height)]).areas(left);
    let [stage, chart] =
        Layout::vertical([Constraint::Percentage(62), Constraint::Min(6)]).areas(above);
    frame.render_widget(headline(scene, head.width), head);
    draw_stage(frame, stage, scene);
    draw_hops(frame, chart, scene);
    times::draw_loops(frame, below, &loops);
    draw_values(frame, right, scene);
    let text = Paragraph::new(message).wrap(Wrap { trim: true });
    frame.render_widget(if message == HELP { text.dim() } else { text.fg(ALARM) }, foot);
}

/// Returns the first line, in short words where the long ones do not fit.
fn headline(scene: &Scene, width: u16) -> Line<'_> {
    let fits = |line: &Line<'_>| line.width() <= usize::from(width);
    let long = state_line(scene, &scene.domain, false);
    if fits(&long) {
        return long;
    }
    let short = state_line(scene, "", true);
    let room = usize::from(width).saturating_sub(short.width());
    state_line(scene, &cut(&scene.domain, room), true)
}

fn state_line<'a>(scene: &'a Scene, domain: &str, is_short: bool) -> Line<'a> {
    let mut spans = Vec::new();
    if is_short {
        spans.push(Span::from(format!(" {domain}  ")));
    } else {
        spans.push(Span::from(" sim-host watch ").bold().reversed());
        spans.push(Span::from(format!(" domain {domain}  ")));
    }
    let presence = |is_present: bool, name: &'static str| {
        if is_present {
            Span::from(format!("{name} ✔  "))
        } else {
            Span::from(format!("{name} ✘  ")).fg(ALARM)
        }
    };
    spans.push(presence(scene.players.leg, "leg"));
    spans.push(presence(scene.players.controller, "controller"));
    if let Some(leg) = &scene.leg {
        spans.push(Span::from(leg.time_mode.to_string()));
        if let Some(speed) = scene.speed.filter(|_| leg.time_mode == TimeMode::LockStep) {
            spans.push(Span::from(if is_short {
                format!(" x{speed:.1}")
            } else {
                format!(", {speed:.1} times real time")
            }));
        }
        if leg.is_paused {
            spans.push(Span::from("  PAUSED").fg(SET_POINT).bold());
        }
    }
    if is_safe(scene) {
        spans.push(Span::from("  SAFE STATE").fg(ALARM).bold());
    }
    Line::from(spans)
}

/// Returns a text of at most `width` columns, with an ellipsis where it is cut.
fn cut(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    text.chars().take(width.saturating_sub(1)).chain(['…']).collect()
}

fn is_safe(scene: &Scene) -> bool {
    scene.command.is_some_and(|command| command.is_safe())
}

/// Returns the colour of the medium, from black for air to blue for water.
fn medium(density_ratio: f64) -> Color {
    let part = density_ratio.clamp(0.0, 1.0);
    let shade = |full: f64| (part * full).round() as u8;
    Color::Rgb(shade(8.0), shade(52.0), shade(104.0))
}

fn draw_stage(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let block = Block::bordered().title(match scene.density_ratio() {
        None => " waiting for a leg ".to_owned(),
        Some(density) => format!(" x {:.2} m, density {density:.3} ", rounded(scene.x_m, 2)),
    });
    // Equal scales in both directions: a cell is about twice as high as wide.
    let [low, high] = HEIGHT_M;
    let inner = block.inner(area);
    let m_per_row = (high - low) / f64::from(inner.height.max(1));
    let half_m = 0.25 * m_per_row * f64::from(inner.width);
    let canvas = Canvas::default()
        .block(block)
        .background_color(medium(scene.density_ratio().unwrap_or(0.0)))
        .marker(Marker::Braille)
        .x_bounds([scene.x_m - half_m, scene.x_m + half_m])
        .y_bounds(HEIGHT_M)
        .paint(|context| paint(context, scene, half_m));
    frame.render_widget(canvas, area);
}

fn paint(context: &mut Context<'_>, scene: &Scene, half_m: f64) {
    let (from_m, to_m) = (scene.x_m - half_m, scene.x_m + half_m);
    context.draw(&Stroke { x1: from_m, y1: 0.0, x2: to_m, y2: 0.0, color: GROUND });
    let mut metre = from_m.ceil();
    while metre <= to_m {
        context.draw(&Stroke { x1: metre, y1: 0.0, x2: metre, y2: -0.12, color: GROUND });
        context.print(metre, HEIGHT_M[0], Line::from(format!("{metre:.0}")).fg(GROUND));
        metre += 1.0;
    }
    let trail: Vec<(f64, f64)> = scene.trail.iter().map(|&(_, x, y)| (x, y)).collect();
    context.draw(&Points { coords: &trail, color: TRAIL });
    let Some([foot, mass]) = scene.leg() else { return };
    context.layer();
    let pushes = scene.command.is_some_and(|command| command.elongation_m > 0.0);
    let color = if pushes { PUSH } else { LEG };
    context.draw(&Stroke { x1: foot.0, y1: foot.1, x2: mass.0, y2: mass.1, color });
    for ring in 1..=4 {
        let radius = RADIUS_M * f64::from(ring) / 4.0;
        context.draw(&Circle { x: mass.0, y: mass.1, radius, color: BODY });
    }
}

fn draw_hops(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let seen: Vec<(f64, f64)> =
        scene.hops.iter().map(|hop| (f64::from(hop.number), hop.vx_m_s)).collect();
    let set_points: Vec<(f64, f64)> =
        scene.hops.iter().map(|hop| (f64::from(hop.number), hop.set_point_m_s)).collect();
    let values = || seen.iter().chain(&set_points).map(|point| point.1).filter(|v| v.is_finite());
    let low = values().fold(0.0, f64::min) - 0.1;
    let high = values().fold(0.4, f64::max) + 0.1;
    let first = seen.first().map_or(0.0, |point| point.0);
    let last = seen.last().map_or(1.0, |point| point.0).max(first + 1.0);
    let label = |value: f64| format!("{value:.1}");
    let chart = Chart::new(vec![
        Dataset::default()
            .name("set-point")
            .marker(Marker::Braille)
            .graph_type(GraphType::Line)
            .style(Style::new().fg(SET_POINT))
            .data(&set_points),
        Dataset::default()
            .name("apex")
            .marker(Marker::Dot)
            .graph_type(GraphType::Scatter)
            .style(Style::new().fg(BODY))
            .data(&seen),
    ])
    .block(Block::bordered().title(" velocity at each apex, m/s "))
    .x_axis(
        Axis::default().bounds([first, last]).labels([format!("{first:.0}"), format!("{last:.0}")]),
    )
    .y_axis(Axis::default().bounds([low, high]).labels([
        label(low),
        label(0.5 * (low + high)),
        label(high),
    ]));
    frame.render_widget(chart, area);
}

/// Draws the values of leg and controller, and where there is room the density as a gauge and the
/// round trips.
fn draw_values(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    const GAUGE_HEIGHT: u16 = 3;
    const TRIPS_HEIGHT: std::ops::RangeInclusive<u16> = 4..=6;
    let estimate = scene.command.map_or(0.0, |command| f64::from(command.density_ratio));
    let (mut of_leg, of_controller) = (leg_lines(scene), controller_lines(scene));
    let bordered = |lines: &Vec<Line<'_>>| lines.len() as u16 + 2;
    let room = area.height.saturating_sub(bordered(&of_leg) + bordered(&of_controller));
    let gauge_height = if room >= GAUGE_HEIGHT { GAUGE_HEIGHT } else { 0 };
    if gauge_height == 0 {
        of_leg.push(row("density", &format!("{estimate:.3}, used by actor")));
    }
    let left = room.saturating_sub(gauge_height);
    let trips_height =
        if left >= *TRIPS_HEIGHT.start() { left.min(*TRIPS_HEIGHT.end()) } else { 0 };
    let [density, leg, controller, trips] = Layout::vertical([
        Constraint::Length(gauge_height),
        Constraint::Length(bordered(&of_leg)),
        Constraint::Min(3),
        Constraint::Length(trips_height),
    ])
    .areas(area);
    let gauge = Gauge::default()
        .block(Block::bordered().title(" density used by the actor "))
        .gauge_style(Style::new().fg(Color::Rgb(60, 130, 210)))
        .ratio(if estimate.is_finite() { estimate.clamp(0.0, 1.0) } else { 0.0 })
        .label(format!("{estimate:.3}"));
    frame.render_widget(gauge, density);
    let panel = |lines: Vec<Line<'static>>, title, area: Rect, has_trips| {
        let hidden = hidden(lines.len(), area, has_trips);
        let block = Block::bordered().title(title).title_bottom(Line::from(hidden).fg(ALARM));
        Paragraph::new(lines).block(block)
    };
    let is_lock_step = scene.leg.as_ref().is_some_and(|leg| leg.time_mode == TimeMode::LockStep);
    let has_trips = trips_height > 0 || !is_lock_step;
    frame.render_widget(panel(of_leg, " leg ", leg, true), leg);
    let of_controller = panel(of_controller, " controller ", controller, has_trips);
    frame.render_widget(of_controller, controller);
    if trips_height > 0 {
        times::draw_round_trips(frame, trips, scene);
    }
}

/// Returns a note of what has no room: rows of a panel of this size, and the round trips.
fn hidden(lines: usize, area: Rect, has_trips: bool) -> String {
    let rows = lines.saturating_sub(usize::from(area.height.saturating_sub(2)));
    match (rows, has_trips) {
        (0, true) => String::new(),
        (0, false) => " round trips hidden ".to_owned(),
        (rows, true) => format!(" {rows} more rows hidden "),
        (rows, false) => format!(" {rows} more rows, round trips hidden "),
    }
}

/// Formats a name and its value.
fn row(name: &'static str, value: &str) -> Line<'static> {
    let room = usize::from(VALUES_WIDTH) - 2 - NAME_WIDTH;
    let value = cut(value, room);
    // Even a name that is too long keeps its distance.
    let name = cut(name, NAME_WIDTH - 1);
    Line::from(vec![Span::from(format!("{name:<NAME_WIDTH$}")).dim(), Span::from(value)])
}

/// Formats a name and a count, highlighted if the count is not 0.
fn count(name: &'static str, count: u64) -> Line<'static> {
    let line = row(name, &count.to_string());
    if count > 0 { line.fg(ALARM) } else { line }
}

/// Formats a name and a reading, if a sample has it.
fn sensed(name: &'static str, sample: &Sample, flags: u16, value: &str) -> Line<'static> {
    row(name, if sample.header.flags & flags == flags { value } else { "not sensed" })
}

fn leg_lines(scene: &Scene) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    if let Some(sample) = &scene.sample {
        let t_s = 1e-9 * sample.header.t_ns as f64;
        let digits = if t_s < 1000.0 { 2 } else { 0 };
        lines.push(row("time", &format!("{t_s:.digits$} s, tick {}", sample.header.seq)));
        let [vx_m_s, vy_m_s] = [sample.vx_m_s, sample.vy_m_s].map(|v_m_s| rounded(v_m_s.into(), 2));
        let height = format!("{:.2} m", sample.y_m);
        lines.push(sensed("height", sample, flags::Y_SENSED, &height));
        let velocity = format!("{vx_m_s:+.2} {vy_m_s:+.2} m/s");
        lines.push(sensed("velocity", sample, flags::VX_SENSED | flags::VY_SENSED, &velocity));
        let by_key = scene.leg.as_ref().is_some_and(|leg| leg.ordered_m_s.is_some());
        let by = if by_key { ", by key" } else { "" };
        lines.push(row("set-point", &format!("{:+.2} m/s{by}", sample.set_point_m_s)));
    }
    if let Some(leg) = &scene.leg {
        lines.push(row("hops", &leg.hops.to_string()));
        lines.push(count("falls", leg.falls));
        lines.push(row("safe ticks", &leg.safe_ticks.to_string()));
        lines.push(count("no command", leg.held_ticks));
    } else if scene.sample.is_some() {
        lines.push(Line::from("(no status)").dim());
    }
    lines
}

fn controller_lines(scene: &Scene) -> Vec<Line<'static>> {
    let Some(status) = &scene.controller else {
        let rejected = scene.command.map_or(0, |command| command.rejected);
        return vec![Line::from("(no status)").dim(), count("rejected", rejected.into())];
    };
    let rejected = &status.rejected;
    let mut lines = vec![
        row("policy", &status.policy.name.clone()),
        row("checksum", &status.policy.crc32.to_string()),
        row("swaps", &status.swaps.to_string()),
    ];
    if let Some(pending) = &status.pending {
        lines.push(row("at next apex", &pending.name.clone()).fg(SET_POINT));
    }
    lines.extend([
        count("rejected", rejected.ticks.into()),
        count("missing", rejected.missing.into()),
        count("stale", rejected.stale.into()),
        count("safe entered", rejected.safe_entered.into()),
        row("legs gone", &status.peer.losses.to_string()),
    ]);
    lines
}

mod times;

#[cfg(test)]
mod tests;
