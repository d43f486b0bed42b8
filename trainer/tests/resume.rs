//! A training that is killed and resumed ends like one that was never interrupted.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Fixed gains, so that no search is needed.
const GAINS: &str =
    "gains=[{density_ratio=0.0,kp=0.0,ki=0.05,kd=0.0,feed_forward=1.0,limit_m_s=10.0}]";

/// A short transfer through both stages.
const TRANSFER: &[&str] = &[
    "--preset",
    "water-to-air",
    "--set",
    "stages.0.length.episodes=800",
    "--episodes",
    "800",
    "--seed",
    "1",
];

/// A short training with a selection, an averaged actor and random steps.
const ROBUST: &[&str] = &[
    "--preset",
    "robust",
    "--steps",
    "6000",
    "--set",
    "learning.random_steps=500",
    "--set",
    "selection.evaluations=4",
    "--set",
    "selection.starts=40",
    "--set",
    GAINS,
    "--seed",
    "2",
];

/// Attempts to kill a training before it ends.
const ATTEMPTS: usize = 50;

fn trainer(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    command.arg("train").args(arguments).args(["--out", "p.bin", "--eval-starts", "0", "--quiet"]);
    command.current_dir(folder).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn output(arguments: &[&str], folder: &Path) -> Output {
    trainer(arguments, folder).output().unwrap()
}

fn error(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string();
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|e| name(e).unwrap()).collect();
    names.sort();
    names
}

/// The moment at which a test kills a training.
#[derive(Clone, Copy, Debug)]
enum Moment {
    /// After this number of checkpoints.
    Checkpoints(usize),
    /// While a checkpoint is being written, after this number of others.
    Writing(usize),
    /// After a time.
    After(Duration),
}

/// Waits for a moment and sends SIGKILL; returns false when the child ended before.
fn kill_at(child: &mut Child, folder: &Path, moment: Moment) -> bool {
    let began = Instant::now();
    let inode = || fs::metadata(folder.join("p.bin.checkpoint")).map_or(0, |m| m.ino());
    let writing = folder.join("p.bin.checkpoint.part");
    let (mut last, mut seen) = (inode(), 0);
    loop {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        let now = inode();
        if now != last && now != 0 {
            (last, seen) = (now, seen + 1);
        }
        let is_now = match moment {
            Moment::Checkpoints(n) => seen >= n,
            Moment::Writing(n) => seen >= n && writing.exists(),
            Moment::After(time) => began.elapsed() >= time,
        };
        if is_now {
            child.kill().unwrap();
            // The child may have ended just before.
            return child.wait().unwrap().code().is_none();
        }
    }
}

/// Starts a training anew until it is killed before its end, whatever else the machine does.
fn begin_and_kill(arguments: &[&str], folder: &Path, moment: Moment) {
    for _ in 0..ATTEMPTS {
        let mut child = trainer(arguments, folder).spawn().unwrap();
        if kill_at(&mut child, folder, moment) {
            return;
        }
        for name in names(folder) {
            fs::remove_file(folder.join(name)).unwrap();
        }
    }
    panic!("in {ATTEMPTS} attempts the training ended before {moment:?}");
}

fn survives_being_killed(arguments: &[&str]) {
    let whole = tempfile::tempdir().unwrap();
    let alone = output(&[arguments, &["--checkpoint-every", "0"]].concat(), whole.path());
    assert!(alone.status.success(), "{}", error(&alone));
    assert_eq!(names(whole.path()), ["p.bin", "p.csv"]);

    // How often a training can be killed before it ends depends on the machine.
    let mut kills = 0;
    for _ in 0..ATTEMPTS {
        kills += kills_of_a_resumed_training(arguments, whole.path());
        if kills >= 5 {
            return;
        }
    }
    panic!("only {kills} kills in {ATTEMPTS} trainings");
}

