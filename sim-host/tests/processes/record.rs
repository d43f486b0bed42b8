//! Recordings: written however a run ends, read back, replayed and plotted.

use std::fs;
use std::path::{Path, PathBuf};

use leg_control::config::Config as ControlConfig;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::{Command, Sample, SensorReadings, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;
use leg_host::TimeMode;
use leg_host::memory::Inline;
use leg_host::recorded::RecordedError;
use leg_process::policy_file::AlignedBytes;
use rustix::process::Signal;
use sim_host::record::config;
use sim_host::record::read::Reader;
use sim_host::record::schema::{AnyMessage, Policy as PolicyMessage, SetPoint};
use sim_host::record::{OnFull, RecordOptions, Recorder};
use sim_host::replay::{self, ReplayError};
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::{Options, lock_step};

use crate::ENDLESS;
use crate::place::{self, PROGRAM, Place, Running, folder_of, text};

/// How the tests record in lock-step.
pub(crate) const RECORD_OPTIONS: RecordOptions =
    RecordOptions { on_full: OnFull::Wait, display_rate_hz: 50 };

pub(crate) fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    place::wait_until(|| if is_so() { Ok(()) } else { Err(what.to_owned()) });
}

fn shipped() -> PathBuf {
    requirements::checkout().join("controller/policies/robust.bin")
}

pub(crate) fn part(path: &Path) -> PathBuf {
    path.with_extension("mcap.part")
}

pub(crate) fn size(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |m| m.len())
}

/// Returns the samples and commands of a file, its other messages, and its warning.
pub(crate) fn read(path: &Path) -> (Vec<(Sample, Command)>, Vec<AnyMessage>, Option<String>) {
    let mut reader = Reader::open(path).unwrap();
    let (mut ticks, mut rest, mut last) = (Vec::new(), Vec::new(), None);
    while let Some(entry) = reader.next_message().unwrap() {
        match entry.message {
            AnyMessage::Sample(sample) => last = Some(Sample::from(&sample)),
            AnyMessage::Command(command) => ticks.push((last.unwrap(), Command::from(&command))),
            entry => rest.push(entry),
        }
    }
    (ticks, rest, reader.warning())
}

/// Plays a run in this process and records the ticks that `keep` selects. Returns
/// all ticks.
fn record(
    path: &Path,
    seconds: u32,
    keep: impl Fn(u64) -> bool,
    policies: &[PolicyMessage],
    law: impl FnMut(&Sample) -> Command,
) -> Vec<(Sample, Command)> {
    record_with(path, seconds, keep, policies, &[], law)
}

/// As [`record`], with set-points of requests.
fn record_with(
    path: &Path,
    seconds: u32,
    keep: impl Fn(u64) -> bool,
    policies: &[PolicyMessage],
    set_points: &[SetPoint],
    law: impl FnMut(&Sample) -> Command,
) -> Vec<(Sample, Command)> {
    let settings = Settings::from_toml(&format!("duration_s = {seconds}.0")).unwrap();
    let scenario = Scenario::from_settings(&settings).unwrap();
    let config = config::of_run(&settings, &scenario, TimeMode::LockStep).unwrap();
    let (recorder, mut tap) =
        Recorder::begin_with(Path::new(PROGRAM), path, &config, RECORD_OPTIONS).unwrap();
    for policy in policies {
        recorder.sink().policy(policy.clone());
    }
    for set_point in set_points {
        recorder.sink().set_point(*set_point);
    }
    let mut ticks = Vec::new();
    let outcome = lock_step::run(&scenario, &mut Inline::new(law), Options::default(), |tick| {
        ticks.push((*tick.sample, *tick.command));
        if keep(tick.seq) {
            tap.push(tick);
        }
    });
    let recorded = recorder.finish(config::of_end(&outcome.unwrap())).unwrap();
    assert_eq!(recorded.dropped, 0);
    ticks
}

fn given(blob: &[u8], seq: u64) -> PolicyMessage {
    PolicyMessage::of(blob, &Policy::parse(blob).unwrap(), 1, seq)
}

