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

/// Misuses the Gymnasium environment, and compares it with one that is not misused.
const MISUSED: &str = r#"
import sys
sys.path.insert(0, sys.argv[2])
import numpy as np
from hopper_env import HopperEnv

env, other = HopperEnv(sys.argv[1]), HopperEnv(sys.argv[1])
for bad in [[1.5, 0], [1.5], [float("nan"), 0], ["x", 0]]:
    try:
        env.step(bad)
    except (RuntimeError, ValueError):
        continue
    raise AssertionError(bad)
assert np.array_equal(env.reset(seed=5)[0], other.reset(seed=5)[0])
try:
    env.step([float("inf"), 0])
except ValueError:
    pass
ours, theirs = env.step([1.57, 0.1]), other.step([1.57, 0.1])
assert np.array_equal(ours[0], theirs[0]) and ours[1:] == theirs[1:], (ours, theirs)
env.close()
other.close()
"#;

#[test]
fn the_gymnasium_environment_works_on_after_misuse() {
    let Some(python) = requirements::python() else { return };
    let bridges = requirements::checkout().join("trainer/bridges");
    let output = Command::new(&python)
        .args(["-B", "-c", MISUSED, env!("CARGO_BIN_EXE_trainer")])
        .arg(bridges)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", output.stderr.escape_ascii());
}
