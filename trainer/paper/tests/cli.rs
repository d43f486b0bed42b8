//! The command line of `paper-figures`. The end-to-end tests make the figures; this test
//! also has `cargo test` build the program that they run.

use std::process::Command;

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
