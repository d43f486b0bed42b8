//! Logs of sensors for `controller estimate`, exported from recordings.

use std::fs::{self, File};
use std::path::Path;

use mcap::records::MessageHeader;
use prost::Message;
use serde_json::{Map, Value, json};
use sim_host::record::read::Reader;
use sim_host::record::schema::{AnyMessage, Config, Estimate, Sample};

use super::place::{Ended, Place};
use super::text;

const RUN: [&str; 5] = ["--in-process", "--set-point", "0.5", "--duration", "6"];

/// Records a run of the leg with these options and exports it; returns the options with which
/// `controller estimate` reads the log.
fn exported(place: &Place, options: &[&str]) -> Vec<String> {
    let [mcap, csv] = ["run.mcap", "run.csv"].map(|name| place.file(name));
    place.start("run", &[&RUN, options, &["--record", text(&mcap)]].concat()).end().assert_ok();
    let exported = place.start("export", &[text(&mcap), "--csv", text(&csv)]).end();
    let command = exported.assert_ok().out.lines().nth(1).expect("a command").to_owned();
    command.split(' ').skip(1).map(str::to_owned).collect()
}

fn estimate(place: &Place, options: &[&str]) -> Ended {
    place.start("controller", &[&["estimate"], options].concat()).end()
}

fn estimates(path: &Path) -> Vec<Estimate> {
    let mut reader = Reader::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(entry) = reader.next_message().unwrap() {
        if let AnyMessage::Estimate(estimate) = entry.message {
            all.push(estimate);
        }
    }
    all
}

/// The rows of a CSV file without its header.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let cells = |row: csv::StringRecord| row.iter().map(str::to_owned).collect();
    reader.records().map(|row| cells(row.unwrap())).collect()
}

/// The text of an estimate in the CSV file of `controller estimate`, from which its bits can be
/// read back.
fn cells(e: &Estimate) -> Vec<String> {
    let pairs = [
        (e.vx_m_s, e.vx_variance_m2_s2),
        (e.y_m, e.y_variance_m2),
        (e.vy_m_s, e.vy_variance_m2_s2),
        (e.density_ratio, e.density_variance),
    ];
    let of_pair =
        |(x, variance): (f32, f32)| [x.to_string(), f64::from(variance).sqrt().to_string()];
    let mut cells = vec![u8::from(e.in_stance).to_string()];
    cells.extend(pairs.into_iter().flat_map(of_pair));
    cells.push(e.innovation.to_string());
    cells
}

/// Every kind of sensor: raw ones, slow ones, and noisy ones of the state that come late.
#[test]
fn an_exported_log_gives_the_recorded_estimate_bit_for_bit() {
    for (profile, estimator) in
        [("imu", "inertial"), ("underwater", "inertial"), ("trained-with", "state")]
    {
        let place = Place::new();
        let options = exported(&place, &["--sensors", profile]);
        let out = place.file("estimates.csv");
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let options = [&options, &["--output", text(&out)][..]].concat();
        let ended = place.start("controller", &options).end();
        let printed = &ended.assert_ok().out;
        assert!(printed.contains(&format!("estimator {estimator} with noise ")), "{printed}");
        let recorded = estimates(&place.file("run.mcap"));
        assert!(recorded.len() > 5_000, "{profile}: {}", recorded.len());
        let found: Vec<_> = rows(&out).into_iter().filter(|row| !row[1].is_empty()).collect();
        assert_eq!(found.len(), recorded.len(), "{profile}");
        for (row, recorded) in found.iter().zip(&recorded) {
            assert_eq!(row[1..], cells(recorded), "{profile}, tick {}", recorded.seq);
        }
    }
}

#[test]
fn a_recording_itself_gives_its_estimates_bit_for_bit() {
    let place = Place::new();
    exported(&place, &["--sensors", "imu"]);
    let mcap = place.file("run.mcap");
    let count = estimates(&mcap).len();
    let ended = estimate(&place, &["--input", text(&mcap)]);
    let same = format!("{count} estimates in the recording: the same, bit for bit");
    assert!(ended.assert_ok().out.contains(&same), "{}", ended.out);
    // A law with other figures does not.
    let other = ["--input", text(&mcap), "--estimator", "inertial", "--json"];
    let ended = estimate(&place, &other);
    let report: Value = serde_json::from_str(&ended.assert_ok().out).unwrap();
    assert!(report["different"].as_u64() > Some(1_000), "{report}");
    assert!(ended.err.contains("ran by other settings"), "{}", ended.err);
}