/// Kills and resumes a training until it ends; compares its files with those of the `whole` one,
/// and returns the number of kills.
fn kills_of_a_resumed_training(arguments: &[&str], whole: &Path) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let milliseconds = |ms| Moment::After(Duration::from_millis(ms));
    let moments = [
        Moment::Checkpoints(1),
        Moment::Writing(3),
        milliseconds(40),
        Moment::Checkpoints(8),
        Moment::Writing(0),
        milliseconds(90),
        Moment::Writing(20),
        Moment::Checkpoints(30),
    ];
    let mut killed = 0;
    let arguments = [arguments, &["--checkpoint-every", "0.002", "--resume"]].concat();
    for moment in moments {
        let mut child = trainer(&arguments, path).spawn().unwrap();
        if !kill_at(&mut child, path, moment) {
            break;
        }
        killed += 1;
        assert!(!path.join("p.bin").exists() && !path.join("p.csv").exists(), "{moment:?}");
    }
    if killed == 8 {
        let last = output(&arguments, path);
        assert!(last.status.success(), "{}", error(&last));
    }
    for name in ["p.bin", "p.csv"] {
        let read = |folder: &Path| fs::read(folder.join(name)).unwrap();
        assert!(read(path) == read(whole), "{name} differs after {killed} kills");
    }
    // A kill during the rename of the policy may leave a hidden file.
    let left: Vec<_> = names(path).into_iter().filter(|n| !n.starts_with('.')).collect();
    assert_eq!(left, ["p.bin", "p.csv"]);
    killed
}

#[test]
fn a_killed_transfer_ends_with_the_same_policy_and_log() {
    survives_being_killed(TRANSFER);
}

#[test]
fn a_killed_robust_training_ends_with_the_same_policy_and_log() {
    survives_being_killed(ROBUST);
}

/// Covers a kill between writing the policy and removing the checkpoint, in every order.
#[test]
fn a_kill_after_the_policy_is_written_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let arguments = ["--preset", "water", "--episodes", "600", "--seed", "1"];
    let resumed = [&arguments[..], &["--resume", "--checkpoint-every", "0.001"]].concat();
    begin_and_kill(&resumed, path, Moment::Checkpoints(2));
    let at = |name: &str| path.join(name);
    let checkpoint = fs::read(at("p.bin.checkpoint")).unwrap();
    assert!(output(&resumed, path).status.success());
    let files = || ["p.bin", "p.csv"].map(|name| fs::read(at(name)).unwrap());
    let whole = files();
    // The log was renamed, but the checkpoint was not removed.
    fs::write(at("p.bin.checkpoint"), &checkpoint).unwrap();
    assert!(output(&["--resume"], path).status.success());
    assert!(files() == whole);
    // Only the policy was written.
    fs::write(at("p.bin.checkpoint"), &checkpoint).unwrap();
    fs::rename(at("p.csv"), at("p.csv.part")).unwrap();
    assert!(output(&["--resume"], path).status.success());
    assert!(files() == whole);
    assert_eq!(names(path), ["p.bin", "p.csv"]);
}

/// Moves a file or folder between two resumptions from different folders, and copies one.
#[test]
fn a_training_resumes_wherever_its_files_are_and_from_any_folder() {
    let moved = (0..ATTEMPTS).any(|_| resumes_wherever_its_files_are().is_some());
    assert!(moved, "in {ATTEMPTS} attempts a training ended before it was killed");
}

