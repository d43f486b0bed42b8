//! Programs of another language at the other end: the scripts in `sim-host/peers`.

use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::Path;
use std::process::Command;

use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::{self, Header, Sample, WIRE_VERSION};
use leg_control::wire_controller::WireController;
use leg_host::Domain;
use leg_plant::{Event, EventKind};
use rustix::process::Signal;
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::{Options, TickRecord, stepped};

use crate::place::{Place, Running, text, wait_until};
use crate::{ENDLESS, LONG_TIMEOUT};

const SCRIPTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/peers");

/// Starts a script of this folder in the test domain.
pub(crate) fn script(place: &Place, python: &Path, name: &str, more: &[&str]) -> Running {
    let mut command = Command::new(python);
    command.arg(format!("{SCRIPTS}/{name}")).args(["--domain", place.domain()]).args(more);
    Running::start(&mut command)
}

fn scenario(set_point_m_s: f64, duration_s: f64) -> Scenario {
    let settings = Settings {
        set_point_m_s: Some(set_point_m_s),
        duration_s: Some(duration_s),
        ..Settings::default()
    };
    Scenario::from_settings(&settings).expect("valid")
}

/// Returns the horizontal velocity at each apex of a run with this law, m/s, and its hash.
fn played(
    scenario: &Scenario,
    law: impl FnMut(Option<&Sample>) -> wire::Command,
) -> (Vec<f64>, u64) {
    let mut apexes = Vec::new();
    let observe = |tick: &TickRecord<'_>| {
        let is_apex = |event: &&Event| event.kind == EventKind::Apex;
        apexes.extend(tick.events.iter().filter(is_apex).map(|event| event.body.vx_m_s));
    };
    let outcome = stepped::run(scenario, law, Options::default(), observe).expect("no link");
    (apexes, outcome.state_hash)
}

fn with_the_shipped_policy(set_point_m_s: f64, duration_s: f64) -> Vec<f64> {
    let scenario = scenario(set_point_m_s, duration_s);
    let policy = Policy::parse(SHIPPED).expect("shipped");
    let mut controller =
        WireController::new(policy, scenario.controller_config().expect("a configuration"));
    played(&scenario, |sample| controller.tick(sample)).0
}

fn apexes(report: &str) -> Vec<f64> {
    let report: serde_json::Value = serde_json::from_str(report).expect(report);
    let apexes = report["apexes_m_s"].as_array().expect("a list").clone();
    apexes.iter().map(|vx| vx.as_f64().expect("a number")).collect()
}

#[test]
fn a_leg_in_python_hops_in_lock_step_as_our_own_plant() {
    let Some(python) = requirements::python() else { return };
    for (set_point_m_s, duration_s) in [(0.0, 12.0), (1.0, 20.0), (-0.5, 12.0)] {
        let place = Place::new();
        let controller = place.start("controller", &["--once", "--domain", place.domain()]);
        place.wait_for_the_controller();
        let [set_point, duration] = [set_point_m_s, duration_s].map(|x: f64| x.to_string());
        let more = ["--set-point", &set_point, "--duration", &duration];
        let leg = script(&place, &python, "leg.py", &more).end();
        let controller = controller.end();
        let (theirs, ours) =
            (apexes(&leg.assert_ok().out), with_the_shipped_policy(set_point_m_s, duration_s));
        assert_eq!(theirs.len(), ours.len(), "{theirs:?} {ours:?}");
        assert!(theirs.len() > 8, "{theirs:?}");
        for (theirs, ours) in theirs.iter().zip(&ours) {
            assert!((theirs - ours).abs() < 1e-4, "{theirs} m/s at an apex, ours {ours} m/s");
        }
        let ticks = format!("{} ticks", 1000.0 * duration_s);
        assert!(controller.assert_ok().out.contains(&ticks), "{}", controller.out);
        assert!(controller.out.contains("0 samples rejected"), "{}", controller.out);
        place.assert_clean();
    }
}

