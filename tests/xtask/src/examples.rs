//! Runs every example of the workspace.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use crate::programs::target_folder;
use crate::step::output_of;

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    targets: Vec<Target>,
}

#[derive(Deserialize)]
struct Target {
    name: String,
    kind: Vec<String>,
}

/// Runs each example as `cargo test --workspace` has built it, in an empty folder: built
/// with `cargo run --example`, most dependencies would be compiled again with other
/// features.
pub(crate) fn run() -> Result<()> {
    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    let examples = all()?;
    ensure!(!examples.is_empty(), "there is no example in the workspace");
    for (package, name) in examples {
        println!("--- {package}: {name}");
        let program: PathBuf = target_folder().join("debug/examples").join(&name);
        let status = Command::new(&program)
            .current_dir(folder.path())
            .status()
            .with_context(|| format!("cannot start {}", program.display()))?;
        ensure!(status.success(), "the example {name} of {package} ended with {status}");
    }
    Ok(())
}

/// Returns package and name of every example.
fn all() -> Result<Vec<(String, String)>> {
    let metadata = output_of("cargo", &["metadata", "--format-version", "1", "--no-deps"]);
    let metadata = metadata.context("`cargo metadata` fails")?;
    let metadata: Metadata = serde_json::from_str(&metadata)?;
    let mut examples = Vec::new();
    for package in metadata.packages {
        let targets = package.targets.into_iter();
        let own = targets.filter(|target| target.kind.iter().any(|kind| kind == "example"));
        examples.extend(own.map(|target| (package.name.clone(), target.name)));
    }
    Ok(examples)
}
