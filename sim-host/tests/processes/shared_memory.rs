//! Shared memory that is small, removed, half-made, or seen from another container.

use std::fs;
use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;

use super::place::{PROGRAM, Place, Running, text};
use super::{LONG_TIMEOUT, SHORT, SOON};

/// Longer than a test needs to disturb it, on any machine.
const LONG_RUN: [&str; 4] = ["--duration", "400", "--timeout", "30"];

#[test]
fn a_process_killed_while_it_starts_does_not_keep_the_next_from_starting() {
    let place = Place::new();
    for delay_us in (0..12_000).step_by(150) {
        let starting = place.controller(&LONG_TIMEOUT);
        std::thread::sleep(Duration::from_micros(delay_us));
        starting.kill();
    }
    let next = place.controller(&["--timeout", "0.2"]).end();
    next.assert(1, &["no simulator in domain"]);
    assert!(next.took < SOON, "{:?}", next.took);

    // Also when its peer lives, which then is not alone in the domain.
    let simulator = place.simulator(&LONG_RUN);
    for delay_us in (0..12_000).step_by(400) {
        let starting = place.controller(&LONG_TIMEOUT);
        std::thread::sleep(Duration::from_micros(delay_us));
        starting.kill();
    }
    let last = place.staying(&[]);
    let simulator = simulator.end();
    simulator.assert_ok();
    drop(last);
}

#[test]
fn too_little_shared_memory_is_an_error_that_names_what_is_there_and_what_is_needed() {
    if !requirements::root() {
        return;
    }
    let place = Place::new();
    for (options, parts) in [
        ("size=4k", ["KiB are free in /dev/shm", "--shm-size"]),
        ("size=16k", ["KiB are free in /dev/shm", "are needed"]),
        ("nr_inodes=8", ["/dev/shm has room for", "nr_inodes"]),
        ("ro", ["/dev/shm is read-only", "mount it writable"]),
    ] {
        let script = format!("mount -t tmpfs -o {options} none /dev/shm && exec \"$@\"");
        let within = |arguments: &[&str]| {
            let mut command = Command::new("unshare");
            command.args(["--mount", "sh", "-c", &script, "sh", PROGRAM]).args(arguments);
            Running::start(&mut command).end()
        };
        for arguments in [
            &["controller", "--timeout", "1"][..],
            &["run", "--timeout", "1"],
            &["run", "--spawn", "--duration", "1"],
        ] {
            within(arguments).assert(1, &parts);
        }
    }
    place.assert_clean();
}

/// Returns a command that runs this program as process 1 of a container: it shares
/// `/dev/shm` with the others, but neither process ids nor temporary files.
fn in_a_container(place: &Place, arguments: &[&str]) -> Command {
    const PRIVATE: &str = "mount -t tmpfs none /tmp && exec \"$@\"";
    // The program and its policy may lie in /tmp: bring them along.
    let (program, policy) = ("/run/leg-program", "/run/leg-policy.bin");
    let script = format!(
        "mount -t tmpfs none /run && cp {PROGRAM} {program} && cp {} {policy} && {PRIVATE}",
        text(&place.policy())
    );
    let mut command = Command::new("unshare");
    command
        .args(["--mount", "--pid", "--fork", "--kill-child", "--mount-proc"])
        .args(["sh", "-c", &script, "sh", program])
        .args(arguments);
    command
}

