//! Parses the event files again. That TensorBoard reads them was checked with its
//! `EventAccumulator` and its HTTP interface (`pip install tensorboard`, `tensorboard --logdir
//! DIR`).

use prost::Message;
use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use trainer::run::tensorboard::{Event, masked};

/// Returns the events of a file, and whether its last frame is complete.
fn events(path: &Path) -> (Vec<Event>, bool) {
    let bytes = std::fs::read(path).unwrap();
    let mut events = Vec::new();
    let mut rest = &bytes[..];
    let crc = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap());
    let frame = |rest: &mut &[u8]| {
        let mut take = |n: usize| {
            let (taken, after) = rest.split_at_checked(n)?;
            *rest = after;
            Some(taken)
        };
        let (length, check) = (take(8)?, take(4)?);
        assert_eq!(crc(check), masked(length));
        let record = take(u64::from_le_bytes(length.try_into().unwrap()) as usize)?;
        assert_eq!(crc(take(4)?), masked(record));
        Some(Event::decode(record).unwrap())
    };
    while !rest.is_empty() {
        let Some(event) = frame(&mut rest) else { return (events, false) };
        events.push(event);
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
    for (name, count) in [("s1", 1), ("s1-2", 1), ("s2", 2)] {
        assert_eq!(files(&board.join(name)).len(), count, "{name}");
        assert_eq!(shown(&board.join(name)), 40, "{name}");
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
    // After the first checkpoint, that of step 0, there are events.
    while seen < 4 {
        assert!(began.elapsed() < Duration::from_mins(1), "no checkpoint");
        if child.try_wait().unwrap().is_some() {
            return None;
        }
        let now = inode();
        (seen, last) = (seen + usize::from(now != last), now);
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    // It may have ended just before.
    child.wait().unwrap().code().is_none().then_some(())?;
    assert!(command().status().unwrap().success());
    assert_eq!(files(&at.join("board")), [at.join("board/p")]);
    let rows = csv::Reader::from_path(at.join("p.csv")).unwrap().into_records().count();
    assert_eq!(shown(&at.join("board/p")), rows);
    Some(())
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
            } else {
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
