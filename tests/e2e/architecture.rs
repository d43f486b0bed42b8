//! What `ARCHITECTURE.md` promises, checked.

use std::process::Command;

/// Every path that the code map names exists.
#[test]
fn every_path_that_the_architecture_names_exists() {
    let text = std::fs::read_to_string(tests::root().join("ARCHITECTURE.md")).unwrap();
    let is_path = |word: &&str| {
        word.contains('/') && word.chars().all(|c| c.is_alphanumeric() || "/._-".contains(c))
    };
    let paths: Vec<&str> = text.split('`').skip(1).step_by(2).filter(is_path).collect();
    assert!(
        paths.len() > 20,
        "only {} paths found: is the map still written in `code`?",
        paths.len()
    );
    let missing: Vec<_> = paths.iter().filter(|p| !tests::root().join(p).exists()).collect();
    assert!(missing.is_empty(), "ARCHITECTURE.md names what is not there: {missing:?}");
}

fn dependencies_of(package: &str, more: &[&str]) -> Vec<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--package", package, "--edges", "normal", "--prefix", "none"])
        .args(["--format", "{p}"])
        .args(more)
        .current_dir(tests::root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).unwrap();
    names.lines().filter_map(|l| l.split(' ').next()).map(str::to_owned).collect()
}

/// The controller for a microcontroller never depends on the host's side.
#[test]
fn the_controller_depends_on_nothing_of_the_host() {
    let found = dependencies_of("controller", &["--no-default-features"]);
    assert!(found.contains(&"heapless".to_owned()), "{found:?}");
    for forbidden in ["sim-host", "trainer", "iceoryx2", "clap", "anyhow"] {
        assert!(!found.iter().any(|d| d == forbidden), "controller depends on {forbidden}");
    }
}

/// The plant steps alone: no policy, no transport, no clock in its folder.
#[test]
fn the_plant_knows_nothing_of_policies_transports_or_clocks() {
    for entry in std::fs::read_dir(tests::root().join("sim-host/src/plant")).unwrap() {
        let path = entry.unwrap().path();
        let code = std::fs::read_to_string(&path).unwrap();
        for forbidden in ["controller::", "iceoryx2", "std::time", "std::fs", "std::io"] {
            assert!(!code.contains(forbidden), "{} uses {forbidden}", path.display());
        }
    }
}
