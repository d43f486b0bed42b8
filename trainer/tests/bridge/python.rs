//! Checks the exports in ONNX Runtime, numpy and PyTorch with `trainer/bridges/check.py`.

use std::process::Command;

#[test]
fn other_libraries_compute_the_same_actions() {
    let Some(python) = requirements::python() else { return };
    let script = requirements::checkout().join("trainer/bridges/check.py");
    let output = Command::new(&python)
        .arg(script)
        .args(["--trainer", env!("CARGO_BIN_EXE_trainer")])
        .output()
        .unwrap_or_else(|e| panic!("LEG_PYTHON={}: {e}", python.display()));
    let (said, error) = (output.stdout.escape_ascii(), output.stderr.escape_ascii());
    assert!(output.status.success(), "{said}\n{error}");
    println!("{}", String::from_utf8_lossy(&output.stdout));
}