/// Returns `None` where a training has ended before it was killed.
fn resumes_wherever_its_files_are() -> Option<()> {
    let whole = tempfile::tempdir().unwrap();
    let arguments = ["--preset", "air", "--steps", "3000", "--seed", "1"];
    assert!(output(&arguments, whole.path()).status.success());
    let expected = ["p.bin", "p.csv"].map(|name| fs::read(whole.path().join(name)).unwrap());

    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = |directory: &Path, line: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
        command.args(["train", "--eval-starts", "0", "--quiet"]).args(line.split(' '));
        command.current_dir(directory).stderr(Stdio::piped()).stdout(Stdio::piped());
        command.spawn().unwrap()
    };
    for name in ["runs/a", "logs", "elsewhere"] {
        fs::create_dir_all(at(name)).unwrap();
    }
    let begin = "--preset air --steps 3000 --seed 1 --checkpoint-every 0.02";
    let kill = |mut child: Child, out: &Path| {
        let checkpoint = trainer::run::checkpoint::path(out);
        let (began, mut seen) = (Instant::now(), 0);
        let inode = || fs::metadata(&checkpoint).map_or(0, |m| m.ino());
        let mut last = inode();
        while seen < 4 {
            assert!(began.elapsed() < Duration::from_mins(1), "no checkpoint");
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success());
                return None;
            }
            let now = inode();
            (seen, last) = (seen + usize::from(now != last), now);
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        // It may have ended just before.
        child.wait().unwrap().code().is_none().then_some(())
    };
    let finish = |directory: &Path, line: &str, out: &Path, log: &Path| {
        let output = run(directory, line).wait_with_output().unwrap();
        assert!(output.status.success(), "{line}: {}", error(&output));
        assert!(fs::read(out).unwrap() == expected[0], "{line}");
        assert!(fs::read(log).unwrap() == expected[1], "{line}");
    };

    // From another folder; then the folder is moved, and copied.
    kill(run(&at("runs/a"), &format!("--out p.bin {begin}")), &at("runs/a/p.bin"))?;
    let resume = "--resume --checkpoint-every 0.02 --out runs/a/p.bin";
    kill(run(folder.path(), resume), &at("runs/a/p.bin"))?;
    fs::rename(at("runs/a"), at("runs/b")).unwrap();
    fs::create_dir(at("runs/copy")).unwrap();
    for name in ["p.bin.checkpoint", "p.csv.part"] {
        fs::copy(at("runs/b").join(name), at("runs/copy").join(name)).unwrap();
    }
    let line = format!("--resume --out {}", at("runs/copy/p.bin").display());
    finish(&at("elsewhere"), &line, &at("runs/copy/p.bin"), &at("runs/copy/p.csv"));
    assert_eq!(names(&at("runs/b")), ["p.bin.checkpoint", "p.csv.part"]);
    // The files are renamed.
    fs::rename(at("runs/b/p.bin.checkpoint"), at("runs/b/q.0.1.checkpoint")).unwrap();
    fs::rename(at("runs/b/p.csv.part"), at("runs/b/q.0.1.csv.part")).unwrap();
    let line = "--resume --out ../runs/b/q.0.1";
    finish(&at("elsewhere"), line, &at("runs/b/q.0.1"), &at("runs/b/q.0.1.csv"));

    // A log in another folder; both are moved, and it is found as seen from the policy.
    let line = format!("--out runs/p.bin --log logs/l.csv {begin}");
    kill(run(folder.path(), &line), &at("runs/p.bin"))?;
    fs::create_dir(at("moved")).unwrap();
    fs::rename(at("runs"), at("moved/runs")).unwrap();
    fs::rename(at("logs"), at("moved/logs")).unwrap();
    let line = "--resume --out ../moved/runs/p.bin";
    finish(&at("elsewhere"), line, &at("moved/runs/p.bin"), &at("moved/logs/l.csv"));
    Some(())
}

#[test]
fn advice_that_loses_a_checkpoint_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let begin = ["--preset", "water", "--episodes", "1000000000", "--checkpoint-every", "0.001"];
    let mut child = trainer(&begin, path).spawn().unwrap();
    assert!(kill_at(&mut child, path, Moment::Checkpoints(5)));
    fs::rename(path.join("p.csv.part"), path.join("lost")).unwrap();
    let refused = output(&["--resume"], path);
    let message = error(&refused);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(message.contains("name the checkpoint's log with --log"), "{message}");
    assert!(message.contains("--restart would discard the checkpoint"), "{message}");
    // The advice can be followed.
    fs::rename(path.join("lost"), path.join("found.csv.part")).unwrap();
    let resume = ["--resume", "--log", "found.csv", "--checkpoint-every", "0.001"];
    let mut child = trainer(&resume, path).spawn().unwrap();
    assert!(kill_at(&mut child, path, Moment::Checkpoints(1)), "it resumes");
}

