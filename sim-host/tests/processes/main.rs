//! Real processes over real shared memory: connecting, leaving, and being killed.

mod bridge;
mod estimates;
mod estimator;
mod faults;
mod foxglove_server;
mod logs;
mod observed;
mod other_programs;
mod peers;
mod place;
mod real_time;
mod record;
mod recover;
mod recovery;
mod sensors;
mod shared_memory;
mod swap;
mod unwritable;
mod viewers;
mod watch;

use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

use place::{Place, folder_of, text, wait_until};
use rustix::process::Signal;

/// Time within which the death of a process must be noticed.
const SOON: Duration = Duration::from_secs(8);
const LONG_TIMEOUT: [&str; 2] = ["--timeout", "30"];
/// Runs longer than its test.
const ENDLESS: [&str; 4] = ["--duration", "80000", "--timeout", "30"];
const SHORT: [&str; 4] = ["--duration", "20", "--start-vx", "0.2"];

/// A closed pipe is what `| head -1` causes.
#[test]
fn a_closed_output_pipe_is_success_and_a_full_disk_a_failure() {
    let to = |out: Stdio| {
        let mut program = Command::new(place::PROGRAM);
        program.args(["run", "--in-process", "--duration", "1"]).stdout(out).output().unwrap()
    };
    let (reader, gone) = std::io::pipe().unwrap();
    drop(reader);
    let run = to(gone.into());
    assert!(run.status.success() && run.stderr.is_empty(), "{run:?}");
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let run = to(full.into());
    assert_eq!(run.status.code(), Some(1));
    let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(stderr.contains("No space left") && !stderr.contains("panicked"), "{stderr}");
}

#[test]
fn messages_on_a_full_disk_do_not_end_a_run() {
    let full = || fs::File::options().write(true).open("/dev/full").unwrap();
    let place = Place::new();
    let run = |arguments: &[&str]| {
        let mut program = Command::new(place::PROGRAM);
        program.args(arguments).current_dir(place.file("")).stdin(Stdio::null());
        program.stdout(Stdio::null()).stderr(full()).status().unwrap().code()
    };
    // A message while it waits, and an error, of each program.
    assert_eq!(run(&["run", "--domain", place.domain(), "--timeout", "1.3"]), Some(1));
    let controller = ["controller", "--once", "--domain", place.domain(), "--timeout", "1.3"];
    assert_eq!(run(&controller), Some(1));
    place.assert_clean();
}

#[test]
fn a_run_has_the_same_hash_with_any_controller() {
    let place = Place::new();
    let spawned = place.alone(&[&["--spawn"], &SHORT[..]].concat()).end();
    let again = place.alone(&[&["--spawn"], &SHORT[..]].concat()).end();
    let within = place.alone(&[&["--in-process"], &SHORT[..]].concat()).end();
    let controller = place.controller(&LONG_TIMEOUT);
    let apart = place.simulator(&[&SHORT[..], &LONG_TIMEOUT].concat()).end();
    let controller = controller.end();

    let hash = within.assert_ok().state_hash();
    for run in [&spawned, &again, &apart] {
        assert_eq!(run.assert_ok().state_hash(), hash);
        assert!(run.out.contains("20000 ticks"), "{}", run.out);
        assert_eq!(run.err, "");
    }
    controller.assert_ok();
    assert!(controller.out.contains("20000 ticks"), "{}", controller.out);
    assert!(controller.out.contains("0 samples rejected"), "{}", controller.out);

    let json = place.alone(&[&["--in-process", "--json"], &SHORT[..]].concat()).end();
    let report: serde_json::Value = serde_json::from_str(&json.assert_ok().out).expect("JSON");
    assert_eq!(report["state_hash"], hash.as_str());
    assert_eq!(report["ticks"], 20_000);
    place.assert_clean();
}

#[test]
fn names_a_missing_peer_and_the_command_to_start_it() {
    let place = Place::new();
    let simulator = place.simulator(&["--timeout", "1.5"]).end();
    simulator.assert(1, &["still waiting", "no controller", "controller --policy", "--timeout"]);
    assert!(simulator.took >= Duration::from_millis(1500), "{:?}", simulator.took);
    let controller = place.controller(&["--timeout", "0.3"]).end();
    controller.assert(
        1,
        &["no simulator", &format!("sim-host run --domain {} --rate 1000", place.domain())],
    );
    place.assert_clean();
}

