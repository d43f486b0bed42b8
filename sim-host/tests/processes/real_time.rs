//! Runs in real time. The tests check states and counts and never durations, because
//! the machine may be busy.

use std::process::{Command, Stdio};

use rustix::process::Signal;
use serde_json::Value;
use sim_host::record::schema::AnyMessage;

use crate::LONG_TIMEOUT;
use crate::place::{PROGRAM, Place, text, wait_until};

fn json(text: &str) -> Value {
    serde_json::from_str(text.trim()).unwrap_or_else(|cause| panic!("{cause}: {text}"))
}

fn count(value: &Value, key: &str) -> u64 {
    value[key].as_u64().unwrap_or_else(|| panic!("no count {key} in {value}"))
}

/// Asserts that the counts of a loop add up, and agree with its histogram.
#[track_caller]
fn assert_adds_up(report: &Value, role: &str) {
    let count = |key| count(report, key);
    assert_eq!(report["role"], role);
    assert_eq!(report["rate_hz"], 1000);
    let kinds = count("idle") + count("received") + count("stale") + count("missed");
    assert_eq!(kinds, count("ticks"), "{report}");
    let played = count("ticks") - count("missed");
    for key in ["lateness_us", "tick_time_us", "sample_age_us", "round_trip_us"] {
        let q = &report[key];
        let quantiles =
            ["p50", "p90", "p99", "p99_9", "max"].map(|q| report[key][q].as_f64().unwrap());
        assert!(quantiles.is_sorted() && quantiles[4] > 0.0, "{key}: {q}");
    }
    assert_eq!(report["lateness_us"]["count"], played - count("dropped_records"));
    let bars = report["lateness_histogram"].as_array().unwrap();
    let in_bars: u64 = bars.iter().map(|bar| bar["ticks"].as_u64().unwrap()).sum();
    assert_eq!(in_bars, played - count("dropped_records"));
}

#[test]
fn two_processes_run_in_real_time_and_report_their_loops() {
    let place = Place::new();
    let controller = place.controller(&["--real-time", "--json", "--timeout", "30"]);
    let simulator =
        place.simulator(&["--real-time", "--json", "--duration", "2", "--timeout", "30"]).end();
    let controller = controller.end();
    simulator.assert_ok();
    controller.assert_ok();

    let leg = json(&simulator.out);
    assert_eq!((&leg["time_mode"], &leg["ending"]), (&"real-time".into(), &"duration".into()));
    assert_eq!((count(&leg, "ticks"), count(&leg, "falls")), (2000, 0));
    assert!(count(&leg, "hops") >= 1, "{leg}");
    assert_adds_up(&leg["loop"], "leg");
    // Ticks missed in sleep are played, too.
    let of_run = count(&leg["loop"], "ticks") - count(&leg["loop"], "idle");
    assert!(of_run >= 2000, "{leg}");

    let of_controller = json(&controller.out);
    assert_adds_up(&of_controller["loop"], "controller");
    assert_eq!(of_controller["ticks"], of_controller["loop"]["received"]);
    place.assert_clean();
}

#[test]
fn a_controller_that_stays_reports_each_run_and_their_total() {
    let place = Place::new();
    let mut controller = place.staying(&["--real-time", "--json"]);
    for _ in 0..2 {
        let run = ["--real-time", "--duration", "0.3", "--timeout", "30"];
        place.simulator(&run).end().assert_ok();
    }
    controller.signal(Signal::TERM);
    let controller = controller.end();
    let all: Vec<_> = controller.assert_ok().out.lines().map(json).collect();
    let [first, second, total] = all.as_slice() else { panic!("{}", controller.out) };
    for (key, least) in [("runs", 1), ("ticks", 1), ("apexes", 0), ("rejected", 0)] {
        let of_runs = [count(first, key), count(second, key)];
        assert!(of_runs.iter().all(|count| *count >= least), "{key}: {}", controller.out);
        assert_eq!(of_runs.iter().sum::<u64>(), count(total, key), "{key}: {}", controller.out);
    }
    let is_total = [first, second, total].map(|line| line["is_total"].as_bool().unwrap());
    assert_eq!(is_total, [false, false, true]);
    assert!(first["loop"].is_null() && second["loop"].is_null());
    assert_eq!(total["ticks"], total["loop"]["received"]);
    place.assert_clean();
}