fn shipped_controller() -> WireController<'static> {
    WireController::new(Policy::parse(SHIPPED).unwrap(), ControlConfig::at_rate(1000).unwrap())
}

/// `recordings/wire-1.mcap` was made by a build with version 1 of the messages, by `sim-host run
/// --in-process --rate 50 --duration 2 --set-point 0.3 --start-y 1.3 --record wire-1.mcap`.
#[test]
fn reads_replays_and_plots_a_recording_of_wire_version_1() {
    let place = Place::new();
    let path = requirements::checkout().join("sim-host/tests/recordings/wire-1.mcap");
    let (ticks, rest, warning) = read(&path);
    assert_eq!((ticks.len(), warning), (100, None));
    let AnyMessage::Config(config) = &rest[0] else { panic!("{:?}", rest[0]) };
    assert_eq!(config.wire_version, 1);
    for (sample, command) in &ticks {
        let versions = [sample.header.version, command.header.version];
        assert_eq!(versions, [WIRE_VERSION; 2]);
        assert_eq!(sample.header.flags & flags::STATE_SENSED, flags::STATE_SENSED);
        assert_eq!(sample.sensors, SensorReadings::default());
    }
    let replayed = place.start("replay", &[text(&path)]).end();
    let out = &replayed.assert_ok().out;
    assert!(out.contains("100 commands compared: the same, bit for bit"), "{out}");
    let picture = place.file("run.svg");
    place.start("plot", &[text(&path), "-o", text(&picture)]).end().assert_ok();
    assert!(fs::read_to_string(&picture).unwrap().contains("<circle"));
}

#[test]
fn a_recorded_run_is_the_same_run_and_replays_bit_for_bit() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let run = ["--in-process", "--medium", "water", "--set-point", "0.3", "--duration", "20"];
    let bare = place.alone(&run).end().assert_ok().state_hash();
    let recorded = place.alone(&[&run[..], &["--record", text(&path)]].concat()).end();
    assert_eq!(recorded.assert_ok().state_hash(), bare);
    assert!(!part(&path).exists());

    let (ticks, rest, warning) = read(&path);
    assert_eq!((ticks.len(), warning), (20_000, None));
    let kinds = |f: fn(&&AnyMessage) -> bool| rest.iter().filter(f).count();
    assert_eq!(kinds(|e| matches!(e, AnyMessage::State(_))), 20_000);
    assert!(kinds(|e| matches!(e, AnyMessage::Apex(_))) > 5);
    assert!(kinds(|e| matches!(e, AnyMessage::Event(_))) > 10);
    let Some(AnyMessage::End(end)) = rest.last() else { panic!("{:?}", rest.last()) };
    assert_eq!((&end.state_hash, end.ticks), (&bare, 20_000));
    let AnyMessage::Config(config) = &rest[0] else { panic!("{:?}", rest[0]) };
    let settings = Settings::from_toml(&config.scenario_toml).unwrap();
    assert_eq!((settings.set_point_m_s, settings.duration_s), (Some(0.3), Some(20.0)));

    let same = place.start("replay", &[text(&path)]).end();
    assert!(same.assert_ok().out.contains("20000 commands compared: the same, bit for bit"));
    let shipped = shipped();
    let other = place.start("replay", &[text(&path), "--policy", text(&shipped)]).end();
    let out = &other.assert(1, &[] as &[&str]).out;
    assert!(out.contains("20000 commands compared, ") && out.contains("first at tick"), "{out}");
    let json = place.start("replay", &[text(&path), "--policy", text(&shipped), "--json"]).end();
    let report: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!((&report["equal"], &report["compared"]), (&false.into(), &20_000.into()));
    assert!(report["apexes"].as_array().is_some_and(|rows| rows.len() > 5), "{report}");
}