/// How many ticks either side misses depends on the machine; that the leg hops does not.
#[test]
fn a_leg_in_python_hops_in_real_time() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let real_time = ["--once", "--real-time", "--domain", place.domain()];
    let controller = place.start("controller", &real_time);
    place.wait_for_the_controller();
    let more = ["--mode", "real-time", "--duration", "5"];
    let leg = script(&place, &python, "leg.py", &more).end();
    assert!(apexes(&leg.assert_ok().out).len() >= 3, "{}", leg.out);
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_controller_in_python_moves_our_leg_as_its_law_does_within_our_process() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let controller = script(&place, &python, "controller.py", &[]);
    wait_until(|| {
        let listens = place.root().join("session.sock").exists();
        if listens { Ok(()) } else { Err("it does not listen".to_owned()) }
    });
    let run = place.simulator(&["--duration", "20", "--set-point", "0.5", "--timeout", "30"]).end();
    assert!(controller.end().assert_ok().out.contains("\"ticks\": 20000"));
    let law = |sample: Option<&Sample>| {
        let Sample { header, vx_m_s, set_point_m_s, .. } = *sample.expect("no fault");
        let angle_rad = FRAC_PI_2 + 0.17 * f64::from(vx_m_s) - 0.05 * f64::from(set_point_m_s);
        let header = Header { version: WIRE_VERSION, flags: 0, ..header };
        wire::Command { header, leg_angle_rad: angle_rad as f32, ..wire::Command::default() }
    };
    let (apexes, hash) = played(&scenario(0.5, 20.0), law);
    assert!(apexes.len() > 8, "{apexes:?}");
    assert_eq!(run.assert_ok().state_hash(), format!("{hash:016x}"), "{}", run.out);
    // A script leaves its memory; the next process to join removes it.
    drop(Domain::join(place.domain()).expect("join"));
    place.assert_clean();
}

/// The flight, the ground and the leg are those of `MuJoCo`, with a foot of 0.5 kg on a damped spring and a
/// friction cone; the law is the program's.
#[test]
fn a_leg_in_mujoco_keeps_its_set_point_in_air_and_half_in_water() {
    let Some(python) = requirements::python() else { return };
    for (density_ratio, set_point_m_s) in [("0", 0.5), ("0.5", 1.0)] {
        let place = Place::new();
        let controller = place.start("controller", &["--once", "--domain", place.domain()]);
        place.wait_for_the_controller();
        let set_point = set_point_m_s.to_string();
        let more = ["--set-point", &set_point, "--density", density_ratio, "--hops", "20"];
        let leg = script(&place, &python, "mujoco/mujoco_leg.py", &more).end();
        let report: serde_json::Value = serde_json::from_str(&leg.assert_ok().out).expect("JSON");
        assert_eq!((&report["hops"], &report["fallen"]), (&20.into(), &false.into()), "{report}");
        let vx_m_s = report["vx_m_s"].as_f64().expect("a number");
        assert!((vx_m_s - set_point_m_s).abs() < 0.05 * set_point_m_s, "{report}");
        controller.end().assert_ok();
        place.assert_clean();
    }
}

#[test]
fn the_scripts_are_as_short_as_the_documents_say() {
    for name in ["leg.py", "controller.py"] {
        let script = fs::read_to_string(format!("{SCRIPTS}/{name}")).expect(name);
        assert!(script.lines().count() <= 60, "{name}");
    }
}

#[test]
fn the_command_domain_prints_what_a_program_needs_to_connect() {
    let place = Place::new();
    let report = || {
        let domain = ["domain", "--json", "--domain", place.domain()];
        let printed = place.start("controller", &domain).end();
        serde_json::from_str::<serde_json::Value>(&printed.assert_ok().out).expect("JSON")
    };
    let nobody = report();
    assert_eq!(nobody["prefix"], serde_json::Value::Null);
    assert_eq!(nobody["socket"], text(&place.root().join("session.sock")));
    assert!(!place.root().exists(), "nothing is created");

    let mut simulator = place.simulator(&ENDLESS);
    let mut controller = place.controller(&LONG_TIMEOUT);
    place.wait_for_the_run(None);
    let report = report();
    let domain = Domain::join(place.domain()).expect("join");
    assert_eq!(report["prefix"], domain.prefix());
    drop(domain);
    for (role, pid) in [("leg", simulator.pid()), ("controller", controller.pid())] {
        assert_eq!(report[role], serde_json::json!({"is_held": true, "pid": pid}));
    }
    let session = &report["session"];
    let folder = session["folder"].as_str().expect("a session");
    assert!(Path::new(folder).is_dir(), "{folder}");
    assert!(
        session["prefix"].as_str().expect("one").starts_with(report["prefix"].as_str().unwrap())
    );
    let samples = &report["services"][0];
    assert_eq!(
        (&samples["name"], &samples["payload_type"], &samples["bytes"]),
        (&"leg/samples".into(), &"leg.sample.v2".into(), &96.into())
    );
    assert_eq!(samples["fields"][5]["offset"], 24);
    let text = place.start("controller", &["domain", "--domain", place.domain()]).end();
    for part in [folder, "leg.command.v2, 64 bytes, alignment 8", " 24  f32       set_point_m_s"] {
        assert!(text.assert_ok().out.contains(part), "`{part}` is not in: {}", text.out);
    }
    simulator.signal(Signal::INT);
    simulator.end();
    controller.end();
    place.assert_clean();
}

