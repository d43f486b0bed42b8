//! The packages of the workspace: their dependencies, and what crates.io wants of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

use serde::Deserialize;

/// Direct normal dependencies that each library may have.
const ALLOWED: [(&str, &[&str]); 8] = [
    ("leg-kernel-m4f", &["heapless"]),
    (
        "leg-control",
        &[
            "bytemuck",
            "cobs",
            "crc",
            "defmt",
            "embedded-io",
            "embedded-storage",
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
    ("leg-charts", &["plotters"]),
    ("leg-simd", &[]),
    // The apex map in the vectors of `leg-simd`.
    ("leg-lanes", &["leg-plant", "leg-simd"]),
    ("leg-ddpg", &["leg-simd", "libm", "rand", "rand_pcg", "serde"]),
    (
        "leg-recording",
        &["bytemuck", "leg-control", "lz4_flex", "mcap", "prost", "ruzstd", "thiserror"],
    ),
];

/// Packages of this workspace that each package may depend on.
const ARROWS: [(&str, &[&str]); 9] = [
    ("leg-process", &["leg-control"]),
    ("leg-recording", &["leg-control"]),
    // `controller estimate` reads recordings and draws estimates.
    ("leg-host", &["leg-charts", "leg-control", "leg-process", "leg-recording"]),
    // The session and the law for C.
    ("leg-c", &["leg-control", "leg-host", "leg-process"]),
    (
        "sim-host",
        &["leg-charts", "leg-control", "leg-host", "leg-plant", "leg-process", "leg-recording"],
    ),
    (
        "trainer",
        &[
            "leg-charts",
            "leg-control",
            "leg-ddpg",
            "leg-lanes",
            "leg-plant",
            "leg-process",
            "leg-simd",
        ],
    ),
    (
        "paper-figures",
        &[
            "leg-charts",
            "leg-control",
            "leg-host",
            "leg-plant",
            "leg-process",
            "sim-host",
            "trainer",
        ],
    ),
    // The Python package offers what the others do, and adds no physics or law of its own.
    (
        "leg-python",
        &[
            "leg-control",
            "leg-host",
            "leg-plant",
            "leg-process",
            "leg-recording",
            "sim-host",
            "trainer",
        ],
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
    manifest_path: PathBuf,
    /// `None`: any registry; empty: none.
    publish: Option<Vec<String>>,
    description: Option<String>,
    readme: Option<String>,
    documentation: Option<String>,
    license: Option<String>,
    rust_version: Option<String>,
    keywords: Vec<String>,
    categories: Vec<String>,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    kind: Option<String>,
}

/// Returns the packages of the workspace.
fn packages() -> Vec<Package> {
    let output = cargo(&["metadata", "--format-version", "1", "--no-deps"]);
    serde_json::from_str::<Metadata>(&output).unwrap().packages
}

/// Returns the standard output of cargo.
fn cargo(args: &[&str]) -> String {
    let output =
        Command::new(env!("CARGO")).args(args).current_dir(harness::checkout()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Returns the direct normal dependencies of each package.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let normal = |package: Package| {
        let found = package.dependencies.into_iter().filter(|d| d.kind.is_none()).map(|d| d.name);
        (package.name, found.collect())
    };
    packages().into_iter().map(normal).collect()
}

fn set(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(ToString::to_string).collect()
}

#[test]
fn libraries_depend_only_on_what_is_allowed() {
    let found = dependencies();
    for (package, allowed) in ALLOWED {
        let more: Vec<_> = found[package].difference(&set(allowed)).cloned().collect();
        assert!(more.is_empty(), "{package} depends on {more:?}: allow it here, or drop it");
    }
}

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

/// Most packages that the trainer may compile, itself among them. A new dependency that is
/// worth it raises the number.
const MOST_PACKAGES_OF_THE_TRAINER: usize = 101;

#[test]
fn the_trainer_compiles_few_packages_and_no_transport() {
    let tree = cargo(&["tree", "-p", "trainer", "-e", "normal", "--prefix", "none"]);
    let names: BTreeSet<&str> =
        tree.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() <= MOST_PACKAGES_OF_THE_TRAINER, "{} packages", names.len());
    for transport in ["leg-host", "iceoryx2"] {
        assert!(!names.contains(transport), "{transport}");
    }
}

#[test]
fn published_packages_have_what_crates_io_shows() {
    let published: Vec<Package> =
        packages().into_iter().filter(|package| package.publish.is_none()).collect();
    let names: BTreeSet<&str> = published.iter().map(|package| package.name.as_str()).collect();
    assert_eq!(names, BTreeSet::from(["leg-control", "leg-kernel-m4f", "leg-plant"]));
    for package in published {
        let name = &package.name;
        for (field, value) in [
            ("description", &package.description),
            ("readme", &package.readme),
            ("documentation", &package.documentation),
            ("license", &package.license),
            ("rust-version", &package.rust_version),
        ] {
            assert!(value.is_some(), "{name} has no {field}");
        }
        // The limits of crates.io.
        let is_short = |keyword: &String| keyword.len() <= 20;
        assert!((1..=5).contains(&package.keywords.len()), "{name}: {:?}", package.keywords);
        assert!(package.keywords.iter().all(is_short), "{name}: {:?}", package.keywords);
        assert!((1..=5).contains(&package.categories.len()), "{name}: {:?}", package.categories);
        let folder = package.manifest_path.parent().unwrap();
        for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
            assert!(folder.join(file).is_file(), "{name} has no {file}");
        }
    }
}
