//! Recorders that are killed or stopped, and the recordings that they leave.

use std::fs;
use std::path::Path;

use leg_recording::other::for_each_record;
use mcap::records::Record;
use rustix::process::Signal;
use sim_host::record::read::{ReadError, Reader};
use sim_host::record::schema::AnyMessage;

use crate::place::{Ended, Place, text};
use crate::record::{endless_recorded_run, part, read, size, wait_until};

/// Bytes of a recording of real size: about ten thousand ticks.
const REAL_SIZE: u64 = 1 << 20;

/// Returns the number of messages in a file, of any channel.
fn all_messages(path: &Path) -> u64 {
    let mut count = 0;
    let counted = for_each_record(path, |record| {
        count += u64::from(matches!(record, Record::Message { .. }));
        Ok::<_, ReadError>(())
    });
    counted.unwrap();
    count
}

fn samples(path: &Path) -> u64 {
    let mut reader = Reader::open(path).unwrap();
    let messages = std::iter::from_fn(|| reader.next_message().unwrap());
    messages.filter(|timed| matches!(timed.message, AnyMessage::Sample(_))).count() as u64
}

fn recover(place: &Place, file: &Path, more: &[&str]) -> Ended {
    place.start("recover", &[&[text(file)], more].concat()).end()
}

#[test]
fn a_killed_recorder_leaves_a_file_that_is_recovered() {
    let place = Place::new();
    let path = place.file("killed.mcap");
    let (mut simulator, controller) = endless_recorded_run(&place, &path);
    let part = part(&path);
    wait_until("a recording of real size is written", || size(&part) > REAL_SIZE);
    recover(&place, &part, &[]).assert(2, &["a recorder is still writing", "end its run first"]);
    simulator.signal_children(Signal::KILL);
    simulator.wait_for_message("the run continues without its recording");
    place.end_the_run();
    let command = format!("`sim-host recover {}`", part.display());
    simulator.end().assert(1, &["the recording broke off", &command]);
    controller.end().assert_ok();

    // Whoever reads it learns how it is completed.
    let [picture, table] = [place.file("run.svg"), place.file("run.csv")];
    for (name, more) in [
        ("replay", vec![]),
        ("plot", vec!["-o", text(&picture)]),
        ("export", vec!["--csv", text(&table)]),
    ] {
        let ended = place.start(name, &[&[text(&part)], &more[..]].concat()).end();
        ended.assert(0, &["it is cut off", &command]);
    }

    let (ticks, rest, _) = read(&part);
    let recovered = recover(&place, &part, &[]);
    // The cut may be between a sample and its command.
    let samples = samples(&part);
    let count = format!("has {samples} ticks of it");
    assert!(recovered.assert_ok().out.contains(&count), "{}", recovered.out);
    let (all, others, warning) = read(&path);
    assert!(ticks.len() > 5_000 && all == ticks && warning.is_none(), "{warning:?}");
    let Some((AnyMessage::End(end), others)) = others.split_last() else { panic!("{others:?}") };
    assert_eq!((&*end.ending, end.ticks), ("recovered", samples));
    assert_eq!(others, rest);
    let bytes = fs::read(&path).unwrap();
    let index = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    let messages = index.stats.expect("statistics").message_count;
    assert_eq!(messages, all_messages(&part) + 1, "those of viewers, too, and the end");
    assert!(index.chunk_indexes.len() > 3, "{}", index.chunk_indexes.len());
    let replayed = place.start("replay", &[text(&path)]).end();
    assert!(replayed.assert_ok().out.contains("commands compared: the same, bit for bit"));
    assert_eq!(replayed.err, "", "nothing is wrong with it");

    let other = place.file("other.mcap");
    let into = |file: &Path| recover(&place, file, &["--output", text(&other)]);
    recover(&place, &part, &[]).assert(2, &["killed.mcap exists already", "--output FILE"]);
    recover(&place, &path, &[]).assert(2, &["does not end in `.part`", "--output FILE"]);
    into(&path).assert(2, &["killed.mcap is complete"]);
    into(&place.policy()).assert(2, &["is not an MCAP file"]);
    let empty = mcap::WriteOptions::new().profile("ros2");
    let foreign = place.file("foreign.mcap");
    empty.create(fs::File::create(&foreign).unwrap()).unwrap().finish().unwrap();
    into(&foreign).assert(2, &["not a recording of this leg"]);
    fs::write(&foreign, &fs::read(&part).unwrap()[..100]).unwrap();
    into(&foreign).assert(2, &["contains no configuration", "cut off"]);
    let nowhere = place.file("no/such/folder.mcap");
    recover(&place, &part, &["-o", text(&nowhere)]).assert(2, &["cannot write", "No such file"]);
    assert!(!other.exists(), "a file that is refused leaves nothing");
    // A file of any name, and one that was recovered before.
    fs::write(&foreign, &bytes[..bytes.len() * 3 / 4]).unwrap();
    into(&foreign).assert_ok();
    let (fewer, rest, warning) = read(&other);
    assert!(fewer.len() > 1000 && fewer[..] == ticks[..fewer.len()] && warning.is_none());
    assert!(
        matches!(rest.last(), Some(AnyMessage::End(end)) if end.ticks == self::samples(&other))
    );
    place.assert_clean();
}

#[test]
fn a_recorder_that_was_stopped_and_given_up_completes_its_file_and_ends() {
    let place = Place::new();
    let path = place.file("stopped.mcap");
    let (mut simulator, controller) = endless_recorded_run(&place, &path);
    simulator.signal_children(Signal::STOP);
    simulator.wait_for_message("the recorder has read nothing for 10 s");
    wait_until("it completes the file", || path.exists());
    assert!(!part(&path).exists());
    place.end_the_run();
    simulator.end().assert(1, &["the recording broke off in", "stopped.mcap: the recorder has"]);
    let (ticks, _, warning) = read(&path);
    assert!(!ticks.is_empty() && warning.is_none(), "{warning:?}");
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_stopped_recorder_completes_its_file_when_its_run_is_killed() {
    let place = Place::new();
    let path = place.file("orphan.mcap");
    let (mut simulator, mut controller) = endless_recorded_run(&place, &path);
    simulator.signal_children(Signal::STOP);
    simulator.kill();
    wait_until("it completes the file", || path.exists());
    let (ticks, _, warning) = read(&path);
    assert!(!ticks.is_empty() && warning.is_none(), "{warning:?}");
    // Whichever it notices first: that the run has ended, or the signal.
    controller.signal(Signal::TERM);
    controller.end().assert(1, &[] as &[&str]);
    place.assert_clean();
}
