//! Parses the event files again. That TensorBoard reads them was checked with its
//! `EventAccumulator` and its HTTP interface (`pip install tensorboard`, `tensorboard --logdir
//! DIR`).

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use trainer::run::tensorboard::{Event, first_frame, masked};

/// Returns the events of a file, and whether its last frame is complete.
fn events(path: &Path) -> (Vec<Event>, bool) {
    let bytes = std::fs::read(path).unwrap();
    let mut events = Vec::new();
    let mut rest = &bytes[..];
    while !rest.is_empty() {
        let Some((event, len)) = first_frame(rest) else { return (events, false) };
        events.push(event);
        rest = &rest[len..];
    }
    (events, true)
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Runs a short training of `--out OUT` with a seed; `more` are further options.
fn train(folder: &Path, out: &str, seed: u32, more: &str) {
    let line = format!(
        "train --preset air --episodes 40 --eval-starts 0 --quiet --tensorboard board \
         --out {out} --seed {seed} {more}"
    );
    let output = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Asserts that no reader finds a step of a value twice in the files of a run.
#[track_caller]
fn assert_each_once(folder: &Path) {
    let mut seen = BTreeSet::new();
    for event in files(folder).iter().flat_map(|path| events(path).0) {
        for value in event.summary.iter().flat_map(|summary| &summary.value) {
            assert!(seen.insert((value.tag.clone(), event.step)), "{} {}", value.tag, event.step);
        }
    }
    assert!(seen.len() > 10, "{seen:?}");
}

/// Number of episodes that TensorBoard shows of the files of a run: a session start drops what
/// earlier events have at its step and later ones.
fn shown(folder: &Path) -> usize {
    let mut steps = Vec::new();
    for event in files(folder).iter().flat_map(|path| events(path).0) {
        if event.session_log.is_some() {
            steps.retain(|&step| step < event.step);
        }
        let values = || event.summary.iter().flat_map(|summary| &summary.value);
        if values().any(|value| value.tag == "episode/reward") {
            steps.push(event.step);
        }
    }
    steps.len()
}

#[test]
fn trainings_that_share_a_folder_keep_all_their_curves() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::create_dir(at.join("other")).unwrap();
    train(at, "s1.bin", 1, "");
    train(at, "s2.bin", 2, "");
    train(at, "other/s1.bin", 3, "");
    // The same training anew: its curve replaces the old one.
    train(at, "s2.bin", 2, "");
    let board = at.join("board");
    assert_eq!(files(&board), ["s1", "s1-2", "s2"].map(|name| board.join(name)));
    for (name, count) in [("s1", 1), ("s1-2", 1), ("s2", 1)] {
        assert_eq!(files(&board.join(name)).len(), count, "{name}");
        assert_eq!(shown(&board.join(name)), 40, "{name}");
        assert_each_once(&board.join(name));
    }
}

#[test]
fn a_resumed_training_continues_its_run() {
    let attempts = 50;
    let resumed = (0..attempts).any(|_| is_continued_by_a_resumed_training().is_some());
    assert!(resumed, "in {attempts} attempts the training ended before it was killed");
}

/// Returns `None` where the training has ended before it was killed.
fn is_continued_by_a_resumed_training() -> Option<()> {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let line = "train --preset air --steps 3000 --checkpoint-every 0.01 --eval-starts 0 --quiet \
                --tensorboard board --out p.bin --resume";
    let command = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
        command.args(line.split_whitespace()).current_dir(at);
        command
    };
    let mut child = command().spawn().unwrap();
    let inode = || std::fs::metadata(at.join("p.bin.checkpoint")).map_or(0, |m| m.ino());
    let (began, mut last, mut seen) = (Instant::now(), 0, 0);
    // A checkpoint before the last events, as where the process is killed some time after one.
    let early = at.join("early");
    // After the first checkpoint, that of step 0, there are events.
    while seen < 4 {
        assert!(began.elapsed() < Duration::from_mins(1), "no checkpoint");
        if child.try_wait().unwrap().is_some() {
            return None;
        }
        let now = inode();
        (seen, last) = (seen + usize::from(now != last), now);
        if seen == 2 && !early.exists() {
            std::fs::copy(at.join("p.bin.checkpoint"), &early).unwrap();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    // It may have ended just before.
    child.wait().unwrap().code().is_none().then_some(())?;
    std::fs::rename(&early, at.join("p.bin.checkpoint")).unwrap();
    assert!(command().status().unwrap().success());
    assert_eq!(files(&at.join("board")), [at.join("board/p")]);
    let rows = csv::Reader::from_path(at.join("p.csv")).unwrap().into_records().count();
    assert_eq!(shown(&at.join("board/p")), rows);
    assert_each_once(&at.join("board/p"));
    Some(())
}

#[test]
fn a_study_writes_the_events_of_each_seed_to_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let study = |more: &str| {
        let line = format!("study --preset air --steps 300 --eval-starts 1 --out study {more}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
        command.args(line.split_whitespace()).current_dir(folder.path()).output().unwrap()
    };
    let output = study("--seeds 3..5 --tensorboard board");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let board = folder.path().join("board");
    assert_eq!(files(&board), ["seed-3", "seed-4"].map(|name| board.join(name)));
    for seed in 3..5 {
        let log = folder.path().join(format!("study/seeds/{seed:04}/learning.csv"));
        let rows = csv::Reader::from_path(log).unwrap().into_records().count();
        let own = board.join(format!("seed-{seed}"));
        assert_eq!((shown(&own), files(&own).len()), (rows, 1));
        assert_each_once(&own);
    }
    // A seed that must be trained anew, as after a kill.
    std::fs::remove_file(folder.path().join("study/seeds/0004/report.json")).unwrap();
    let output = study("--seeds 3..5 --tensorboard board");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(files(&board).len(), 2);
    assert_each_once(&board.join("seed-4"));
    std::fs::write(folder.path().join("file"), "").unwrap();
    let refused = study("--seeds 5..6 --tensorboard file/board");
    let error = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{error}");
    assert!(error.contains("name another folder with --tensorboard"), "{error}");
}

#[test]
fn the_plugin_hparams_of_tensorboard_lists_the_parameters_of_a_training() {
    let Some(python) = requirements::python() else { return };
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..3 {
        let more = format!("--set learning.batch={}", 32 * seed);
        train(folder.path(), &format!("s{seed}.bin"), seed, &more);
    }
    let script = requirements::checkout().join("trainer/tests/hparams.py");
    let output = Command::new(python).arg(script).arg(folder.path().join("board")).output();
    let output = output.expect("Python starts");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let groups: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for seed in 1..3 {
        let group = &groups[format!("s{seed}")];
        let parameters = &group["hparams"];
        assert_eq!(parameters["seed"], f64::from(seed), "{groups}");
        assert_eq!(parameters["learning.batch"], f64::from(32 * seed), "{groups}");
        assert!(parameters.as_object().unwrap().len() > 20, "{groups}");
        assert_eq!(group["status"], "STATUS_SUCCESS");
        assert!(group["metrics"]["episode/reward"].is_number(), "{groups}");
    }
}

#[test]
fn an_event_file_has_every_episode_and_evaluation() {
    // The CRC-32C of "123456789" is 0xe3069283 (RFC 3720), masked as TFRecord does.
    assert_eq!(masked(b"123456789"), 0x2507_c60d_u32.wrapping_add(0xa282_ead8));
    let folder = tempfile::tempdir().unwrap();
    let line = "train --preset robust --steps 3000 --out p.bin --eval-starts 0 --quiet \
        --tensorboard board --set learning.random_steps=300 --set selection.evaluations=3 \
        --set selection.starts=20 --seed 4 \
        --set gains=[{density_ratio=0.0,kp=0.0,ki=0.05,kd=0.0,feed_forward=1.0,limit_m_s=1.0}]";
    let output = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(line.split_whitespace())
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files = files(&folder.path().join("board/p"));
    assert_eq!(files.len(), 1);
    let (events, is_complete) = events(&files[0]);
    assert!(is_complete);
    assert_eq!(events[0].file_version.as_deref(), Some("brain.Event:2"));
    assert_eq!(events[1].session_log.map(|s| s.status), Some(1));

    let mut scalars = BTreeMap::<&str, Vec<(i64, f32)>>::new();
    for event in &events {
        for value in event.summary.iter().flat_map(|s| &s.value) {
            if let Some(x) = value.simple_value {
                scalars.entry(&value.tag).or_default().push((event.step, x));
            } else if !value.tag.starts_with("_hparams_/") {
                assert_eq!(value.tag, "hyperparameters/text_summary");
                let text = &value.tensor.as_ref().unwrap().string_val[0];
                let text = std::str::from_utf8(text).unwrap();
                assert!(text.contains("seed 4") && text.contains("random_steps = 300"), "{text}");
            }
        }
    }
    let mut log = csv::Reader::from_path(folder.path().join("p.csv")).unwrap();
    let column =
        |name: &str, log: &csv::StringRecord| log.iter().position(|header| header == name).unwrap();
    let header = log.headers().unwrap().clone();
    let (step, reward) = (column("total_steps", &header), column("reward", &header));
    let logged: Vec<(i64, f32)> = log
        .records()
        .map(|row| row.unwrap())
        .map(|row| (row[step].parse().unwrap(), row[reward].parse::<f64>().unwrap() as f32))
        .collect();
    assert_eq!(scalars["episode/reward"], logged);
    for tag in ["episode/steps", "episode/q0", "episode/full_share"] {
        assert_eq!(scalars[tag].len(), logged.len(), "{tag}");
    }
    for tag in ["update/critic_gradient_norm", "update/actor_gradient_norm"] {
        assert!(scalars[tag].len() > 10 && scalars[tag].iter().all(|(_, x)| *x >= 0.0), "{tag}");
    }
    for tag in ["evaluation/cost", "evaluation/survive30/0", "evaluation/survive30/0.05"] {
        assert_eq!(scalars[tag].len(), 3, "{tag}");
    }
}