#[test]
fn reports_a_killed_controller_and_accepts_another() {
    let place = Place::new();
    for _ in 0..2 {
        let mut controller = place.controller(&LONG_TIMEOUT);
        place.wait_for_the_controller();
        let simulator = place.simulator(&["--duration", "80000", "--timeout", "3"]);
        place.wait_for_the_run(None);
        let pid = controller.pid();
        controller.kill();
        let died = format!("the controller (process {pid}) died");
        let parts = [&died, "start it again", "no other connected within", "--timeout"];
        simulator.end().assert(1, &parts);
        place.assert_clean();
    }
}

#[test]
fn reports_a_killed_simulator_and_accepts_another() {
    let place = Place::new();
    for _ in 0..2 {
        let mut simulator = place.simulator(&ENDLESS);
        let controller = place.controller(&LONG_TIMEOUT);
        place.wait_for_the_run(None);
        let pid = simulator.pid();
        simulator.kill();
        controller.end().assert(1, &[&format!("the simulator (process {pid}) died")]);
        place.assert_clean();
    }
}

#[test]
fn accepts_a_new_peer_before_the_death_of_the_old_one_is_noticed() {
    let place = Place::new();
    let mut simulator = place.simulator(&ENDLESS);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    // It can neither notice the loss of its peer nor clean up.
    simulator.signal(Signal::STOP);
    let dead = controller.pid();
    controller.kill();
    let mut successor = place.controller(&LONG_TIMEOUT);
    let pid = successor.pid();
    place.wait_for_status(|status| status["pid"] == pid);
    simulator.signal(Signal::CONT);
    // The successor continues the run.
    place.wait_for_status(|status| status["ticks"].as_u64() > Some(0));
    simulator.signal(Signal::INT);
    let simulator = simulator.end();
    simulator.assert(1, &["stopped by a signal"]);
    for message in [&format!("the controller (process {dead}) died")[..], "is back"] {
        assert_eq!(simulator.err.matches(message).count(), 1, "{}", simulator.err);
    }
    successor.end().assert(1, &["left before the run was over"]);
    place.assert_clean();
}

#[test]
fn a_signal_ends_a_run_and_cleans_up() {
    let place = Place::new();
    let hang_up = requirements::sighup();
    for signal in [Signal::INT, Signal::TERM].into_iter().chain(hang_up.then_some(Signal::HUP)) {
        let mut simulator = place.simulator(&ENDLESS);
        let controller = place.controller(&LONG_TIMEOUT);
        place.wait_for_the_run(None);
        simulator.signal(signal);
        simulator.end().assert(1, &["stopped by a signal"]);
        controller.end().assert(1, &["the simulator", "left before the run was over"]);
        place.assert_clean();
    }
    let mut simulator = place.simulator(&ENDLESS);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    controller.signal(Signal::TERM);
    controller.end().assert(1, &["stopped by a signal"]);
    simulator.wait_for_message("left before the run was over");
    simulator.signal(Signal::INT);
    let left = ["the controller", "left before the run was over", "stopped by a signal"];
    simulator.end().assert(1, &left);
    place.assert_clean();

    // Two at once, as `timeout` sends them, are one.
    for apart_ms in 0..8 {
        let mut simulator = place.simulator(&ENDLESS);
        let controller = place.controller(&LONG_TIMEOUT);
        place.wait_for_the_run(None);
        simulator.signal(Signal::TERM);
        std::thread::sleep(Duration::from_millis(apart_ms));
        simulator.signal(Signal::TERM);
        simulator.end().assert(1, &["stopped by a signal"]);
        controller.end().assert(1, &["the simulator", "left before the run was over"]);
        place.assert_clean();
    }

    // Also while it waits.
    let mut alone = place.simulator(&LONG_TIMEOUT);
    alone.wait_for_message("still waiting");
    alone.signal(Signal::INT);
    alone.end().assert(1, &["stopped by a signal while waiting for the controller"]);
    place.assert_clean();
}

#[test]
fn refuses_a_second_process_in_the_same_role() {
    let place = Place::new();
    let mut simulator = place.simulator(&ENDLESS);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    let taken = |role: &str, pid: u32| {
        format!("a {role} is already running in domain `{}` (process {pid})", place.domain())
    };
    place
        .controller(&LONG_TIMEOUT)
        .end()
        .assert(1, &[&taken("controller", controller.pid()), "--domain"]);
    place
        .simulator(&LONG_TIMEOUT)
        .end()
        .assert(1, &[&taken("simulator", simulator.pid()), "--domain"]);
    // The first two processes are not affected.
    simulator.signal(Signal::INT);
    simulator.end().assert(1, &["stopped by a signal"]);
    controller.end().assert(1, &["left"]);
    place.assert_clean();
}

