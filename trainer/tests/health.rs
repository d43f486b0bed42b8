//! Divergence and collapse of a training are detected and end it with status 1.

use std::path::Path;
use std::process::{Command, Output};

fn train(line: &str, folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(["train", "--out", "p.bin", "--eval-starts", "0", "--quiet"])
        .args(line.split(' '))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Expects status 1 with these messages, a complete log, no policy and no checkpoint.
fn ends_with(line: &str, message: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let output = train(line, folder.path());
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{line}: {error}");
    for message in message {
        assert!(error.contains(message), "{line}: {error}");
    }
    let names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert_eq!(names, ["p.csv"], "{line}");
    let log = std::fs::read_to_string(folder.path().join("p.csv")).unwrap();
    assert!(log.ends_with('\n'), "{log}");
}

/// With only the learning rates at the top of their range, the networks' units die before any
/// value overflows, which is a collapse. So the inputs are large, too.
#[test]
fn detects_divergence() {
    ends_with(
        "--preset air --steps 3000 --seed 1 --set learning.actor_learning_rate=1 \
         --set learning.critic_learning_rate=1 \
         --set network.observation_offset=[1e6,1e6,0] \
         --set network.observation_scale=[1e6,1e6,1]",
        &[
            "training diverged at step 32: the norm of the critic's gradient is",
            "lower the learning rates",
        ],
    );
}

#[test]
fn detects_a_collapse() {
    // The paper's agent in water, with the only seed of 0 to 9 that learns nothing.
    let line = "--preset water --seed 0";
    ends_with(line, &["collapsed by step 2001", "500 of the latest 500 episodes were over at"]);
    // An actor whose touchdown angle saturates.
    let line = "--preset robust --steps 12000 --seed 1 --set learning.actor_learning_rate=1 \
                --set selection.evaluations=0 --set learning.random_steps=100";
    ends_with(line, &["training collapsed by step ", "take another seed"]);
    // With the option the training continues.
    let folder = tempfile::tempdir().unwrap();
    let output = train("--preset water --seed 0 --episodes 1100 --allow-collapse", folder.path());
    assert!(output.status.success());
}