/// The names of the columns and the cells of a log.
fn log(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let names = reader.headers().unwrap().iter().map(str::to_owned).collect();
    (names, rows(path))
}

fn write(path: &Path, names: &[String], rows: &[Vec<String>]) {
    let mut csv = csv::Writer::from_path(path).unwrap();
    csv.write_record(names).unwrap();
    for row in rows {
        csv.write_record(row).unwrap();
    }
    csv.flush().unwrap();
}

/// Specific forces in place of their sums, as a leg logs them.
fn with_forces(path: &Path) {
    let (mut names, mut rows) = log(path);
    for axis in ["x", "y"] {
        let sum = format!("specific_impulse_{axis}_m_s");
        let place = names.iter().position(|name| *name == sum).unwrap();
        names[place] = format!("specific_force_{axis}_m_s2");
        let sums: Vec<f64> = rows.iter().map(|row| row[place].parse().unwrap()).collect();
        for (i, row) in rows.iter_mut().enumerate() {
            row[place] = (1e3 * (sums[i] - sums[i.saturating_sub(1)])).to_string();
        }
    }
    write(path, &names, &rows);
}

#[test]
fn readings_of_an_accelerometer_are_as_good_as_their_sums() {
    let place = Place::new();
    exported(&place, &["--sensors", "imu"]);
    let csv = place.file("run.csv");
    with_forces(&csv);
    let svg = place.file("run.svg");
    // The estimator, the rate and the noise are found out or usual.
    let ended = estimate(
        &place,
        &["--input", text(&csv), "--set-point", "0.5", "--plot", text(&svg), "--json"],
    );
    let report: Value = serde_json::from_str(&ended.assert_ok().out).unwrap();
    assert_eq!(report["rate_hz"], 1_000, "{report}");
    assert!(report["estimator"].as_str().unwrap().starts_with("inertial"), "{report}");
    assert_eq!((&report["rows"], &report["estimated"]), (&json!(6_000), &json!(6_000)), "{report}");
    assert_eq!((&report["lost"], &report["rejected"]), (&json!(0), &json!([])), "{report}");
    let apexes = report["apexes"].as_array().unwrap();
    assert!(apexes.len() >= 4, "{report}");
    // Before its first stances the law knows little.
    for apex in &apexes[2..] {
        for (i, most) in [0.03, 0.05, 0.05].into_iter().enumerate() {
            let of = |of: &str| apex[of][i].as_f64().unwrap();
            let error = of("estimate") - of("truth");
            assert!(error.abs() < most && error.abs() < 4.0 * of("deviation"), "{apex}");
        }
    }
    let drawn = fs::read_to_string(&svg).unwrap();
    assert_eq!(drawn.matches("Estimate less truth").count(), 4);
}

#[test]
fn missing_rows_are_ticks_without_a_sample_and_a_row_out_of_order_is_counted() {
    let place = Place::new();
    let options = exported(&place, &["--sensors", "imu"]);
    let csv = place.file("run.csv");
    let (names, mut rows) = log(&csv);
    rows.drain(3_000..3_004);
    rows.swap(4_000, 4_001);
    write(&csv, &names, &rows);
    let options: Vec<&str> = options.iter().map(String::as_str).chain(["--json"]).collect();
    let report = || {
        let ended = place.start("controller", &options).end();
        serde_json::from_str::<Value>(&ended.assert_ok().out).unwrap()
    };
    let bridged = report();
    assert_eq!(bridged["rows"], 5_996);
    // Four are missing; and the one before the row that comes too late.
    assert_eq!(bridged["empty_ticks"], 5, "{bridged}");
    assert_eq!(bridged["rejected"], json!([["out of order", 1]]), "{bridged}");
    assert_eq!((&bridged["safe_entered"], &bridged["lost"]), (&json!(0), &json!(0)), "{bridged}");
    // Longer than the stale limit: the law gives up and begins anew.
    rows.drain(3_000..3_050);
    write(&csv, &names, &rows);
    let broken = report();
    assert_eq!(
        (&broken["empty_ticks"], &broken["safe_entered"]),
        (&json!(55), &json!(1)),
        "{broken}"
    );
    let after_the_gap =
        broken["apexes"].as_array().unwrap().iter().find(|apex| apex["t_s"].as_f64() > Some(3.0));
    let deviation = after_the_gap.unwrap()["deviation"][0].as_f64();
    assert!(deviation > Some(0.9), "as at the start: {broken}");
}

