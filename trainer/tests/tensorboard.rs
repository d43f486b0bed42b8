//! Parses the event files again. That TensorBoard reads them was checked with its
//! `EventAccumulator` and its HTTP interface (`pip install tensorboard`, `tensorboard --logdir
//! DIR`).

use prost::Message;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use trainer::run::tensorboard::{Event, masked};

/// Returns the events of a file; every frame must be complete.
fn events(path: &Path) -> Vec<Event> {
    let bytes = std::fs::read(path).unwrap();
    let mut rest = &bytes[..];
    let mut take = |n: usize| {
        let (taken, after) = rest.split_at_checked(n)?;
        rest = after;
        Some(taken)
    };
    let mut events = Vec::new();
    while let Some(length) = take(8) {
        let crc = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap());
        assert_eq!(crc(take(4).unwrap()), masked(length));
        let record = take(u64::from_le_bytes(length.try_into().unwrap()) as usize).unwrap();
        assert_eq!(crc(take(4).unwrap()), masked(record));
        events.push(Event::decode(record).unwrap());
    }
    events
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
    let files: Vec<_> = std::fs::read_dir(folder.path().join("board")).unwrap().collect();
    assert_eq!(files.len(), 1);
    let events = events(&files[0].as_ref().unwrap().path());
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
