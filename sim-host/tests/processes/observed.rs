//! `sim-host record`: runs of any leg and any controller, recorded by an observer.

use std::fs;
use std::path::Path;

use rustix::process::Signal;
use serde_json::Value;
use sim_host::record::contents::{Contents, Messages};
use sim_host::record::schema::{AnyMessage, End, Sample};

use crate::peers::script;
use crate::place::{Place, Running, text, wait_until};

fn recorder(place: &Place, file: &Path) -> Running {
    place.start("record", &["--domain", place.domain(), "--out", text(file)])
}

/// Waits until a recorder is announced in the domain: the controller waits for it from then on.
fn wait_for_the_recorder(place: &Place) {
    wait_until(|| {
        let names = fs::read_dir(place.root()).into_iter().flatten().flatten();
        let mut names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let is_there = names.any(|name| name.starts_with("recorder-"));
        if is_there { Ok(()) } else { Err("no recorder is announced".to_owned()) }
    });
}

/// Returns the samples and the end of a recording, and whether it has true states.
fn content(file: &Path) -> (Vec<Sample>, Option<End>, bool) {
    let (mut samples, mut end, mut has_states) = (Vec::new(), None, false);
    let contents = Contents::of(file).expect("a recording");
    let mut messages: Messages = contents.messages().expect("messages");
    while let Some(message) = messages.next_message().expect("a message") {
        match message {
            AnyMessage::Sample(sample) => samples.push(sample),
            AnyMessage::End(found) => end = Some(found),
            AnyMessage::State(_) => has_states = true,
            _ => (),
        }
    }
    (samples, end, has_states)
}

fn replayed(place: &Place, file: &Path, more: &[&str]) -> Value {
    let replayed = place.start("replay", &[&[text(file), "--json"], more].concat()).end();
    serde_json::from_str(&replayed.out)
        .unwrap_or_else(|_| panic!("{} {}", replayed.out, replayed.err))
}

#[test]
fn a_leg_in_python_is_recorded_by_an_observer_and_replays() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let file = place.file("python.mcap");
    let observer = recorder(&place, &file);
    let controller = place.start("controller", &["--once", "--domain", place.domain()]);
    place.wait_for_the_controller();
    wait_for_the_recorder(&place);
    let leg = script(&place, &python, "leg.py", &["--set-point", "0.5", "--duration", "10"]);
    leg.end().assert_ok();
    controller.end().assert_ok();
    let observer = observer.end();
    let (samples, end, has_states) = content(&file);
    let end = end.expect("an end");
    assert!(observer.assert_ok().out.contains("ended by the leg"), "{}", observer.out);
    assert_eq!((end.ending.as_str(), has_states), ("ended by the leg", false));
    // What a busy machine costs is counted: the leg has sent 10,000 samples.
    assert_eq!(samples.len() as u64 + end.dropped, 10_000, "{}", observer.out);
    assert_eq!(samples[0].seq, 0, "the controller waits for the recorder: {}", observer.out);
    let replay = replayed(&place, &file, &[]);
    assert_eq!(replay["equal"], true, "{replay}");
    // There is nothing true to draw.
    let picture = place.file("python.svg");
    let plot = place.start("plot", &[text(&file), "-o", text(&picture)]).end();
    plot.assert(2, &["true state (/state)", "sim-host record"]);
    if end.dropped == 0 {
        assert_eq!(replay["compared"], 10_000, "{replay}");
        assert_eq!(observer.err, "");
    } else {
        assert!(observer.err.contains("are missing from the recording"), "{}", observer.err);
    }
    place.assert_clean();
}

#[test]
fn a_run_is_the_same_beside_an_observer_that_counts_what_it_misses() {
    let place = Place::new();
    let file = place.file("observed.mcap");
    let observer = recorder(&place, &file);
    let controller = place.controller(&["--timeout", "30"]);
    place.wait_for_the_controller();
    wait_for_the_recorder(&place);
    let run = place.simulator(&["--duration", "20", "--timeout", "30"]).end();
    controller.end().assert_ok();
    let bare = place.alone_for(20_000, &[]);
    assert_eq!(run.assert_ok().state_hash(), bare.state_hash());
    let observer = observer.end();
    let (samples, end, _) = content(&file);
    let end = end.expect("an end");
    assert_eq!(samples.len() as u64, end.ticks, "{}", observer.assert_ok().out);
    assert_eq!(end.ticks + end.dropped, 20_000, "{}", observer.out);
    assert_eq!(samples[0].seq, 0);
    assert_eq!(replayed(&place, &file, &[])["equal"], true);
    place.assert_clean();
}

#[test]
fn a_run_whose_controller_tells_nothing_is_recorded_and_says_what_is_missing() {
    let Some(python) = requirements::python() else { return };
    let place = Place::new();
    let file = place.file("controller.mcap");
    let controller = script(&place, &python, "controller.py", &[]);
    wait_until(|| {
        let listens = place.root().join("session.sock").exists();
        if listens { Ok(()) } else { Err("it does not listen".to_owned()) }
    });
    let observer = recorder(&place, &file);
    wait_for_the_recorder(&place);
    place.simulator(&["--duration", "20", "--timeout", "30"]).end().assert_ok();
    controller.end().assert_ok();
    let observer = observer.end();
    observer.assert(0, &["has no status", "1000 Hz, --rate", "9.81 m/s2, --gravity", "--policy"]);
    let (samples, end, _) = content(&file);
    let last = samples.last().expect("samples").seq;
    assert_eq!(samples.len() as u64 + end.expect("an end").dropped, last + 1);
    place.start("replay", &[text(&file)]).end().assert(2, &["no policy", "--policy FILE"]);
}

#[test]
fn an_observer_replaces_no_file_and_leaves_none_without_a_run() {
    let place = Place::new();
    let there = place.policy();
    recorder(&place, &there).end().assert(2, &[text(&there), "exists already", "--out"]);
    let file = place.file("none.mcap");
    let mut observer = recorder(&place, &file);
    let mut controller = place.start("controller", &["--domain", place.domain()]);
    place.wait_for_the_controller();
    wait_for_the_recorder(&place);
    observer.signal(Signal::TERM);
    observer.end().assert(1, &["nothing is recorded", place.domain()]);
    assert!(!file.exists());
    controller.signal(Signal::TERM);
    controller.end();
    place.start("record", &["--out", "x", "--domain", "a/b"]).end().assert(2, &["a/b"]);
    place.start("record", &["--out", "x", "--rate", "7"]).end().assert(2, &["7", "from 50"]);
    place.assert_clean();
}