#[test]
fn a_recorded_run_of_a_leg_with_losses_replays_bit_for_bit() {
    let place = Place::new();
    let path = place.file("lossy.mcap");
    let mut run = vec!["--in-process", "--set-point", "0.3", "--duration", "10"];
    for fault in ["damping=50", "foot-mass=2", "friction=0.6", "drive-force=4000"] {
        run.extend(["--fault", fault]);
    }
    run.extend(["--record", text(&path)]);
    place.alone(&run).end().assert_ok();
    let same = place.start("replay", &[text(&path)]).end();
    assert!(same.assert_ok().out.contains("10000 commands compared: the same, bit for bit"));
}

#[test]
fn plots_any_span_of_a_recording() {
    let place = Place::new();
    let (path, svg) = (place.file("run.mcap"), place.file("run.svg"));
    let run = ["--in-process", "--duration", "10", "--record", text(&path)];
    place.alone(&run).end().assert_ok();
    let plot = |more: &[&str]| {
        let own = [text(&path), "-o", text(&svg)];
        place.start("plot", &[&own[..], more].concat()).end()
    };
    plot(&[]).assert_ok();
    let dots = |svg: &Path| fs::read_to_string(svg).unwrap().matches("<circle").count();
    let all = dots(&svg);
    assert!(all > 20, "{all}");
    plot(&["--from", "2", "--until", "5"]).assert_ok();
    assert!((1..all).contains(&dots(&svg)), "{}", dots(&svg));
    plot(&["--from", "11"]).assert(2, &["it has no ticks between", "11", "9.999"]);
    plot(&["--from", "5", "--until", "2"]).assert(2, &["--from 5 --until 2"]);
    let other = place.policy();
    place.start("plot", &[text(&other), "-o", text(&svg)]).end().assert(2, &["not an MCAP file"]);
}

#[test]
fn the_recorded_scenario_parses_to_the_same_settings() {
    let text = "rate_hz = 500\nduration_s = 0.1\nseed = 18446744073709551615\n\
                density_profile = [[1.0, 0.30000000000000004], [2.0, 0.0]]\ngravity_m_s2 = 1.62\n\
                density = \"measured\"\nset_point_m_s = 0.1\nset_point_steps = [{ from_x_m = 3.0, m_s = -1.5 }]\n\
                [start]\nvx_spread_m_s = 0.7\n\
                [leg_parameters]\nmass_kg = 70.0\nadded_mass_kg = 1.0\nstiffness_n_m = 20000.0\n\
                volume_m3 = 0.07\nrest_length_m = 1.0\nmax_elongation_m = 0.1\narea_x_m2 = 0.5\n\
                area_y_m2 = 0.2\ndrag_x = 1.0\ndrag_y = 0.9\n";
    let settings = Settings::from_toml(text).unwrap();
    let scenario = Scenario::from_settings(&settings).unwrap();
    let config = config::of_run(&settings, &scenario, TimeMode::RealTime).unwrap();
    assert_eq!(Settings::from_toml(&config.scenario_toml).unwrap(), settings);
    assert_eq!((config.rate_hz, config.gravity_m_s2, &*config.time_mode), (500, 1.62, "real-time"));
}

#[test]
fn a_recording_keeps_every_bit_of_nans() {
    let place = Place::new();
    let path = place.file("bits.mcap");
    let mut bits = 0xff80_0000_u32;
    let law = |sample: &Sample| {
        bits = bits.wrapping_mul(0x9e37_79b1).rotate_left(7);
        let any = f32::from_bits(bits);
        // The leg accepts only finite values for what it follows, and any bits in the rest.
        Command {
            header: sample.header,
            leg_angle_rad: 1.5,
            elongation_m: -0.0,
            apex_vx_m_s: any,
            apex_y_m: -any,
            density_ratio: f32::from_bits(0x7f80_0001 | bits),
            velocity_offset_m_s: -0.0,
            apexes: bits,
            ..Command::default()
        }
    };
    let ticks = record(&path, 1, |_| true, &[], law);
    assert!(ticks.iter().filter(|(_, c)| c.density_ratio.is_nan()).count() > 100);
    let (read, _, warning) = read(&path);
    assert_eq!((read.len(), warning), (ticks.len(), None));
    for ((sample, command), (sample_read, command_read)) in ticks.iter().zip(&read) {
        assert_eq!(sample, sample_read);
        assert_eq!(replay::difference(command, command_read), None);
    }
}

