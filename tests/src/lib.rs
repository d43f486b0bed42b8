//! Boards, emulator, browser and programs for the end-to-end tests and `cargo xtask`.

pub mod board;
pub mod browser;
pub mod emulator;
pub mod firmware;

pub use requirements::checkout;

use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// Returns the command that starts one of the workspace's programs, built in the profile of
/// the tests.
///
/// The first call in a test process builds all programs as `cargo test --workspace` does:
/// any other selection of packages has other features and would compile nearly everything
/// again.
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
        let status = build.current_dir(checkout()).status().expect("cargo");
        assert!(status.success(), "the programs do not build");
        folder.to_owned()
    });
    Command::new(folder.join(name))
}
