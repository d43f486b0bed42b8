use std::time::Instant;

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire_controller::WireController;
use leg_host::memory::Inline;
use leg_host::realtime::{HistogramBin, LoopReport, QuantilesUs};
use leg_host::shm::Participants;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;

use super::*;
use crate::operate::{BUCKETS, LegStatus};
use crate::scenario::{Scenario, Settings};
use crate::session::{Options, lock_step};

/// Returns the scene after some seconds of a run in water at 0.5 m/s.
fn hopping(seconds: u32) -> Scene {
    let settings = format!("medium = \"water\"\nset_point_m_s = 0.5\nduration_s = {seconds}.0");
    let scenario = Scenario::from_settings(&Settings::from_toml(&settings).unwrap()).unwrap();
    let config = Config::at_rate(1000).unwrap();
    let mut controller = WireController::new(Policy::parse(SHIPPED).unwrap(), config);
    let mut link = Inline::new(|sample| controller.tick(Some(sample)));
    let mut scene = Scene::new("test");
    scene.players = Participants { leg: true, controller: true };
    let mut hops = 0;
    lock_step::run(&scenario, &mut link, Options::default(), |tick| {
        hops += tick.events.len() as u64 / 3;
        if tick.seq % 2 == 0 {
            scene.take_sample(tick.sample);
            scene.take_command(tick.command);
        }
        if tick.seq % 100 == 0 {
            scene.take_leg(
                Some(status(tick.sample.header.run_id, tick.t_s, tick.body.x_m)),
                Instant::now(),
            );
        }
    })
    .unwrap();
    scene
}