#[test]
fn both_sides_refuse_different_rates() {
    let place = Place::new();
    let simulator = place.simulator(&[&["--rate", "2000"], &LONG_TIMEOUT[..]].concat());
    let controller = place.controller(&LONG_TIMEOUT).end();
    let simulator = simulator.end();
    controller.assert(1, &["the simulator runs at 2000 Hz, this program at 1000 Hz"]);
    simulator.assert(1, &["the controller runs at 1000 Hz, this program at 2000 Hz"]);
    place.assert_clean();
}

#[test]
fn both_sides_refuse_different_gravities() {
    let place = Place::new();
    let simulator = place.simulator(&[&["--medium", "moon"], &LONG_TIMEOUT[..]].concat());
    let controller = place.controller(&LONG_TIMEOUT).end();
    let simulator = simulator.end();
    let remedy = "give both the same --gravity";
    let parts = ["the simulator is under a gravity of 1.62 m/s2", "under 9.81 m/s2", remedy];
    controller.assert(1, &parts);
    let parts = ["the controller is under a gravity of 9.81 m/s2", "under 1.62 m/s2", remedy];
    simulator.assert(1, &parts);

    let short = ["--medium", "moon", "--duration", "1", "--timeout", "30"];
    let simulator = place.simulator(&short);
    let controller = place.controller(&[&["--gravity", "1.62"], &LONG_TIMEOUT[..]].concat());
    controller.end().assert_ok();
    simulator.end().assert_ok();
    place.alone(&[&["--spawn"], &short[..]].concat()).end().assert_ok();
    place.assert_clean();
}

#[test]
fn warns_once_of_a_policy_for_another_leg() {
    let place = Place::new();
    let crab = ["--leg", "crab", "--duration", "0.1", "--timeout", "30"];
    let warning = "warning: the policy hop in place was trained for another leg (80 kg";
    let simulator = place.simulator(&crab);
    let controller = place.controller(&LONG_TIMEOUT).end();
    for run in [
        controller,
        place.alone(&[&["--in-process"], &crab[..]].concat()).end(),
        place.alone(&[&["--spawn"], &crab[..]].concat()).end(),
    ] {
        assert_eq!(run.err.matches(warning).count(), 1, "{}", run.err);
    }
    simulator.end();
    place.assert_clean();
}

#[test]
fn reports_an_unwritable_folder_that_was_named_before_the_run() {
    let place = Place::new();
    let in_the_way = place.policy();
    let shore = place.shore(&in_the_way).end();
    shore.assert(2, &[text(&in_the_way), "shore.svg", "--out"]);
    assert_eq!(shore.out, "", "the run has not started");
    assert_eq!(shore.err.lines().count(), 1, "{}", shore.err);
    // Whatever writes there: the path cannot be that of a file.
    let below = text(&in_the_way.join("x")).to_owned();
    let recording = text(&place.file("none.mcap")).to_owned();
    for arguments in [
        &["robustness", "--out", &below][..],
        &["plot", &recording, "-o", &below],
        &["run", "--in-process", "--record", &below],
        &["controller", "virtual-board", "--unix", &below],
        &["bridge", "--unix", "nowhere", "--share", &below],
    ] {
        place.start(arguments[0], &arguments[1..]).end().assert(2, &[&below, "Not a directory"]);
    }
    place.assert_clean();
}

/// `--out` is not given: the run is wanted most, the picture comes with it.
#[test]
fn prints_the_table_where_the_picture_cannot_be_written() {
    let place = Place::new();
    // A file in place of the folder `out`, which stops the superuser as well.
    fs::write(place.file("out"), "in the way").unwrap();
    let shore = place.demonstration().end();
    shore.assert(1, &["cannot write out/shore.svg", "--out"]);
    assert!(shore.out.contains("state hash"), "{}", shore.out);
    assert!(!shore.out.contains("picture:"), "{}", shore.out);
    assert_eq!(shore.err.lines().count(), 1, "{}", shore.err);
    place.assert_clean();
}

#[test]
fn warns_of_a_run_entirely_in_the_safe_state() {
    let place = Place::new();
    let floats = ["--in-process", "--json", "--density-ratio", "2", "--start-y", "99"];
    let floats = place.alone(&floats).end();
    floats.assert(0, &["warning: the controller never left its safe state", "all 60000 ticks"]);
    let report: serde_json::Value = serde_json::from_str(&floats.out).expect("JSON");
    assert_eq!(report["safe_ticks"], report["ticks"]);
    assert!(report["rejected"].as_u64() > Some(0), "above 100 m: {}", floats.out);
    let falls = place.alone(&["--in-process", "--duration", "5"]).end();
    assert!(falls.assert_ok().out.contains("samples rejected 0"), "{}", falls.out);
    assert_eq!(falls.err, "");
    place.assert_clean();
}