#[test]
fn in_process_and_spawned_runs_report_both_loops() {
    let place = Place::new();
    let of_run = ["--real-time", "--duration", "0.5", "--spin", "50"];
    for controller in ["--in-process", "--spawn"] {
        let run = place.alone(&[&[controller, "--json"], &of_run[..]].concat()).end();
        let report = json(&run.assert_ok().out);
        assert_adds_up(&report["loop"], "leg");
        assert_adds_up(&report["controller_loop"], "controller");
    }

    let spawned = place.alone(&[&["--spawn", "--live"], &of_run[..]].concat()).end();
    spawned.assert_ok();
    for part in [
        "time over",
        "the leg's loop",
        "the controller's loop",
        "wake-up lateness",
        "p99.9",
        "deadlines missed",
    ] {
        assert!(spawned.out.contains(part), "{part} is not in: {}", spawned.out);
    }
    place.assert_clean();
}

#[test]
fn refuses_a_real_time_and_a_lock_step_side() {
    let place = Place::new();
    for (leg, controller, parts) in [
        (
            &["--real-time"][..],
            &[][..],
            ["the controller runs in lock-step", "the simulator runs in real time"],
        ),
        (
            &[],
            &["--real-time"],
            ["the controller runs in real time", "the simulator runs in lock-step"],
        ),
    ] {
        let simulator = place.simulator(&[leg, &LONG_TIMEOUT].concat());
        let controller = place.controller(&[controller, &LONG_TIMEOUT].concat());
        simulator.end().assert(1, &[parts[0], "--real-time"]);
        controller.end().assert(1, &[parts[1], "--real-time"]);
    }
    place.assert_clean();
}

