//! What the end-to-end tests and the repository's own commands share.

pub mod board;
pub mod browser;
pub mod emulator;

use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// The repository's root.
#[must_use]
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// One of the workspace's programs, built first (once a test process), in the
/// profile of the tests. It is built as the whole suite builds it, with the
/// features that the tests' own dependencies bring: in any other way, nearly
/// everything would be built a second time.
#[must_use]
pub fn program(name: &str) -> Command {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let this = std::env::current_exe().expect("the path of this test");
        let folder = this.parent().and_then(|deps| deps.parent()).expect("target/PROFILE/deps");
        let mut build = Command::new(env!("CARGO"));
        build.args(["test", "--no-run", "--quiet", "--workspace"]);
        if folder.ends_with("release") {
            build.arg("--release");
        }
        let status = build.current_dir(root()).status().expect("cargo");
        assert!(status.success(), "the programs do not build");
        folder.to_owned()
    });
    Command::new(folder.join(name))
}