#[test]
fn reads_a_cut_file_up_to_its_last_complete_chunk() {
    let place = Place::new();
    let path = place.file("whole.mcap");
    let mut controller = shipped_controller();
    let law = |sample: &Sample| controller.tick(Some(sample));
    let ticks = record(&path, 8, |_| true, &[given(SHIPPED, 0)], law);
    let bytes = fs::read(&path).unwrap();
    let cut = place.file("cut.mcap");
    let mut counts = Vec::new();
    for eighth in 1..8 {
        let len = bytes.len() * eighth / 8;
        fs::write(&cut, &bytes[..len]).unwrap();
        let (read, _, warning) = read(&cut);
        assert!(read[..] == ticks[..read.len()], "the first ticks, cut at {len}");
        let warning = warning.expect("a cut file is not a whole one");
        assert!(warning.contains("cut off"), "{warning}");
        counts.push(read.len());
    }
    assert!(counts.is_sorted() && counts[1] > 0 && counts[6] > counts[1], "{counts:?}");
    let replayed = place.start("replay", &[text(&cut)]).end();
    replayed.assert(0, &["warning", "cut off"]);

    // One wrong byte invalidates its chunk.
    let mut damaged = bytes.clone();
    let index = mcap::Summary::read(&bytes).unwrap().unwrap();
    let chunk = &index.chunk_indexes[index.chunk_indexes.len() / 2];
    damaged[(chunk.chunk_start_offset + chunk.chunk_length / 2) as usize] ^= 1;
    fs::write(&cut, &damaged).unwrap();
    let (read, _, warning) = read(&cut);
    assert!(read.len() < ticks.len() && read[..] == ticks[..read.len()]);
    assert!(warning.is_some_and(|warning| warning.contains("damaged")));
}

#[test]
fn a_killed_run_leaves_a_complete_file() {
    let place = Place::new();
    let path = place.file("killed.mcap");
    let run = ["--spawn", "--duration", "86400", "--record", text(&path)];
    let mut simulator = place.alone(&run);
    let domain = format!("run-{}", simulator.pid());
    wait_until("some of it is written", || size(&part(&path)) > 1 << 20);
    assert!(!path.exists(), "it has its name only when it is finished");
    simulator.kill();
    wait_until("the recorder finishes the file", || path.exists());
    assert!(!part(&path).exists());
    let (ticks, rest, warning) = read(&path);
    assert!(ticks.len() > 1000 && warning.is_none(), "{} {warning:?}", ticks.len());
    assert!(!rest.iter().any(|entry| matches!(entry, AnyMessage::End(_))));
    let policy = place.policy();
    place.start("replay", &[text(&path), "--policy", text(&policy)]).end().assert_ok();
    wait_until("the controller has left", || !folder_of(&domain).exists());
    place.assert_clean_of(Some(&domain));
}

/// Starts an endless recorded run, of which some is written. The recorder is the only child of
/// the simulator.
pub(crate) fn endless_recorded_run(place: &Place, path: &Path) -> (Running, Running) {
    let controller = place.controller(&["--timeout", "30"]);
    let simulator = place.simulator(&[&ENDLESS[..], &["--record", text(path)]].concat());
    wait_until("some of it is written", || size(&part(path)) > 1 << 16);
    (simulator, controller)
}

