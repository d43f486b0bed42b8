//! Faults between two real processes.

use sim_host::record::schema::AnyMessage;

use super::place::{Place, text};
use super::record::read;

const SHORT: [&str; 4] = ["--duration", "5", "--start-vx", "0.2"];

fn with(seed: &'static str, faults: &[&'static str]) -> Vec<&'static str> {
    let mut arguments = vec!["--spawn", "--seed", seed];
    arguments.extend(SHORT);
    for fault in faults {
        arguments.extend(["--fault", fault]);
    }
    arguments
}

#[test]
fn faults_over_shared_memory_are_reproducible_by_seed() {
    let place = Place::new();
    let storm = ["drop=0.1", "jitter=2", "corrupt=0.01", "noise=0.01", "freeze=3,chance=0.01"];
    let one = place.alone(&with("4", &storm)).end();
    let again = place.alone(&with("4", &storm)).end();
    let other = place.alone(&with("5", &storm)).end();
    assert_eq!(one.state_hash(), again.state_hash(), "{}", one.err);
    assert_ne!(one.state_hash(), other.state_hash());
    for fault in storm {
        assert!(one.out.contains(&format!("fault {fault}: ")), "{}", one.out);
    }
    assert!(!one.out.contains("never fired"), "{}", one.out);

    // Faults without lost messages give the same run in one process as in two.
    let late = ["delay=2,direction=commands", "lag=0.01", "ground=rough", "mass=1.1"];
    let apart = place.alone(&with("4", &late)).end();
    let mut within = with("4", &late);
    within[0] = "--in-process";
    assert_eq!(apart.assert_ok().state_hash(), place.alone(&within).end().assert_ok().state_hash());
    place.assert_clean();
}

#[test]
fn reports_a_fault_that_was_never_applied() {
    let place = Place::new();
    let plain = place.alone(&with("0", &[])).end();
    let never = place.alone(&with("0", &["drop=1,from=9"])).end();
    assert_eq!(plain.assert_ok().state_hash(), never.assert_ok().state_hash());
    assert!(never.out.contains("fault drop=1,from=9: never fired"), "{}", never.out);
    let json = place.alone(&[with("0", &["drop=0.5"]), vec!["--json"]].concat()).end();
    let report: serde_json::Value = serde_json::from_str(&json.out).expect("JSON");
    assert_eq!(report["faults"][0]["fault"], "drop=0.5");
    assert!(report["faults"][0]["touched"].as_u64() > Some(1000), "{report}");
    place.assert_clean();
}

#[test]
fn rejects_invalid_faults_and_lists_the_valid_ones() {
    let place = Place::new();
    place
        .simulator(&["--fault", "drp=1"])
        .end()
        .assert(2, &["`drp` is not a kind of fault", "reorder"]);
    place.simulator(&["--fault", "drop=7"]).end().assert(2, &["drop is 7", "from 0 to 1"]);
    let help = place.simulator(&["--fault", "help"]).end();
    assert!(help.assert_ok().out.contains("saturate"), "{}", help.out);
    assert_eq!(place.start("faults", &[]).end().assert_ok().out, help.out);
}

#[test]
fn a_sweep_gives_equal_bits_with_one_and_two_threads() {
    let place = Place::new();
    let sweep = |jobs: &str, folder: &str| {
        let out = place.file(folder);
        let out = super::text(&out);
        let call = ["--runs", "1", "--media", "land", "--jobs", jobs, "--out", out, "--json"];
        let run = place.start("robustness", &call).end();
        let [svg, csv] = ["svg", "csv"].map(|kind| {
            std::fs::read_to_string(place.file(folder).join(format!("robustness.{kind}"))).unwrap()
        });
        (run.assert_ok().out.clone(), svg, csv)
    };
    let (one, two) = (sweep("1", "one"), sweep("2", "two"));
    assert_eq!(one, two);
    let report: serde_json::Value = serde_json::from_str(&one.0).expect("JSON");
    assert_eq!(report["rows"].as_array().map(Vec::len), Some(144));
    // The report of one build beside the sweep of another, here the same.
    let earlier = place.file("earlier.json");
    std::fs::write(&earlier, &one.0).unwrap();
    let below = place.file("beside");
    let call = ["--runs", "1", "--media", "land", "--out", super::text(&below)];
    let against = |file: &std::path::Path| {
        let call = [&call[..], &["--against", super::text(file)]].concat();
        place.start("robustness", &call).end()
    };
    let beside = against(&earlier);
    let text = &beside.assert_ok().out;
    assert!(text.contains("144 of 144 shares are equal; runs of the same starts"), "{text}");
    // The shipped policy from a file beside itself.
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../controller/policies/robust.bin");
    let itself = against(std::path::Path::new(shipped));
    let text = &itself.assert_ok().out;
    assert!(text.contains("144 of 144 shares are equal; runs of the same starts"), "{text}");
    std::fs::write(&earlier, "{\"rows\": 3}").unwrap();
    against(&earlier).assert(2, &["earlier.json", "no report of `sim-host robustness --json`"]);
    std::fs::write(&earlier, one.0.replace("\"hops\":30", "\"hops\":31")).unwrap();
    against(&earlier).assert(2, &["cannot compare", "after 31 hops", "after 30"]);
    against(&place.file("none.json")).assert(2, &["none.json", "cannot be read"]);
    place.start("robustness", &["--runs", "0"]).end().assert(2, &["--runs is 0", "from 1"]);
    place.start("robustness", &["--jobs", "0"]).end().assert(2, &["--jobs is 0", "from 1"]);
}

/// Regression: the recorded samples were those from before the faults.
#[test]
fn a_recording_has_the_samples_that_were_sent_and_replays_as_the_run_was() {
    let place = Place::new();
    let path = place.file("noise.mcap");
    for mode in [&["--in-process"][..], &["--spawn"], &["--spawn", "--real-time"]] {
        let run = ["--duration", "3", "--fault", "noise=0.05", "--record", text(&path)];
        // In real time on a busy machine the leg may fall.
        place.alone(&[mode, &run].concat()).end();
        let (ticks, rest, _) = read(&path);
        let states = rest.iter().filter_map(|entry| match entry {
            AnyMessage::State(state) => Some(state),
            _ => None,
        });
        let errors: Vec<_> =
            ticks.iter().zip(states).map(|((s, _), t)| f64::from(s.y_m) - t.y_m).collect();
        let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        assert!(errors.len() > 500 && (0.045..0.055).contains(&deviation), "{deviation}");
        let replayed = place.start("replay", &[text(&path)]).end();
        if !mode.contains(&"--real-time") {
            let same = "3000 commands compared: the same, bit for bit";
            assert!(replayed.assert_ok().out.contains(same), "{}", replayed.out);
        }
        // In real time on a busy machine a part may not be compared.
        assert!(!replayed.out.contains("differs"), "{}", replayed.out);
        assert_eq!(replayed.err, "", "the samples are those that were sent");
    }
}
