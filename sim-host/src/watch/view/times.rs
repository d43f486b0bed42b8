//! Histograms of times: round trips in lock-step, lateness of both loops in real time.

use leg_host::realtime::{HistogramBin, LoopReport, with_unit};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Sparkline, SparklineBar};

use super::super::scene::Scene;
use super::{ALARM, PUSH, SET_POINT};

/// Height of the loops' panel, rows.
pub(super) const LOOPS_HEIGHT: u16 = 8;
/// Least width of one loop's panel, columns; two are side by side if there is room.
const LOOP_WIDTH: u16 = 34;

/// Returns the height of a bar: the fourth root of its count, so that rare times show.
fn height(count: u64) -> u64 {
    (100.0 * (count as f64).powf(0.25)) as u64
}

/// Draws the histogram of round-trip times; each bar covers twice the time of the one
/// before.
pub(super) fn draw_round_trips(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let block = Block::bordered();
    let Some(leg) = &scene.leg else {
        frame.render_widget(block.title(" round trips "), area);
        return;
    };
    let of = |quantile: f64| upper_end_us(&leg.round_trips, quantile);
    let title = match (of(0.5), of(0.99)) {
        (Some(half), Some(most)) => {
            round_trip_title(&short(half), &short(most), block.inner(area).width)
        }
        _ => " round trips ".to_owned(),
    };
    let bars = leg.round_trips.iter().map(|&count| (count.into(), PUSH));
    frame.render_widget(sparkline(bars, block.inner(area).width).block(block.title(title)), area);
}

/// Returns a title with two quantiles that fits in `width` columns, in fewer words if it must.
fn round_trip_title(half: &str, most: &str, width: u16) -> String {
    let long = format!(" round trip p50 <{half} p99 <{most} ");
    if long.chars().count() <= usize::from(width) {
        return long;
    }
    format!(" trip p50 <{half} p99 <{most} ")
}

/// Formats a time in as few digits as the end of a bar needs.
fn short(us: f64) -> String {
    if us < 1000.0 { format!("{us} us") } else { format!("{:.0} ms", us / 1000.0) }
}

/// Returns the upper end of the bar that contains a quantile, us.
fn upper_end_us(bars: &[u32], quantile: f64) -> Option<f64> {
    let all: u64 = bars.iter().map(|n| u64::from(*n)).sum();
    let mut left = (quantile * all as f64).ceil() as u64;
    bars.iter().enumerate().find_map(|(i, n)| {
        left = left.saturating_sub((*n).into());
        (all > 0 && left == 0).then(|| 0.25 * f64::exp2(i as f64))
    })
}

/// Draws counts as bars over the whole width, with gaps if there is room.
fn sparkline(
    counts: impl ExactSizeIterator<Item = (u64, Color)>,
    width: u16,
) -> Sparkline<'static> {
    let columns = (usize::from(width) / counts.len().max(1)).max(1);
    Sparkline::default().data(counts.flat_map(move |(count, color)| {
        (0..columns).map(move |column| {
            let is_gap = column > 0 && column + 1 == columns;
            SparklineBar::from(if is_gap { 0 } else { height(count) }).style(Style::new().fg(color))
        })
    }))
}

/// Returns the known reports of loops in real time: the leg's, then the controller's.
pub(super) fn loops(scene: &Scene) -> Vec<&LoopReport> {
    let leg = scene.leg.as_ref().and_then(|leg| leg.timing.as_ref());
    let controller = scene.controller.as_ref().and_then(|status| status.timing.as_ref());
    leg.into_iter().chain(controller).collect()
}

/// Draws the lateness of each loop's ticks.
pub(super) fn draw_loops(frame: &mut Frame<'_>, area: Rect, loops: &[&LoopReport]) {
    let block = Block::bordered().title(" loops: lateness of the ticks ");
    let inner = block.inner(area);
    if loops.is_empty() || inner.is_empty() {
        return;
    }
    frame.render_widget(block, area);
    let each = vec![Constraint::Fill(1); loops.len()];
    let is_wide = usize::from(inner.width) >= loops.len() * usize::from(LOOP_WIDTH);
    let layout = if is_wide { Layout::horizontal(each).spacing(2) } else { Layout::vertical(each) };
    // The same bars for both loops, so that they can be compared.
    let mut ends_us: Vec<f64> =
        loops.iter().flat_map(|l| &l.lateness_histogram).map(|bar| bar.up_to_us).collect();
    ends_us.sort_by(f64::total_cmp);
    ends_us.dedup();
    for (report, area) in loops.iter().zip(layout.split(inner).iter()) {
        draw_loop(frame, *area, report, &ends_us);
    }
}

fn draw_loop(frame: &mut Frame<'_>, area: Rect, report: &LoopReport, ends_us: &[f64]) {
    // Without room the axis is omitted first, then the counts.
    let counts_height = u16::from(area.height >= 5);
    let axis_height = u16::from(area.height >= 4);
    let [quantiles, counts, bars, axis] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(counts_height),
        Constraint::Fill(1),
        Constraint::Length(axis_height),
    ])
    .areas(area);
    frame.render_widget(quantile_line(report, area.width), quantiles);
    frame.render_widget(count_line(report), counts);

    let tick_us = 1e6 / f64::from(report.rate_hz.max(1));
    let heights = ends_us.iter().map(|&end_us| {
        let is_here = |bar: &&HistogramBin| bar.up_to_us.total_cmp(&end_us).is_eq();
        let bar = report.lateness_histogram.iter().find(is_here);
        (bar.map_or(0, |bar| bar.ticks), if end_us > tick_us { ALARM } else { PUSH })
    });
    frame.render_widget(sparkline(heights, bars.width), bars);
    if let [first, .., last] = ends_us {
        frame.render_widget(Line::from(format!("to {}", with_unit(*first))).dim(), axis);
        frame.render_widget(Line::from(with_unit(*last)).dim().right_aligned(), axis);
    }
}

fn quantile_line(report: &LoopReport, width: u16) -> Line<'_> {
    let late = &report.lateness_us;
    let rare = format!("p99 {}  max {}", with_unit(late.p99), with_unit(late.max));
    let name = Span::from(format!("{}  ", report.role)).bold();
    let all = Line::from(vec![
        name.clone(),
        Span::from(format!("p50 {}  ", with_unit(late.p50))),
        Span::from(rare.clone()),
    ]);
    if all.width() <= usize::from(width) { all } else { Line::from(vec![name, Span::from(rare)]) }
}

/// Formats the counts. Most missed ticks are caused by the machine; overruns are the
/// loop's own.
fn count_line(report: &LoopReport) -> Line<'_> {
    let c = &report.counters;
    let line =
        Line::from(format!("missed {}  stale {}  overran {}", c.missed, c.stale, c.own_overruns));
    match (c.own_overruns, c.missed) {
        (0, 0) => line.dim(),
        (0, _) => line.fg(SET_POINT),
        _ => line.fg(ALARM),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_the_upper_end_of_its_bar() {
        assert_eq!(upper_end_us(&[], 0.5), None);
        assert_eq!(upper_end_us(&[0, 0], 0.5), None);
        assert_eq!(upper_end_us(&[1, 0, 1], 0.5), Some(0.25));
        assert_eq!(upper_end_us(&[1, 0, 1], 0.51), Some(1.0));
    }
}