#[test]
fn refuses_a_checkpoint_that_cannot_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let arguments = ["--preset", "water", "--episodes", "1000000000", "--seed", "1"];
    let begin = [&arguments[..], &["--checkpoint-every", "0.001"]].concat();
    let mut child = trainer(&begin, path).spawn().unwrap();
    assert!(kill_at(&mut child, path, Moment::Checkpoints(5)));
    let refused = |arguments: &[&str], message: &str| {
        let output = output(arguments, path);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", error(&output));
        assert!(error(&output).contains(message), "{arguments:?}: {}", error(&output));
    };
    refused(&arguments, "p.bin.checkpoint: a training with this --out is not complete");
    refused(&["--resume", "--seed", "2"], "--seed 2: the checkpoint's is 1");
    refused(&["--resume", "--set", "learning.batch=64"], "learning.batch is 32 in one and 64");
    refused(&["--resume", "--preset", "air"], "the checkpoint is of another configuration");
    let file = path.join("p.bin.checkpoint");
    let good = fs::read(&file).unwrap();
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 1;
    let mut newer = good.clone();
    newer[8] = 9;
    for (bytes, message) in [
        (&flipped[..], "p.bin.checkpoint: a corrupt checkpoint: its checksum is"),
        (&good[..good.len() - 1], "not a complete checkpoint"),
        (&good[..5], "not a complete checkpoint: it has 5 bytes"),
        (&newer, "a checkpoint of version 9; this trainer reads 1"),
        (b"episode,stage,total_steps", "not the checkpoint of a training"),
    ] {
        fs::write(&file, bytes).unwrap();
        refused(&["--resume"], message);
    }
    fs::write(&file, &good).unwrap();
    let log = path.join("p.csv.part");
    let rows = fs::read(&log).unwrap();
    fs::write(&log, &rows[..10]).unwrap();
    refused(&["--resume"], "p.csv.part: the log has only 10 bytes of");
    let other: Vec<u8> = rows.iter().map(|b| if *b == b'1' { b'2' } else { *b }).collect();
    fs::write(&log, other).unwrap();
    refused(&["--resume"], "p.csv.part: this is another log: its checksum is");
    fs::remove_file(&log).unwrap();
    refused(&["--resume"], "p.csv.part: the log cannot be opened");
    // With --restart it begins anew.
    let anew = ["--preset", "water", "--episodes", "3", "--restart"];
    assert!(output(&anew, path).status.success());
    assert_eq!(names(path), ["p.bin", "p.csv"]);
    // There is nothing to resume then, and without the policy nothing at all.
    let complete = output(&["--resume"], path);
    assert!(complete.status.success(), "{}", error(&complete));
    fs::remove_file(path.join("p.bin")).unwrap();
    refused(&["--resume"], "there is no checkpoint p.bin.checkpoint; give --preset or --config");
}

#[test]
fn sighup_stays_ignored_where_the_parent_ignores_it() {
    let folder = tempfile::tempdir().unwrap();
    let line = format!(
        "trap '' HUP; exec {} train --preset air --steps 1000000000 --out p.bin \
         --checkpoint-every 0.01",
        env!("CARGO_BIN_EXE_trainer")
    );
    let mut child = Command::new("sh")
        .args(["-c", &line])
        .current_dir(folder.path())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let id = child.id().to_string();
    let checkpoint = folder.path().join("p.bin.checkpoint");
    let mut wait_for_checkpoints = |count: usize| {
        let inode = || fs::metadata(&checkpoint).map_or(0, |m| m.ino());
        let (began, mut last, mut seen) = (Instant::now(), inode(), 0);
        while seen < count {
            assert!(
                began.elapsed() < Duration::from_mins(1) && child.try_wait().unwrap().is_none()
            );
            let now = inode();
            (seen, last) = (seen + usize::from(now != last), now);
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    wait_for_checkpoints(1);
    let kill = |signal: &str| {
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    };
    kill("-HUP");
    // A training that a signal stops writes one more.
    wait_for_checkpoints(3);
    kill("-TERM");
    // If the first signal had counted, the second would have ended the process without a
    // checkpoint.
    assert_eq!(child.wait().unwrap().code(), Some(1));
    assert_eq!(names(folder.path()), ["p.bin.checkpoint", "p.csv.part"]);
    let resumed = trainer(&["--resume", "--steps", "1"], folder.path()).output().unwrap();
    assert!(error(&resumed).contains("stages.0.length.steps is 1000000000 in one and 1"));
}