/// Starts a copy of a script with one mistake.
///
/// The leg of the copy does not move, so that its run does not end by a fall, however fast the
/// machine is.
fn mistaken(place: &Place, python: &Path, name: &str, [right, wrong]: [&str; 2]) -> Running {
    let script = fs::read_to_string(format!("{SCRIPTS}/{name}")).expect(name);
    let steps = "for step in range(20):";
    assert_eq!(script.matches(steps).count(), 1, "`{steps}` in {name}");
    let script = script.replace(steps, "for step in range(0):");
    assert_eq!(script.matches(right).count(), 1, "`{right}` in {name}");
    let copy = place.file(name);
    fs::write(&copy, script.replace(right, wrong)).expect("write");
    let mut command = Command::new(python);
    Running::start(command.arg(copy).args(["--domain", place.domain(), "--duration", "80000"]))
}

/// Each mistake was made by people who wrote a leg: what both sides print of it.
#[test]
fn a_leg_that_is_half_met_is_told_why_and_so_is_the_user_of_the_controller() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let mut controller = place.start("controller", &["--domain", place.domain()]);
    place.wait_for_the_controller();
    for (mistake, at_the_controller, at_the_leg) in [
        (
            ["\"gravity_m_s2\": 9.81", "\"gravity_m_s2\": 9.8"],
            "the simulator is under a gravity of 9.8 m/s2, this program under 9.81 m/s2",
            "the controller is under a gravity of 9.81 m/s2, this program under 9.8 m/s2",
        ),
        (
            ["\"wire_version\": 2", "\"wire_version\": 1"],
            "the simulator uses version 1 of the messages",
            "the controller uses version 2 of the messages, this program version 1",
        ),
        (
            ["{\"version\": 1", "{\"version\": 7"],
            "the simulator uses version 7 of the session protocol",
            "the controller uses version 1 of the session protocol, this program version 7",
        ),
        (
            ["\"time_mode\"", "\"timemode\""],
            "`timemode` is no parameter of this version",
            "`timemode` is no parameter of this version",
        ),
        (
            ["\"rate_hz\": 1000, ", ""],
            "its first line is not understood (missing field `rate_hz`",
            "the first line is not understood: missing field `rate_hz`",
        ),
        (
            [
                "iox2.FileName.new(session[\"prefix\"])",
                "iox2.FileName.new(session[\"prefix\"] + \"other.\")",
            ],
            "but left before it was ready; see its own output",
            "DoesNotExist",
        ),
        (
            ["(\"sensors\", U32 * 12)", "(\"sensors\", U32 * 10)"],
            "but left before it was ready; see its own output",
            "IncompatibleTypes",
        ),
        (
            ["service(\"leg/samples\", Sample).publisher_builder().create()", "None"],
            "has no publisher at leg/samples in the session when it is ready",
            "has no publisher at leg/samples in the session",
        ),
    ] {
        mistaken(&place, &python, "leg.py", mistake).end().assert(1, &[at_the_leg]);
        controller.wait_for_message(at_the_controller);
    }
    // Those that do not go on are named while they live.
    for (mistake, at_the_controller) in [
        (["send({\"hello\"", "time.sleep(99); send({\"hello\""], "has not sent its hello"),
        (["send(\"ready\")", "time.sleep(99)"], "has not sent that it is ready, with ports in"),
    ] {
        let _leg = mistaken(&place, &python, "leg.py", mistake);
        controller.wait_for_message(at_the_controller);
    }
    controller.signal(Signal::INT);
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_controller_explains_its_safe_state_while_it_holds() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let mut controller = place.start("controller", &["--domain", place.domain()]);
    place.wait_for_the_controller();
    for (mistake, message) in [
        (["seq, seq * 10**6,", "seq, seq * 10**3,"], "are they in microseconds?"),
        (["send_sample(2, 0b", "send_sample(3, 0b"], "the last: wire version 3 instead of 2"),
        (
            ["send_sample(2, 0b11100001", "send_sample(2, 0b11100000"],
            "neither contact nor leg length is sensed",
        ),
        (
            ["speed.real, body.imag, speed.imag)", "99, body.imag, speed.imag)"],
            "vx_m_s is 99, it must be from -50 to 50",
        ),
    ] {
        let mut leg = mistaken(&place, &python, "leg.py", mistake);
        controller.wait_for_message(message);
        let pid = leg.pid();
        leg.kill();
        controller.wait_for_message(&format!("(process {pid}) died"));
    }
    controller.signal(Signal::INT);
    controller.end().assert_ok();
    place.assert_clean();
}

