//! Recordings and pictures to files that cannot be written, or not to their end.

use std::fs;
use std::path::Path;

use crate::place::{Ended, Place, text};

/// The recording has about 300 bytes a tick.
const RUN: [&str; 4] = ["run", "--in-process", "--duration", "60"];

/// Asserts that the run has ended with its result, and with one notice and one error about its
/// recording, each with cause and remedy.
#[track_caller]
fn assert_broke_off(ended: &Ended, path: &Path, cause: &str, remedy: &str) {
    let part = format!("{}.part", path.display());
    let error = format!("sim-host: the recording broke off in {part}: {cause}");
    ended.assert(1, &[&error, remedy, "replay and plot can read what that file contains"]);
    let notice = format!("warning: the run continues without its recording: {cause}");
    assert_eq!(ended.err.matches(&notice).count(), 1, "{}", ended.err);
    assert_eq!(ended.err.matches(remedy).count(), 2, "{}", ended.err);
    assert_eq!(ended.err.lines().count(), 2, "{}", ended.err);
    assert!(ended.out.contains("60000 ticks"), "{}", ended.out);
    assert!(!path.exists(), "only a complete file has its name");
}

#[test]
fn a_recording_beyond_the_limit_of_file_sizes_names_the_limit_and_keeps_its_beginning() {
    let place = Place::new();
    let path = place.file("run.mcap");
    let record = [&RUN[..], &["--record", text(&path)]].concat();
    let ended = place.start_after("ulimit -f 4000", &record).end();
    assert_broke_off(&ended, &path, "File too large", "raise the limit of file sizes (ulimit -f)");
    let part = place.file("run.mcap.part");
    let replay = place.start("replay", &[text(&part)]).end();
    replay.assert(0, &["it is cut off"]);
    assert!(replay.out.contains("commands compared: the same"), "{}", replay.out);
}

#[test]
fn a_recording_to_a_full_disk_names_the_remedy() {
    if !requirements::mounts() {
        return;
    }
    let place = Place::new();
    let disk = place.file("disk");
    fs::create_dir(&disk).unwrap();
    let path = disk.join("run.mcap");
    let record = [&RUN[..], &["--record", text(&path)]].concat();
    let mount = format!("mount -t tmpfs -o size=2m tmpfs {}", text(&disk));
    let ended = place.start_with_mounts(&mount, &record).end();
    let remedy = "free space there, or record to another disk";
    assert_broke_off(&ended, &path, "No space left on device", remedy);
}

#[test]
fn records_into_a_mounted_file_and_refuses_a_read_only_one_before_the_run() {
    if !requirements::mounts() {
        return;
    }
    let place = Place::new();
    let (outside, inside) = (place.file("outside.mcap"), place.file("inside.mcap"));
    fs::write(&outside, "an old file").unwrap();
    fs::write(&inside, "").unwrap();
    let record = [&RUN[..], &["--record", text(&inside)]].concat();
    let mount = format!("mount --bind {} {}", text(&outside), text(&inside));
    place.start_with_mounts(&mount, &record).end().assert_ok();
    assert!(!place.file("inside.mcap.part").exists());
    let replay = place.start("replay", &[text(&outside)]).end();
    assert!(replay.assert_ok().out.contains("60000 commands compared: the same"), "{}", replay.out);

    let read_only = format!("{mount} && mount -o remount,ro,bind {}", text(&inside));
    let refused = place.start_with_mounts(&read_only, &record).end();
    refused.assert(2, &["cannot record to", "inside.mcap", "Read-only file system"]);
    assert_eq!(refused.out, "", "the run has not started");
    let copy = place.file("copy.mcap");
    fs::copy(&outside, &copy).unwrap();
    let plot = ["plot", text(&copy), "-o", text(&inside)];
    let refused = place.start_with_mounts(&read_only, &plot).end();
    refused.assert(1, &["cannot write", "inside.mcap", "Read-only file system"]);
    // By way of the mount, both names are those of one file.
    let plot = ["plot", text(&outside), "-o", text(&inside)];
    let refused = place.start_with_mounts(&mount, &plot).end();
    refused.assert(2, &["inside.mcap", "the same file as", "outside.mcap"]);
}