fn status(run_id: u32, t_s: f64, x_m: f64) -> LegStatus {
    LegStatus {
        pid: 1,
        rate_hz: 1000,
        time_mode: TimeMode::LockStep,
        is_paused: true,
        ordered_m_s: None,
        run_id,
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

/// Returns the cells with something of this colour.
fn cells(buffer: &Buffer, color: Color) -> Vec<(u16, u16)> {
    let area = buffer.area;
    (0..area.height)
        .flat_map(|y| (0..area.width).map(move |x| (x, y)))
        .filter(|at| buffer[*at].fg == color && buffer[*at].symbol() != " ")
        .collect()
}

#[test]
fn names_the_values_that_the_leg_does_not_sense() {
    let mut scene = hopping(1);
    let sample = scene.sample.as_mut().unwrap();
    sample.header.flags &= !leg_control::wire::flags::STATE_SENSED;
    let text = text(&drawn(&scene, 120, 40));
    for line in ["height       not sensed", "velocity     not sensed"] {
        assert!(text.contains(line), "{text}");
    }
}

#[test]
fn draws_the_leg_its_trail_and_its_values() {
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
        "density used by the actor",
        "hops         7",
        "no command   3",
        "round trip p50 <4 us p99 <4 us ",
        "arrows",
    ] {
        assert!(text.contains(part), "`{part}` is not in\n{text}");
    }
    assert!(!text.contains("SAFE STATE") && scene.hops.len() > 4, "{text}");

    // The mass is in the middle at its height, and the foot at the end of the leg.
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
    assert!(cells(&buffer, TRAIL).len() > 20, "the trail");
    assert_eq!(buffer[(10, 5)].bg, medium(1.0), "in water");
}

#[test]
fn draws_small_and_empty_views() {
    let scene = hopping(3);
    for (width, height) in [(80, 24), (40, 10), (10, 3), (1, 1), (250, 80)] {
        drawn(&scene, width, height);
        drawn(&Scene::new("none"), width, height);
    }
    let buffer = drawn(&Scene::new("none"), 100, 30);
    let text = text(&buffer);
    assert!(text.contains("leg ✘") && text.contains("waiting for a leg"), "{text}");
}

/// Returns the report of a loop with a hundred ticks that began 2 ms late or more.
fn late_loop(role: &str) -> LoopReport {
    let mut report = LoopReport { role: role.to_owned(), rate_hz: 1000, ..LoopReport::default() };
    report.lateness_us =
        QuantilesUs { p50: 0.1, p90: 5.0, p99: 1900.0, p99_9: 4000.0, max: 4800.0, count: 9000 };
    report.lateness_histogram = [(1.0, 8000), (2.0, 0), (5.0, 900), (2000.0, 50), (5000.0, 50)]
        .map(|(up_to_us, ticks)| HistogramBin { up_to_us, ticks })
        .to_vec();
    report.counters.missed = 12;
    report
}

/// Returns the scene of two loops in real time, with the statuses of both processes.
fn in_real_time() -> Scene {
    let mut scene = hopping(3);
    let mut leg = scene.leg.take().unwrap();
    (leg.time_mode, leg.timing) = (TimeMode::RealTime, Some(late_loop("leg")));
    scene.leg = Some(leg);
    scene.controller = Some(controller(Some(&late_loop("controller"))));
    scene
}

fn controller(timing: Option<&LoopReport>) -> leg_host::status::Status {
    let time_mode = if timing.is_some() { "real-time" } else { "lock-step" };
    let next = serde_json::json!(
        {"name": "the policy with a very long name", "crc32": "00000001", "file": "", "provenance": ""}
    );
    serde_json::from_value(serde_json::json!({
        "pid": 2, "rate_hz": 1000, "gravity_m_s2": 9.81, "time_mode": time_mode,
        "activity": "running",
        "policy": {"name": "robust", "crc32": "13f40f3f", "file": "robust.bin", "provenance": ""},
        "since_unix_s": 0.0, "since": null, "pending": next, "swaps": 11, "last": null,
        "ticks": 0, "apexes": 0,
        "rejected": {"ticks": 21, "missing": 22, "stale": 23, "safe_entered": 24},
        "peer": {"pid": 1, "connections": 1, "losses": 25},
        "timing": timing,
    }))
    .unwrap()
}

/// The sizes of usual terminals.
#[test]
fn draws_every_value_and_whole_titles_at_usual_sizes() {
    let mut lock_step = hopping(3);
    lock_step.controller = Some(controller(None));
    lock_step.speed = Some(12345.6);
    let mut leg = lock_step.leg.take().unwrap();
    leg.round_trips[12] = 1_000_000;
    lock_step.leg = Some(leg);
    let mut command = lock_step.command.unwrap();
    command.header.flags |= leg_control::wire::flags::SAFE;
    lock_step.command = Some(command);
    let mut late = lock_step.sample.unwrap();
    (late.header.t_ns, late.header.seq) = (80_000_000_000_000, 80_000_000);
    lock_step.sample = Some(late);
    let values = [
        "time         80000 s, tick 80000000 │",
        "height       1.62 m ",
        "velocity     +0.",
        "set-point    +0.50 m/s ",
        "hops         7 ",
        "falls        0 ",
        "safe ticks   5 ",
        "no command   3 ",
        "policy       robust ",
        "checksum     13f40f3f ",
        "swaps        11 ",
        "at next apex the policy with a very…│",
        "rejected     21 ",
        "missing      22 ",
        "stale        23 ",
        "safe entered 24 ",
        "legs gone    25 ",
    ];
    for (width, height) in [(80, 24), (100, 30), (120, 40)] {
        for scene in [&lock_step, &in_real_time()] {
            let text = text(&drawn(scene, width, height));
            let is_lock_step = std::ptr::eq(scene, &raw const lock_step);
            for part in values.iter().skip(usize::from(!is_lock_step)) {
                assert!(text.contains(part), "`{part}` is not in\n{text}");
            }
            for part in ["leg ✔  controller ✔", "PAUSED", " density", HELP] {
                assert!(text.contains(part), "`{part}` is not in\n{text}");
            }
            let state = if is_lock_step { "12345.6" } else { "real time" };
            assert!(text.contains(state), "{text}");
            assert_eq!(text.contains("SAFE STATE"), is_lock_step, "{text}");
        }
        let text = text(&drawn(&lock_step, width, height));
        let title = "┌ round trip p50 <1 ms p99 <1 ms ";
        assert_eq!(text.contains(title), height > 24, "{text}");
        assert_eq!(text.contains("└ round trips hidden "), height == 24, "{text}");
    }

    // A message is not cut, and a long domain is.
    let message = "the last words of a long message are read as well as its first ones, ".repeat(3);
    lock_step.show_message(message);
    lock_step.domain = "long".repeat(20);
    let text = text(&drawn(&lock_step, 80, 24)).replace(['\n', ' '], "");
    assert_eq!(text.matches("wellasitsfirstones,").count(), 3, "{text}");
    assert!(
        text.contains("longlonglonglongl…leg✔controller✔") && text.contains("SAFESTATE"),
        "{text}"
    );
}

#[test]
fn announces_the_rows_that_have_no_room() {
    let mut scene = hopping(3);
    scene.controller = Some(controller(None));
    // Of the nine rows of the controller and the frame of its panel.
    let whole = text(&drawn(&scene, 80, 24));
    assert!(!whole.contains("more rows hidden") && whole.contains("legs gone"), "{whole}");
    for (height, hidden) in [(22, 2), (20, 4)] {
        let text = text(&drawn(&scene, 80, height));
        let note = format!("└ {hidden} more rows, round trips hidden ─");
        assert!(text.contains(&note) && !text.contains("legs gone"), "{text}");
    }
}

#[test]
fn a_name_never_touches_its_value_and_a_title_is_whole() {
    let text = row("a name without an end", "423").to_string();
    assert_eq!(text, "a name witho… 423".replace("witho…", "with…"));
    let mut scene = hopping(3);
    let mut leg = scene.leg.take().unwrap();
    leg.round_trips = (0..BUCKETS as u32).map(|i| u32::from(i == 0)).collect();
    scene.leg = Some(leg);
    let text = super::tests::text(&drawn(&scene, 120, 40));
    assert!(text.contains(" trip p50 <0.25 us p99 <0.25 us "), "{text}");
}

#[test]
fn draws_the_lateness_of_loops_in_real_time() {
    let scene = in_real_time();
    for (width, height, also) in [(120, 40, "missed 12"), (80, 24, "max 4.80 ms")] {
        let buffer = drawn(&scene, width, height);
        let text = text(&buffer);
        for part in ["loops", "leg  p", "controller  p", "p99 1.90 ms  max 4.80 ms", also] {
            assert!(text.contains(part), "`{part}` is not in\n{text}");
        }
        // Ticks more than a tick late have another colour.
        let rows = height - 1 - times::LOOPS_HEIGHT..height - 1;
        let bars = |color| {
            let is_bar =
                |at: &(u16, u16)| rows.contains(&at.1) && "▁▂▃▄▅▆▇█".contains(buffer[*at].symbol());
            cells(&buffer, color).into_iter().filter(is_bar).count()
        };
        assert!(bars(PUSH) > 10 && bars(ALARM) > 5, "{text}");
    }
}