/// The shipped policy stops the leg where it stands, some micrometres behind.
#[test]
fn a_leg_that_stays_where_it_is_has_moved_by_zero_and_not_by_minus_zero() {
    let place = Place::new();
    let run = place.start("run", &["--in-process", "--duration", "3"]).end();
    let moved = "time over after 3.000 s (3000 ticks), 0.000 m\n";
    assert!(run.assert_ok().out.starts_with(moved), "{}", run.out);
}

#[test]
fn rejects_invalid_scenarios_with_status_2() {
    let place = Place::new();
    let missing = text(&place.file("none.toml")).to_owned();
    place.controller(&["--rate", "7"]).end().assert(2, &["7 Hz", "50"]);
    place.controller(&["--timeout", "-1"]).end().assert(2, &["--timeout", "-1", "above 0"]);
    place.simulator(&["--scenario", &missing]).end().assert(2, &["cannot read", &missing]);
    place.simulator(&["--set-point", "99"]).end().assert(2, &["set_point_m_s", "99", "50"]);
    place.controller(&["--gravity", "-1"]).end().assert(2, &["gravity -1", "above 0"]);
    for (flag, key, limit) in [
        ("--timeout", "--timeout", "above 0"),
        ("--gravity", "gravity_m_s2", "above 0"),
        ("--start-y", "start.y_m", "above 0"),
        ("--start-y-spread", "start.y_spread_m", "from 0"),
        ("--start-vx-spread", "start.vx_spread_m_s", "from 0"),
        ("--density-ratio", "density_ratio", "from 0"),
        ("--duration", "duration_s", "above 0"),
        ("--distance", "distance_m", "above 0"),
        ("--rate", "--rate", "0.."),
        ("--seed", "--seed", "-1"),
    ] {
        place.simulator(&[flag, "-1"]).end().assert(2, &[key, "-1", limit]);
    }
    place.simulator(&["--rate", "0"]).end().assert(2, &["--rate: rate_hz: 0", "from 50 to 20000"]);
    let unused = place.alone(&["--in-process", "--domain", "x"]).end();
    unused.assert(2, &["--domain has no effect with --in-process"]);
    place.simulator(&["--policy", "any.bin"]).end().assert(2, &["--policy", "--spawn"]);
    place
        .alone(&["--spawn", "--domain", "a/b"])
        .end()
        .assert(2, &["a/b", "is not a valid domain name"]);

    let scenario = place.file("scenario.toml");
    fs::write(&scenario, "duration_s = 1.0\nsped = 3\n").unwrap();
    let scenario = text(&scenario);
    place.simulator(&["--scenario", scenario]).end().assert(2, &[scenario, "line 2", "sped"]);

    fs::write(place.policy(), "no policy").unwrap();
    place.alone(&["--in-process"]).end().assert(2, &["policy.bin is not a valid policy"]);
    let spawned = place.alone(&["--spawn"]).end();
    spawned.assert(2, &["policy.bin is not a valid policy"]);
    assert_eq!(spawned.err.lines().count(), 1, "{}", spawned.err);
    place.assert_clean();
}

#[test]
fn a_spawned_controller_ends_with_its_simulator() {
    let place = Place::new();
    let mut simulator = place.alone(&[&["--spawn"], &ENDLESS[..]].concat());
    let domain = format!("run-{}", simulator.pid());
    place.wait_for_the_run(Some(&domain));
    simulator.signal(Signal::TERM);
    simulator.end().assert(1, &["stopped by a signal"]);
    place.assert_clean_of(Some(&domain));

    let mut simulator = place.alone(&[&["--spawn"], &ENDLESS[..]].concat());
    let domain = format!("run-{}", simulator.pid());
    place.wait_for_the_run(Some(&domain));
    simulator.kill();
    // The controller notices, ends, and removes everything.
    wait_until(|| {
        let left = folder_of(&domain).exists();
        if left { Err("the controller is left".to_owned()) } else { Ok(()) }
    });
    place.assert_clean_of(Some(&domain));
}

#[test]
fn the_next_process_removes_the_remains_of_killed_ones() {
    let place = Place::new();
    let simulator = place.simulator(&ENDLESS);
    let controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    // Stopped first, so that neither notices the death of the other.
    for mut process in [simulator, controller] {
        process.signal(Signal::STOP);
        process.kill();
    }
    assert!(place.root().join("leg.role").exists());
    place.alone(&[&["--spawn"], &SHORT[..]].concat()).end().assert_ok();
    place.assert_clean();
}