/// Starts a copy of the controller with one mistake, and waits until it listens.
fn mistaken_controller(place: &Place, python: &Path, [right, wrong]: [&str; 2]) -> Running {
    let script = fs::read_to_string(format!("{SCRIPTS}/controller.py")).expect("a script");
    assert_eq!(script.matches(right).count(), 1, "`{right}` in controller.py");
    let copy = place.file("controller.py");
    fs::write(&copy, script.replace(right, wrong)).expect("write");
    let controller =
        Running::start(Command::new(python).arg(copy).args(["--domain", place.domain()]));
    wait_until(|| {
        let listens = place.root().join("session.sock").exists();
        if listens { Ok(()) } else { Err("it does not listen".to_owned()) }
    });
    controller
}

#[test]
fn a_controller_that_is_half_met_is_told_why_and_so_is_the_user_of_the_leg() {
    let Some(python) = requirements::python() else { return };
    for (mistake, at_the_leg, at_the_controller) in [
        (
            ["\"gravity_m_s2\": 9.81", "\"gravity_m_s2\": 9.8"],
            "the controller is under a gravity of 9.8 m/s2, this program under 9.81 m/s2",
            "the simulator is under a gravity of 9.81 m/s2, this program under 9.8 m/s2",
        ),
        (["(\"sensors\", U32 * 12)", "(\"sensors\", U32 * 10)"], "leg.sample.v2", "leg.sample.v2"),
        (
            ["f\"leg-{os.getuid()}-", "f\"leg-"],
            "it names no session of this domain: the folder must lie in",
            "it names no session of this domain",
        ),
        (
            [
                "samples = service(\"leg/samples\", Sample).subscriber_builder().buffer_size(1).create()",
                "service(\"leg/samples\", Sample)",
            ],
            "has no subscriber at leg/samples in the session",
            "has no subscriber at leg/samples in the session",
        ),
    ] {
        let place = Place::new();
        let controller = mistaken_controller(&place, &python, mistake);
        let simulator = place.simulator(&["--timeout", "1.5"]).end();
        simulator.assert(1, &[at_the_leg]);
        controller.end().assert(1, &[at_the_controller]);
        // Memory under a name that is not the domain's is nobody's but the script's.
        for entry in fs::read_dir("/dev/shm").expect("a folder").flatten() {
            if entry.file_name().to_string_lossy().contains(&format!("{}-", place.domain())) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

#[test]
fn a_leg_names_the_command_that_answers_another_sample() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let controller = mistaken_controller(
        &place,
        &python,
        ["sample.seq, sample.t_ns", "sample.seq + 1, sample.t_ns"],
    );
    let simulator = place.simulator(&["--timeout", "1.5"]).end();
    simulator.assert(1, &["and sequence number 1, the sample that waits 2, ", " and 0"]);
    controller.end().assert_ok();
}
