use std::time::Instant;

use controller::control::{Config, Controller};
use controller::host::memory::Inline;
use controller::host::shm::Players;
use controller::policy::{Policy, SHIPPED};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;

use super::*;
use crate::operate::{BUCKETS, LegStatus};
use crate::scenario::{Scenario, Settings};
use crate::session::{Options, lock_step};

/// The scene after some seconds of a real run in water at 0.5 m/s, seen often.
fn hopping(seconds: u32) -> Scene {
    let settings = format!("medium = \"water\"\nset_point_m_s = 0.5\nduration_s = {seconds}.0");
    let scenario = Scenario::from_settings(&Settings::from_toml(&settings).unwrap()).unwrap();
    let config = Config::at_rate(1000).unwrap();
    let mut controller = Controller::new(Policy::parse(SHIPPED).unwrap(), config);
    let mut link = Inline::new(|sample| controller.tick(Some(sample)));
    let mut scene = Scene::new("test");
    scene.players = Players { leg: true, controller: true };
    let mut hops = 0;
    lock_step::run(&scenario, &mut link, Options::default(), |tick| {
        hops += tick.events.len() as u64 / 3;
        if tick.seq % 2 == 0 {
            scene.take_sample(tick.sample);
            scene.take_command(tick.command);
        }
        if tick.seq % 100 == 0 {
            scene.take_leg(
                Some(status(tick.sample.header.epoch, tick.t_s, tick.body.x_m)),
                Instant::now(),
            );
        }
    })
    .unwrap();
    scene
}

fn status(epoch: u32, t_s: f64, x_m: f64) -> LegStatus {
    LegStatus {
        pid: 1,
        rate_hz: 1000,
        pace: Pace::LockStep,
        is_paused: true,
        ordered_m_s: None,
        epoch,
        seq: 0,
        t_s,
        x_m,
        density_ratio: 1.0,
        ticks: 0,
        hops: 7,
        falls: 0,
        safe_ticks: 5,
        held_ticks: 3,
        rejected: 0,
        round_trips: (0..BUCKETS as u32)
            .map(|i| if i == 4 { 99 } else { u32::from(i == 9) })
            .collect(),
        timing: None,
    }
}

fn drawn(scene: &Scene, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, scene)).unwrap();
    terminal.backend().buffer().clone()
}

fn text(buffer: &Buffer) -> String {
    let area = buffer.area;
    let row = |y| (0..area.width).map(|x| buffer[(x, y)].symbol()).collect::<String>() + "\n";
    (0..area.height).map(row).collect()
}

/// Cells with something of this colour.
fn cells(buffer: &Buffer, color: Color) -> Vec<(u16, u16)> {
    let area = buffer.area;
    (0..area.height)
        .flat_map(|y| (0..area.width).map(move |x| (x, y)))
        .filter(|at| buffer[*at].fg == color && buffer[*at].symbol() != " ")
        .collect()
}

#[test]
fn a_hopping_leg_is_drawn_with_its_way_and_its_figures() {
    let scene = hopping(14);
    let [foot, mass] = scene.leg().unwrap();
    let buffer = drawn(&scene, 120, 40);
    let text = text(&buffer);
    for part in [
        "domain test",
        "leg ✔",
        "PAUSED",
        "density 1.000",
        "0.50 m/s",
        "tick 13998",
        "velocity at each apex",
        "density as estimated",
        "hops           7",
        "without command3",
        "p50 < 4 us, p99 < 4 us",
        "arrows",
    ] {
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
    assert!(!text.contains("SAFE STATE") && scene.hops.len() > 4, "{text}");

    // The mass is in the middle, as high as it is; the foot where the leg ends.
    let middle = |cells: &[(u16, u16)]| {
        let n = cells.len() as f64;
        let sum =
            cells.iter().fold((0.0, 0.0), |s, c| (s.0 + f64::from(c.0), s.1 + f64::from(c.1)));
        (sum.0 / n, sum.1 / n)
    };
    let masses: Vec<_> = cells(&buffer, BODY).into_iter().filter(|c| c.1 < 24).collect();
    let (column, line) = middle(&masses);
    let rows = 21.0;
    let expected = 1.0 + (HEIGHT_M[1] - mass.1) / (HEIGHT_M[1] - HEIGHT_M[0]) * rows;
    assert!(
        (column - 40.5).abs() < 1.5 && (line - expected).abs() < 1.5,
        "{column} {line} {expected}"
    );
    let color = if scene.command.unwrap().elongation_m > 0.0 { PUSH } else { LEG };
    let lowest = cells(&buffer, color).into_iter().filter(|c| c.0 < 80).map(|c| c.1).max().unwrap();
    let expected = 1.0 + (HEIGHT_M[1] - foot.1) / (HEIGHT_M[1] - HEIGHT_M[0]) * rows;
    assert!((f64::from(lowest) - expected).abs() < 2.0, "{lowest} {expected}");
    assert!(cells(&buffer, TRAIL).len() > 20, "the way it came");
    assert_eq!(buffer[(10, 5)].bg, medium(1.0), "in water");
}

#[test]
fn small_and_empty_views_are_drawn_too() {
    let scene = hopping(3);
    for (width, height) in [(80, 24), (40, 10), (10, 3), (1, 1), (250, 80)] {
        drawn(&scene, width, height);
        drawn(&Scene::new("none"), width, height);
    }
    let buffer = drawn(&Scene::new("none"), 100, 30);
    let text = text(&buffer);
    assert!(text.contains("leg ✘") && text.contains("nobody is hopping here yet"), "{text}");
}

#[test]
fn quantiles_are_the_ends_of_bars() {
    assert_eq!(upper_end_us(&[], 0.5), None);
    assert_eq!(upper_end_us(&[0, 0], 0.5), None);
    assert_eq!(upper_end_us(&[1, 0, 1], 0.5), Some(0.25));
    assert_eq!(upper_end_us(&[1, 0, 1], 0.51), Some(1.0));
}
