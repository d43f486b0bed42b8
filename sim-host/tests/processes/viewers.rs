//! What a recording holds for viewers such as Foxglove and Rerun.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::place::{Place, text};

/// Returns the number of messages of each topic.
fn counts(path: &Path) -> BTreeMap<String, usize> {
    let bytes = fs::read(path).unwrap();
    let mut counts = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        *counts.entry(message.unwrap().channel.topic.clone()).or_default() += 1;
    }
    counts
}

const RUN: [&str; 7] =
    ["--in-process", "--medium", "water", "--duration", "10", "--fault", "drag=1.1"];

#[test]
fn a_recording_holds_pictures_at_the_rate_of_the_display_or_none() {
    let place = Place::new();
    let (with, without) = (place.file("with.mcap"), place.file("without.mcap"));
    let record = |path: &Path, more: &[&str]| {
        let run = [&RUN[..], &["--record", text(path)], more].concat();
        place.alone(&run).end().assert_ok().state_hash()
    };
    let hash = record(&with, &[]);
    let mut all = counts(&with);
    // 50 pictures a second, each with two frames; the ground once.
    assert_eq!((all["/tf"], all["/scene"], all["/points/leg"]), (1000, 501, 500));
    assert_eq!(all["/points/ground"], 1);
    assert!(all["/log"] > 5, "{all:?}");
    record(&with, &["--display-rate", "5"]);
    assert_eq!(counts(&with)["/points/leg"], 50);
    record(&with, &["--display-rate", "5000"]);
    assert_eq!(counts(&with)["/points/leg"], 10_000, "at most one for each tick");

    assert_eq!(record(&without, &["--display-rate", "0"]), hash);
    for topic in ["/log", "/tf", "/scene", "/points/leg", "/points/ground"] {
        all.remove(topic);
    }
    assert_eq!(counts(&without), all, "the rest is the same");
    for path in [&with, &without] {
        let replayed = place.start("replay", &[text(path)]).end();
        assert!(replayed.assert_ok().out.contains("10000 commands compared: the same"));
    }
    place.alone(&[&RUN[..], &["--display-rate", "5"]].concat()).end().assert(2, &["--record"]);
}

#[test]
fn the_libraries_of_foxglove_and_rerun_show_the_leg_of_a_recording() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let path = place.file("run.mcap");
    place.alone(&[&RUN[..], &["--record", text(&path)]].concat()).end().assert_ok();
    let mut check = Command::new(python);
    check.arg(requirements::checkout().join("sim-host/tools/check_viewers.py")).arg(&path);
    let checked = check.output().expect("Python starts");
    let [out, err] = [&checked.stdout, &checked.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(checked.status.success() && out.contains("500 pictures"), "{out} {err}");
}
