//! The exports in ONNX Runtime, numpy and PyTorch, by `trainer/bridges/check.py`.
//!
//! Runs where `LEG_PYTHON` names a Python that has the packages of
//! `trainer/bridges/requirements.txt`; without it this test passes, and says on the
//! standard error that it was skipped.

use std::io::Write;
use std::path::Path;
use std::process::Command;

#[test]
fn other_libraries_give_the_same_actions() {
    let Some(python) = std::env::var_os("LEG_PYTHON") else {
        // Not by a macro, whose words the test harness keeps to itself.
        let said = "SKIPPED: LEG_PYTHON names no Python with onnxruntime and safetensors";
        let mut stderr = std::io::stderr();
        writeln!(stderr, "{said}").unwrap();
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("bridges/check.py");
    let output = Command::new(&python)
        .arg(script)
        .args(["--trainer", env!("CARGO_BIN_EXE_trainer")])
        .output()
        .unwrap_or_else(|e| panic!("LEG_PYTHON={}: {e}", python.display()));
    let (said, error) = (output.stdout.escape_ascii(), output.stderr.escape_ascii());
    assert!(output.status.success(), "{said}\n{error}");
    println!("{}", String::from_utf8_lossy(&output.stdout));
}
