//! The command line of `paper-figures`. The end-to-end tests make the figures; this test
//! also has `cargo test` build the program that they run.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

#[test]
fn rejects_a_figure_that_does_not_exist_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_paper-figures"))
        .args(["--only", "3,2", "--out"])
        .arg(folder.path().join("out"))
        .output()
        .expect("the program runs");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("--only 2") && message.contains("3, 4, 5"), "{message}");
    assert!(!folder.path().join("out").exists(), "nothing is written");
}

/// Runs `--quick --only 5` with limits of a shell, such as `ulimit -f 8;`.
fn limited(limits: &str, out: &Path) -> Output {
    Command::new("sh")
        .args(["-c", &format!("{limits} exec \"$0\" --quick --only 5 --out \"$1\"")])
        .arg(env!("CARGO_BIN_EXE_paper-figures"))
        .arg(out)
        .env("RAYON_NUM_THREADS", "300")
        .output()
        .expect("the shell runs")
}

#[test]
fn fewer_threads_than_wanted_draw_the_same_figure() {
    let folder = tempfile::tempdir().unwrap();
    let [usual, little] = ["usual", "little"].map(|name| folder.path().join(name));
    assert!(limited("", &usual).status.success());
    // Four are tried at least; there is room for the stacks of two, and 300 MiB for the rest.
    let output = limited("ulimit -v 2400000; export RUST_MIN_STACK=1073741824;", &little);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    assert!(message.contains(" threads; raise the limit"), "{message}");
    let drawn = |out: &Path| fs::read(out.join("fig05.csv")).unwrap();
    assert!(drawn(&usual) == drawn(&little));
}

#[test]
fn the_limit_of_file_sizes_is_an_error_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let output = limited("ulimit -f 8;", folder.path());
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("File too large (os error 27)"), "{message}");
    assert!(message.contains("raise the limit of file sizes (ulimit -f)"), "{message}");
}