#[test]
fn a_run_continues_without_its_recorder_and_reports_that_once() {
    let place = Place::new();
    let path = place.file("lost.mcap");
    let (mut simulator, controller) = endless_recorded_run(&place, &path);
    simulator.signal_children(Signal::KILL);
    let notice = "the run continues without its recording: the recorder was ended";
    simulator.wait_for_message(notice);
    let lost_at = place.leg_status().ticks;
    wait_until("the run continues", || place.leg_status().ticks > lost_at);
    place.end_the_run();
    let ended = simulator.end();
    ended.assert(1, &["the recording broke off in", "lost.mcap.part: the recorder was ended"]);
    assert_eq!(ended.err.matches(notice).count(), 1, "{}", ended.err);
    assert!(ended.ticks() > lost_at, "{}", ended.out);
    assert!(!path.exists());
    let (ticks, _, warning) = read(&part(&path));
    assert!(!ticks.is_empty() && warning.is_some());
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn in_lock_step_a_run_waits_for_a_stopped_recorder() {
    let place = Place::new();
    let path = place.file("stopped.mcap");
    let (mut simulator, controller) = endless_recorded_run(&place, &path);
    simulator.signal_children(Signal::STOP);
    let mut last = 0;
    wait_until("the run waits", || {
        let before = std::mem::replace(&mut last, place.leg_status().ticks);
        before == last
    });
    simulator.signal_children(Signal::CONT);
    wait_until("the run continues", || place.leg_status().ticks > last);
    place.end_the_run();
    let ended = simulator.end();
    assert_eq!(read(&path).0.len() as u64, ended.assert_ok().ticks(), "none is missing");
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_replay_finds_one_changed_bit_and_stops_at_a_gap() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let policy = [given(SHIPPED, 0)];
    let mut controller = shipped_controller();
    let law = |sample: &Sample| controller.tick(Some(sample));
    record(&path, 5, |seq| !(3000..3050).contains(&seq), &policy, law);
    let report = replay::replay(&path, None).unwrap();
    assert_eq!((report.equal, report.compared, report.ticks), (true, 3000, 4950));
    let why = report.not_compared.unwrap();
    assert!(why.contains("ticks 3000 to 3049 are not in the recording"), "{why}");

    let mut controller = shipped_controller();
    let law = |sample: &Sample| {
        let command = controller.tick(Some(sample));
        let flip = u32::from(sample.header.seq == 1234);
        Command { apex_y_m: f32::from_bits(command.apex_y_m.to_bits() ^ flip), ..command }
    };
    record(&path, 5, |_| true, &policy, law);
    let report = replay::replay(&path, None).unwrap();
    let found = report.first_difference.unwrap();
    assert_eq!((found.tick, found.field, report.compared), (1234, "apex_y_m", 1235));

    // A controller that is killed and restarted has no state; the report shows that.
    let mut controller = shipped_controller();
    let law = |sample: &Sample| {
        if sample.header.seq == 2500 {
            controller = shipped_controller();
        }
        controller.tick(Some(sample))
    };
    record(&path, 5, |_| true, &policy, law);
    let report = replay::replay(&path, None).unwrap();
    assert_eq!((report.equal, report.restart_ticks, report.compared), (true, vec![2500], 5000));
}

#[test]
fn replays_a_run_in_real_time_with_missed_ticks() {
    // On a busy machine a run has few commands: as many runs as it takes.
    let (mut compared, mut runs) = (0, 0);
    while compared <= 100 {
        compared += commands_of_a_replayed_run();
        runs += 1;
        assert!(runs < 20, "{compared} commands in {runs} runs");
    }
}

/// Records a run in real time, replays it, and returns the number of compared commands.
fn commands_of_a_replayed_run() -> u64 {
    let place = Place::new();
    let path = place.file("real-time.mcap");
    let run = ["--spawn", "--real-time", "--duration", "3", "--record", text(&path)];
    place.alone(&run).end().assert_ok();
    let (ticks, rest, warning) = read(&path);
    assert_eq!((ticks.len(), warning), (3000, None));
    let of_loop: Vec<_> = rest
        .iter()
        .filter_map(|e| if let AnyMessage::Loop(row) = e { Some(row) } else { None })
        .collect();
    // Ticks that a late wake-up missed are played, but have no wake-up of their own.
    assert!(!of_loop.is_empty() && of_loop.len() <= 3000, "{}", of_loop.len());
    assert!(of_loop.is_sorted_by(|a, b| a.seq < b.seq));
    assert!(of_loop.iter().all(|row| row.seq < 3000 && row.tick_ns > 0));
    let report = replay::replay(&path, None).unwrap();
    assert!(report.equal && report.first_difference.is_none(), "{report}");
    assert_eq!(report.time_mode, "real-time");
    report.compared
}

#[test]
fn a_replay_swaps_policies_as_the_run_did() {
    let place = Place::new();
    let path = place.file("swap.mcap");
    let hop = AlignedBytes::from(&*fs::read(place.policy()).unwrap());
    let (first, second) = (given(SHIPPED, 0), given(hop.as_slice(), 1700));
    let replayed = |policies: &[PolicyMessage]| {
        let mut controller = shipped_controller();
        let law = |sample: &Sample| {
            if sample.header.seq == 1700 {
                controller.swap(Policy::parse(hop.as_slice()).unwrap());
            }
            controller.tick(Some(sample))
        };
        record(&path, 5, |_| true, policies, law);
        replay::replay(&path, None).unwrap()
    };
    // In any order of the policy messages.
    let report = replayed(&[second.clone(), first.clone()]);
    assert_eq!((report.equal, report.compared), (true, 5000), "{report}");
    let report = replayed(std::slice::from_ref(&first));
    assert!(report.first_difference.is_some_and(|found| found.tick > 1700), "the swap acts");
    let report = replayed(&[first, PolicyMessage { blob: Vec::new(), ..second }]);
    assert_eq!((report.equal, report.compared), (true, 1700));
    assert_eq!((report.is_the_same(), report.not_compared_ticks), (false, 3300));
    assert!(report.not_compared.is_some_and(|why| why.contains("does not contain")));
    // What was not compared is not the same.
    let replayed = place.start("replay", &[text(&path)]).end();
    let out = &replayed.assert(1, &[] as &[&str]).out;
    assert!(out.contains("1700 commands are the same, bit for bit"), "{out}");
    assert!(out.contains("3300 of 5000 ticks are not compared: at tick 1700"), "{out}");
}

#[test]
fn a_replay_takes_the_set_points_of_requests_as_the_run_did() {
    let place = Place::new();
    let path = place.file("set-points.mcap");
    let requests = [(0, Some(0.5)), (1700, Some(-0.5)), (3000, None)];
    let set_point = |(seq, m_s): (u64, Option<f32>)| SetPoint {
        is_set: m_s.is_some(),
        set_point_m_s: m_s.unwrap_or_default(),
        run_id: 1,
        seq,
    };
    let replayed = |set_points: &[SetPoint]| {
        let mut controller = shipped_controller();
        let law = |sample: &Sample| {
            let now = requests.iter().rev().find(|(seq, _)| *seq <= sample.header.seq);
            let m_s = now.and_then(|(_, m_s)| *m_s).or(Some(sample.set_point_m_s));
            controller.tick_at(Some(sample), m_s)
        };
        record_with(&path, 5, |_| true, &[given(SHIPPED, 0)], set_points, law);
        replay::replay(&path, None).unwrap()
    };
    let all = requests.map(set_point);
    let report = replayed(&all);
    assert!(report.is_the_same() && report.compared == 5000, "{report}");
    // Each of them acts.
    for missing in &all {
        let rest: Vec<_> = all.iter().copied().filter(|set_point| set_point != missing).collect();
        let tick = replayed(&rest).first_difference.map(|found| found.tick);
        assert!(tick >= Some(missing.seq), "{missing:?}: {tick:?}");
    }
}

/// Each policy of the run can be read from the controller, also one that came and went between two
/// looks of the recorder. A set-point stays in force from run to run.
#[test]
fn a_recorded_run_with_requests_replays_to_its_end() {
    let place = Place::new();
    let other = place.file("other.bin");
    fs::write(&other, fs::read(shipped()).unwrap()).unwrap();
    let path = place.file("requests.mcap");
    let mut controller = place.staying(&[]);
    place.wait_for_the_controller();
    place.request(&["set-point", "0.5"]).assert_ok();
    let first = ["--duration", "1", "--timeout", "30"];
    place.simulator(&first).end().assert_ok();

    let record = ["--record", text(&path), "--start-vx", "0.2"];
    let simulator = place.simulator(&[&ENDLESS[..], &record].concat());
    place.wait_for_status(|status| {
        status["activity"] == "running" && status["peer"]["connections"] == 2
    });
    controller.wait_for_message("this run begins with the set-point 0.5 m/s");
    place.request(&["swap", text(&other)]).assert_ok();
    place.request(&["policy", "roll-back"]).assert_ok();
    // The last one is at the end of the run, between two looks of the recorder.
    for request in [&["set-point", "0.2"][..], &["set-point"], &["set-point", "-0.3"]] {
        place.request(request).assert_ok();
        place.wait_for_status(|status| {
            let log = status["set_point_log"].as_array().unwrap();
            log.iter().all(|record| !record["at"].is_null())
        });
    }
    place.end_the_run();
    let ticks = simulator.end().assert_ok().ticks();
    controller.signal(Signal::TERM);
    controller.end().assert_ok();

    let (_, rest, _) = read(&path);
    let set_points: Vec<_> = rest
        .iter()
        .filter_map(|entry| match entry {
            AnyMessage::SetPoint(s) => Some((s.is_set, s.set_point_m_s, s.seq > 0)),
            _ => None,
        })
        .collect();
    let expected = [(true, 0.5, false), (true, 0.2, true), (false, 0.0, true), (true, -0.3, true)];
    assert_eq!(set_points, expected);
    let policies = rest.iter().filter(|entry| matches!(entry, AnyMessage::Policy(_))).count();
    assert_eq!(policies, 3);
    let replayed = place.start("replay", &[text(&path)]).end();
    let same = format!("{ticks} commands compared: the same, bit for bit");
    assert!(replayed.assert_ok().out.contains(&same), "{}", replayed.out);
    place.assert_clean();
}

#[test]
fn rejects_files_that_are_not_recordings_with_status_2() {
    let place = Place::new();
    let file = place.file("some.mcap");
    let replay_of = |path: &Path| place.start("replay", &[text(path)]).end();
    replay_of(&file).assert(2, &["cannot read", "some.mcap"]);
    fs::write(&file, "no recording").unwrap();
    replay_of(&file).assert(2, &["some.mcap is not an MCAP file"]);
    fs::write(&file, b"").unwrap();
    replay_of(&file).assert(2, &["some.mcap is not an MCAP file"]);
    let empty = |profile: &str| {
        let options = mcap::WriteOptions::new().profile(profile);
        options.create(fs::File::create(&file).unwrap()).unwrap().finish().unwrap();
    };
    empty("ros2");
    replay_of(&file).assert(2, &["profile is `ros2`", "--record"]);
    empty("spring-leg");
    replay_of(&file).assert(2, &["contains no configuration (topic /config)"]);

    // As behind a bridge, whose board does not send its policy.
    let mut controller = shipped_controller();
    record(&file, 1, |_| true, &[], |sample| controller.tick(Some(sample)));
    assert!(matches!(
        replay::replay(&file, None),
        Err(ReplayError::Law(RecordedError::NoPolicy(_)))
    ));
    replay_of(&file).assert(2, &["--policy FILE"]);
    place.start("replay", &[text(&file), "--policy", text(&shipped())]).end().assert_ok();

    let run = |path: &Path| {
        place.alone(&["--in-process", "--duration", "1", "--record", text(path)]).end()
    };
    run(&place.file("no/such/folder.mcap")).assert(2, &["cannot record to", "No such file"]);
    run(file.parent().unwrap()).assert(2, &["it exists and is not a file"]);
    let lock = fs::File::create(part(&file)).unwrap();
    lock.lock().unwrap();
    run(&file).assert(2, &["another recorder is writing", "some.mcap.part"]);
    drop(lock);
    run(&file).assert_ok();
}