#[test]
fn two_containers_with_one_shared_memory_connect_and_a_restart_may_have_the_same_process_id() {
    if !requirements::root() {
        return;
    }
    let place = Place::new();
    let call = ["controller", "--domain", place.domain(), "--policy", "/run/leg-policy.bin"];
    let controller = || Running::start(&mut in_a_container(&place, &call));
    let first = controller();
    place.wait_for_status(|status| status["activity"] == "waiting" && status["pid"] == 1);
    let leg = ["run", "--domain", place.domain()];
    let leg = Running::start(&mut in_a_container(&place, &[&leg, &LONG_RUN[..]].concat()));
    place.wait_for_status(|status| status["ticks"].as_u64() > Some(1000));
    first.kill();
    let mut second = controller();
    place.wait_for_status(|status| status["ticks"].as_u64() > Some(1000));
    let leg = leg.end();
    assert!(leg.assert_ok().out.contains("400000 ticks"), "{}", leg.out);
    assert!(leg.err.contains("the controller (process 1)"), "{}", leg.err);
    assert!(leg.err.contains("is back (process 1)"), "{}", leg.err);
    // The one that leaves takes nothing away from the other, which serves the next leg.
    place.simulator(&[&SHORT[..], &LONG_TIMEOUT].concat()).end().assert_ok();
    second.signal_children(Signal::TERM);
    second.end().assert_ok();
    place.assert_clean();
}

#[test]
fn processes_with_different_temporary_folders_connect() {
    let place = Place::new();
    let long = place.file(&"long".repeat(30));
    fs::create_dir(&long).unwrap();
    let controller = place.controller(&LONG_TIMEOUT);
    let mut leg = Command::new(PROGRAM);
    leg.args(["run", "--domain", place.domain()]).args(SHORT).args(LONG_TIMEOUT);
    leg.env("TMPDIR", long).env("XDG_RUNTIME_DIR", "/nonexistent");
    Running::start(&mut leg).end().assert_ok();
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_run_whose_folder_is_removed_continues_and_its_next_peer_is_missed_with_the_cause() {
    let place = Place::new();
    let within = place.alone(&[&["--in-process"], &LONG_RUN[..]].concat()).end();
    let mut simulator = place.simulator(&LONG_RUN);
    let controller = place.staying(&[]);
    place.wait_for_the_run(None);
    // It must not end before the others have come.
    simulator.signal(Signal::STOP);
    fs::remove_dir_all(place.root()).unwrap();
    // Others come and go; none of them can touch the memory of the run.
    let newcomer = place.controller(&["--timeout", "0.7"]).end();
    newcomer.assert(1, &["no simulator", "the folder was removed under a run", "end it"]);
    simulator.signal(Signal::CONT);
    let simulator = simulator.end();
    assert_eq!(simulator.assert_ok().state_hash(), within.state_hash());
    assert_eq!(simulator.err, "");
    controller.end().assert(1, &["was removed while this process used it", "start both again"]);
    place.assert_clean();
}

#[test]
fn a_missing_peer_is_looked_for_in_other_domains() {
    let (place, elsewhere) = (Place::new(), Place::new());
    let mut controller = elsewhere.staying(&[]);
    elsewhere.wait_for_status(|status| status["activity"] == "waiting");
    let found = elsewhere.domain().to_owned();
    let run = place.simulator(&["--timeout", "0.3"]).end();
    run.assert(1, &["no controller in domain", text(&place.root()), "one runs in the domain"]);
    assert!(run.err.contains(&found), "{}", run.err);
    place.request(&["status"]).assert(1, &["no controller is running in domain", &found]);
    controller.signal(Signal::TERM);
    controller.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_limit_of_open_files_is_raised_or_named() {
    let place = Place::new();
    let run = |limit: &str| {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit {limit}; exec \"$@\""), "sh", PROGRAM]);
        command.args(["run", "--spawn"]).args(SHORT).current_dir(place.file(""));
        Running::start(&mut command).end()
    };
    run("-Sn 12").assert_ok();
    run("-n 20").assert(1, &["20 open files are allowed, 64 are needed", "ulimit -n 64"]);
    place.assert_clean();
}

/// A build replaces the program of a run that goes on.
#[test]
fn a_program_whose_file_was_removed_starts_its_controller() {
    let place = Place::new();
    let copy = place.file("sim-host");
    fs::copy(PROGRAM, &copy).unwrap();
    let script = "exec 3< \"$1\"; rm \"$1\"; shift; exec /proc/self/fd/3 \"$@\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh", text(&copy), "run", "--spawn"]).args(SHORT);
    Running::start(&mut command).end().assert_ok();
    assert!(!copy.exists());
    place.assert_clean();
}