#[test]
fn the_help_states_how_long_a_controller_waits_and_when_it_is_in_its_safe_state() {
    let place = Place::new();
    let help = |arguments: &[&str]| {
        let out = place.start("controller", arguments).end().assert_ok().out.clone();
        out.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let waits = "[default: as long as it takes; with --once, 10 for a missing one]";
    assert!(help(&["--help"]).contains(waits));
    assert!(help(&["status", "--help"]).contains("[default: 3 for an answer, 10 for an apex]"));
    let safe =
        "After 10 ms without a message, and at least three ticks, the safe command is in force";
    assert!(help(&["--help"]).contains(safe));
}

#[test]
fn rejects_processors_and_rates_that_the_machine_cannot_provide() {
    let place = Place::new();
    let cases: [(&[&str], &[&str]); 6] = [
        (&["--real-time", "--cpu", "4095"], &["--cpu", "4095", "processors"]),
        (&["--real-time", "--rt-priority", "0"], &["--rt-priority", "0", "1..=99"]),
        (&["--real-time", "--rt-priority", "100"], &["100", "1..=99"]),
        (&["--real-time", "--spin", "-1"], &["--spin", "-1"]),
        (&["--rt-priority", "5"], &["--real-time"]),
        (&["--on-fall", "restart"], &["--real-time"]),
    ];
    for (arguments, parts) in cases {
        place.simulator(arguments).end().assert(2, parts);
    }
    let policy = place.policy();
    let of_controller = ["--policy", text(&policy), "--real-time", "--cpu", "4095"];
    place.start("controller", &of_controller).end().assert(2, &["--cpu", "4095"]);
}

#[test]
fn a_signal_ends_both_loops_with_their_reports() {
    let place = Place::new();
    let of_run = ["--real-time", "--duration", "80000", "--timeout", "30"];
    let controller = place.controller(&["--real-time", "--timeout", "30"]);
    let mut simulator = place.simulator(&of_run);
    place.wait_for_the_run(None);
    simulator.signal(Signal::INT);
    let simulator = simulator.end();
    simulator.assert(1, &["stopped by a signal"]);
    assert!(simulator.out.contains("wake-up lateness"), "{}", simulator.out);
    controller.end().assert_ok();
    place.assert_clean();
}

/// Regression: the controller's end by the same signal counted as its failure.
#[test]
fn a_signal_to_both_processes_keeps_both_reports_and_the_end_of_the_recording() {
    let place = Place::new();
    let path = place.file("stopped.mcap");
    let of_run = ["--spawn", "--real-time", "--duration", "80000", "--domain", place.domain()];
    let recorded = ["--json", "--record", text(&path)];
    for signal in [Signal::INT, Signal::TERM] {
        let mut job = place.job(&[&of_run[..], &recorded].concat());
        place.wait_for_the_run(None);
        job.signal_job(signal);
        let job = job.end();
        job.assert(1, &["sim-host: stopped by a signal"]);
        assert!(!job.err.contains("failed"), "{}", job.err);
        let report = json(&job.out);
        assert_eq!(report["ending"], "stopped");
        assert_adds_up(&report["loop"], "leg");
        assert_adds_up(&report["controller_loop"], "controller");
        let (_, rest, _) = crate::record::read(&path);
        let Some(AnyMessage::End(end)) = rest.last() else { panic!("{:?}", rest.last()) };
        assert_eq!((&*end.ending, end.ticks), ("stopped", count(&report, "ticks")));
        place.assert_clean();
    }
    // Also while the controller starts, of which nothing else is reported.
    let mut job = place.job(&of_run);
    wait_until(|| if place.root().exists() { Ok(()) } else { Err("no domain".to_owned()) });
    job.signal_job(Signal::INT);
    let job = job.end();
    job.assert(1, &["sim-host: stopped by a signal"]);
    assert!(!job.err.contains("failed"), "{}", job.err);
    place.assert_clean();
}

#[test]
fn a_run_whose_controller_is_killed_prints_its_report_and_the_failure() {
    let place = Place::new();
    let of_run = ["--spawn", "--real-time", "--json", "--domain", place.domain()];
    let mut simulator = place.alone(&[&of_run[..], &["--duration", "80000"]].concat());
    place.wait_for_the_run(None);
    simulator.signal_children(Signal::KILL);
    simulator.wait_for_message("died");
    place.end_the_run();
    let simulator = simulator.end();
    simulator.assert(1, &["the controller failed (signal: 9"]);
    let report = json(&simulator.out);
    assert_eq!((&report["ending"], &report["controller_loop"]), (&"stopped".into(), &Value::Null));
    assert_adds_up(&report["loop"], "leg");
    place.assert_clean();
}

/// Regression: iceoryx2 panicked in printing that it does not know this log level.
#[test]
fn a_signal_in_real_time_ends_a_program_as_ever_after_its_readers_have_gone() {
    let place = Place::new();
    let run = ["run", "--real-time", "--live", "--duration", "80000", "--domain", place.domain()];
    let stays = ["controller", "--real-time", "--live", "--domain", place.domain()];
    let spawns = [&run[..], &["--spawn"]].concat();
    for (arguments, status) in [(spawns, 1), (stays.to_vec(), 0)] {
        let (reader, gone) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = Command::new(PROGRAM);
        command.args(&arguments).env("IOX2_LOG_LEVEL", "none").stdin(Stdio::null());
        command.stdout(gone.try_clone().expect("a pipe's end")).stderr(gone);
        let mut program = command.spawn().expect("start");
        if status == 1 {
            place.wait_for_the_run(None);
        } else {
            place.wait_for_the_controller();
        }
        let pid = rustix::process::Pid::from_child(&program);
        rustix::process::kill_process(pid, Signal::INT).expect("signal");
        assert_eq!(program.wait().expect("wait").code(), Some(status), "{arguments:?}");
        place.assert_clean();
    }
}
