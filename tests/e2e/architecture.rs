//! What `ARCHITECTURE.md` promises, checked.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde::Deserialize;

/// Every path that the code map names exists.
#[test]
fn every_path_that_the_architecture_names_exists() {
    let text = std::fs::read_to_string(harness::root().join("ARCHITECTURE.md")).unwrap();
    let is_path = |word: &&str| {
        word.contains('/') && word.chars().all(|c| c.is_alphanumeric() || "/._-".contains(c))
    };
    let paths: Vec<&str> = text.split('`').skip(1).step_by(2).filter(is_path).collect();
    assert!(
        paths.len() > 20,
        "only {} paths found: is the map still written in `code`?",
        paths.len()
    );
    let missing: Vec<_> = paths.iter().filter(|p| !harness::root().join(p).exists()).collect();
    assert!(missing.is_empty(), "ARCHITECTURE.md names what is not there: {missing:?}");
}

/// What each library may depend on, of this workspace and of crates.io: its normal
/// dependencies, direct ones. Everything else is refused.
const ALLOWED: [(&str, &[&str]); 3] = [
    ("leg-kernel-m4f", &["heapless"]),
    (
        "leg-control",
        &[
            "bytemuck",
            "crc",
            "embedded-io",
            "heapless",
            "leg-kernel-m4f",
            "libm",
            "micromath",
            "nalgebra",
            "postcard",
            "serde",
        ],
    ),
    ("leg-plant", &["libm", "serde", "smallvec", "thiserror"]),
];

/// Which packages of this workspace each may depend on.
const ARROWS: [(&str, &[&str]); 6] = [
    ("leg-process", &["leg-control"]),
    ("leg-host", &["leg-control", "leg-process"]),
    ("sim-host", &["leg-control", "leg-host", "leg-plant", "leg-process"]),
    ("trainer", &["leg-control", "leg-plant", "leg-process"]),
    (
        "paper-figures",
        &["leg-control", "leg-host", "leg-plant", "leg-process", "sim-host", "trainer"],
    ),
    ("leg-kernel-m4f", &[]),
];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    kind: Option<String>,
}

/// The normal dependencies of each package of the workspace.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .current_dir(harness::root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Metadata = serde_json::from_slice(&output.stdout).unwrap();
    let normal = |package: Package| {
        let of_it = package.dependencies.into_iter().filter(|d| d.kind.is_none()).map(|d| d.name);
        (package.name, of_it.collect())
    };
    metadata.packages.into_iter().map(normal).collect()
}

fn set(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(ToString::to_string).collect()
}

/// The libraries that firmware and others build on depend on what is listed, no more.
#[test]
fn libraries_depend_on_nothing_but_what_is_allowed() {
    let found = dependencies();
    for (package, allowed) in ALLOWED {
        let more: Vec<_> = found[package].difference(&set(allowed)).cloned().collect();
        assert!(more.is_empty(), "{package} depends on {more:?}: allow it here, or drop it");
    }
}

/// Arrows between packages run one way.
#[test]
fn packages_depend_on_each_other_one_way() {
    let found = dependencies();
    let ours: BTreeSet<String> = found.keys().cloned().collect();
    for (package, allowed) in ARROWS {
        let inside: BTreeSet<_> = found[package].intersection(&ours).cloned().collect();
        let more: Vec<_> = inside.difference(&set(allowed)).cloned().collect();
        assert!(more.is_empty(), "{package} depends on {more:?}");
    }
}