/// Writes the rows of a log as messages in JSON on `/leg`, beside another channel.
fn write_json(csv: &Path, mcap: &Path, drop_time: bool) {
    let (names, rows) = log(csv);
    let mut writer = mcap::WriteOptions::new().create(File::create(mcap).unwrap()).unwrap();
    let add = |writer: &mut mcap::Writer<File>, topic: &str, encoding: &str| {
        writer.add_channel(0, topic, encoding, &std::collections::BTreeMap::new()).unwrap()
    };
    let leg = add(&mut writer, "/leg", "json");
    let camera = add(&mut writer, "/camera", "cdr");
    for (sequence, row) in rows.iter().enumerate() {
        let log_time = 1_700_000_000_000_000_000 + 1_000_000 * sequence as u64;
        let header = |channel_id| MessageHeader {
            channel_id,
            sequence: sequence as u32,
            log_time,
            publish_time: log_time,
        };
        let fields: Map<String, Value> = names
            .iter()
            .zip(row)
            .filter(|(name, _)| !(drop_time && *name == "time_s"))
            .map(|(name, cell)| {
                let value = match (name.as_str(), cell.as_str()) {
                    (_, "") => Value::Null,
                    ("contact", cell) => Value::Bool(cell == "1"),
                    ("time_s", cell) => Value::String(cell.to_owned()),
                    (_, cell) => json!(cell.parse::<f64>().unwrap()),
                };
                (name.clone(), value)
            })
            .collect();
        let bytes = serde_json::to_vec(&fields).unwrap();
        writer.write_to_known_channel(&header(leg), &bytes).unwrap();
        writer.write_to_known_channel(&header(camera), b"picture").unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn messages_in_json_give_the_same_as_rows() {
    let place = Place::new();
    let options = exported(&place, &["--sensors", "underwater"]);
    let (csv, mcap) = (place.file("run.csv"), place.file("log.mcap"));
    let of = |input: &Path, more: &[&str]| {
        let out = place.file("estimates.csv");
        let mut all: Vec<&str> = options.iter().map(String::as_str).collect();
        let at = all.iter().position(|option| *option == "--input").unwrap();
        all[at + 1] = text(input);
        let all = [&all[..], &["--output", text(&out)], more].concat();
        place.start("controller", &all).end().assert_ok();
        fs::read_to_string(out).unwrap()
    };
    let expected = of(&csv, &[]);
    for drop_time in [false, true] {
        write_json(&csv, &mcap, drop_time);
        assert!(of(&mcap, &[]) == expected, "the only channel in JSON, {drop_time}");
        assert!(of(&mcap, &["--channel", "/leg"]) == expected, "by its topic");
    }
    let refused = |topic: &str| estimate(&place, &["--input", text(&mcap), "--channel", topic]);
    refused("/camera").assert(2, &["the messages of /camera are in `cdr`", "/leg (json)"]);
    refused("/other").assert(2, &["it has no channel /other", "/camera (cdr)", "--channel"]);
}

#[test]
fn bad_input_is_refused_with_file_place_column_value_and_limit() {
    let place = Place::new();
    let csv = place.file("log.csv");
    let refused = |content: &str, options: &[&str], parts: &[&str]| {
        fs::write(&csv, content).unwrap();
        estimate(&place, &[&["--input", text(&csv)], options].concat()).assert(2, parts);
    };
    let good = "time_s,contact,vx_m_s,y_m,vy_m_s\n0,0,0,1,0\n0.001,0,0,1,0\n";
    for (content, parts) in [
        ("", &["log.csv: line 1 has no column time_s"][..]),
        ("time_s;contact\n0;1\n", &["has no column time_s: `time_s;contact`"]),
        ("time_s,contact\n", &["log.csv: it has no row"]),
        ("time_s,y_m,y_m\n0,1,1\n", &["line 1: more than one column y_m"]),
        ("time_s,y_m\n0,1\n", &["it has neither contact nor leg_length_m"]),
        ("time_s,contact,y_m\n0,1,1\n", &["enough for no estimator", "vx_m_s"]),
        ("time_s,contact\n0,1\n0.1\n", &["line 3: 1 cells where line 1 has 2"]),
        ("time_s,contact\n,1\n", &["line 2: no time_s"]),
        (
            "time_s,contact,vx_m_s,y_m,vy_m_s\n0,0,0,1,0\n0.001,0,0,high,0\n",
            &["log.csv, line 3, column y_m: `high`; it must be a number from -1e9 to 1e9"],
        ),
        (
            "time_s,contact,specific_force_x_m_s2\n0,0,0\n",
            &["specific_force_x_m_s2 alone", "specific_force_y_m_s2 belong together"],
        ),
        (
            "time_s,contact,vx_m_s,y_m,vy_m_s\n0,0,0,1,0\n0.1,0,0,1,0\n",
            &["its rows are 10.000 a second", "50 to 20000 Hz", "--rate"],
        ),
    ] {
        refused(content, &[], parts);
    }
    refused(
        "time_s,contact,y_m\n1,0,1\n1,0,1\n0,0,1\n",
        &["--estimator", "state"],
        &["time_s never rises in the first 3 rows", "sort the rows"],
    );
    let long = "x".repeat(1_000_000);
    for content in [format!("{long}\n0\n"), format!("time_s,contact\n0,{long}\n")] {
        fs::write(&csv, content).unwrap();
        let ended = estimate(&place, &["--input", text(&csv)]);
        assert!(ended.assert(2, &["xxx… (1000", "bytes)"]).err.len() < 1_000);
    }
    refused(good, &["--estimator", "inertial"], &["not those of the estimator", "leg_angle_rad"]);
    let endless = estimate(&place, &["--input", "/dev/zero"]);
    endless.assert(2, &["/dev/zero: a row is longer than 8 MiB"]);
    for set_point in ["nan", "-51"] {
        refused(good, &["--set-point", set_point], &["-50 to 50 m/s", "--set-point sets it"]);
    }
    refused(good, &["--estimator", "readings"], &["estimates nothing", "--estimator"]);
    refused(good, &["--estimator-noise", "speed=1"], &["speed=1", "--estimator-noise"]);
    refused(good, &["--gravity", "-1"], &["gravity -1 m/s2"]);
    refused(good, &["--channel", "/leg"], &["this is no MCAP file"]);
    refused(good, &["--output", "no/such/folder.csv"], &["cannot write no/such/folder.csv"]);
    refused(good, &["--policy", text(&csv)], &["is not a valid policy"]);
    estimate(&place, &["--input", "none.csv"]).assert(2, &["cannot read none.csv"]);
    fs::write(&csv, good).unwrap();
    let ended = estimate(&place, &["--input", text(&csv)]);
    assert!(ended.assert_ok().out.contains("2 rows, 0.001 s at 1000 Hz"), "{}", ended.out);
    fs::write(&csv, good.replace("contact", "contact,note").replace(",0,0,1", ",0,,0,1")).unwrap();
    let ended = estimate(&place, &["--input", text(&csv)]);
    assert!(ended.assert_ok().err.contains("are not used: `note`"), "{}", ended.err);
}

#[test]
fn a_failed_export_leaves_no_file() {
    let place = Place::new();
    let (file, csv) = (place.file("no.mcap"), place.file("no.csv"));
    fs::write(&file, "no recording").unwrap();
    let export = |path: &Path, csv: &str| place.start("export", &[text(path), "--csv", csv]).end();
    export(&file, text(&csv)).assert(2, &["no.mcap is not an MCAP file"]);
    assert!(!csv.exists());
    export(&file, "no/such/folder.csv").assert(2, &["cannot write no/such/folder.csv"]);
}

#[test]
fn an_output_never_replaces_an_input_or_another_output() {
    let place = Place::new();
    exported(&place, &["--sensors", "imu"]);
    let [mcap, csv, hops, toml, new] =
        ["run.mcap", "run.csv", "hops.csv", "run.toml", "new"].map(|name| place.file(name));
    fs::write(&hops, "vx,y,alpha,rs\n0,1.5,1.5,1\n").unwrap();
    fs::write(&toml, "set_point_m_s = 0.5\n").unwrap();
    let (policy, pictures) = (place.policy(), place.file("pictures"));
    let [mcap_, csv_, hops_, toml_, new_, policy_] =
        [&mcap, &csv, &hops, &toml, &new, &policy].map(|path| text(path));
    let inputs = || [&mcap, &csv, &hops, &toml, &policy].map(|path| fs::read(path).unwrap());
    let before = inputs();
    let log = ["estimate", "--input", csv_, "--policy", policy_];
    let run = ["--in-process", "--duration", "0.01", "--scenario", toml_, "--policy", policy_];
    for (program, options, more) in [
        ("controller", &log[..], ["--output", csv_]),
        ("controller", &log, ["--plot", csv_]),
        ("controller", &log, ["--output", policy_]),
        ("controller", &[&log[..], &["--plot", new_]].concat(), ["--output", new_]),
        ("export", &[mcap_], ["--csv", mcap_]),
        ("plot", &[mcap_], ["--out", mcap_]),
        ("apex", &["--input", hops_], ["--output", hops_]),
        ("run", &run, ["--record", toml_]),
        ("run", &run, ["--record", policy_]),
        ("--policy", &[policy_, "--out", text(&pictures)], ["--record", policy_]),
    ] {
        let ended = place.start(program, &[options, &more].concat()).end();
        ended.assert(2, &["cannot write", more[1], "it is the same file as"]);
    }
    assert!(inputs() == before && !new.exists());
}

#[test]
fn a_recording_in_a_pipe_or_cut_off_is_refused_with_the_cause() {
    let place = Place::new();
    exported(&place, &["--sensors", "imu"]);
    let pipe = place.file("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let recording = fs::read(place.file("run.mcap")).unwrap();
    let (to, head) = (pipe.clone(), recording[..4_096].to_vec());
    // Fails where the reader has ended before.
    let writer = std::thread::spawn(move || drop(fs::write(to, head)));
    let cut = place.file("cut.mcap");
    fs::write(&cut, &recording[..4_096]).unwrap();
    let ended = estimate(&place, &["--input", text(&cut)]);
    let err = &ended.assert(2, &["it has no channel", "it is cut off"]).err;
    assert!(!err.contains("--channel"), "{err}");
    place.start("replay", &[text(&pipe)]).end().assert(2, &["no regular file", "write it to one"]);
    writer.join().unwrap();
}

/// The times of each run begin with 0.
#[test]
fn a_recording_of_several_runs_is_not_exported() {
    let place = Place::new();
    let (mcap, csv) = (place.file("runs.mcap"), place.file("runs.csv"));
    let mut writer = mcap::WriteOptions::new().create(File::create(&mcap).unwrap()).unwrap();
    let mut add = |topic: &str, bytes: &[u8]| {
        let none = std::collections::BTreeMap::new();
        let channel_id = writer.add_channel(0, topic, "protobuf", &none).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
        writer.write_to_known_channel(&header, bytes).unwrap();
    };
    let config =
        Config { wire_version: 2, rate_hz: 1_000, gravity_m_s2: 9.81, ..Config::default() };
    add("/config", &config.encode_to_vec());
    for run_id in [1, 2] {
        add("/sample", &Sample { run_id, ..Sample::default() }.encode_to_vec());
    }
    writer.finish().unwrap();
    let export = place.start("export", &[text(&mcap), "--csv", text(&csv)]).end();
    export.assert(2, &["put back to its start 1 times; a log is of one run"]);
    assert!(!csv.exists());
}
