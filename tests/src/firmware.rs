//! Builds of the firmware.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::checkout;

/// The firmware's own workspace.
pub const FOLDER: &str = "controller/firmware";

/// Returns the folder that cargo builds the firmware into.
///
/// It is one for every board and every selection of features: cargo keeps the results of each
/// apart, and compiles the dependencies once for all. One for each of them would compile
/// them, and the procedural macros, seven times.
#[must_use]
pub fn target_folder() -> PathBuf {
    checkout().join("target/firmware")
}

/// A build of the firmware.
#[derive(Clone, Copy, Debug)]
pub struct Build<'a> {
    /// Name of the folder for the built programs, different for every build.
    pub name: &'a str,
    /// Features of the firmware, separated by commas: exactly one board, and what else.
    pub features: &'a str,
    /// Programs to build.
    pub programs: &'a [&'a str],
    /// Compiler flags, in place of those of the firmware's configuration.
    pub flags: Option<&'a str>,
    /// Policy file to build into the image that measures one.
    pub policy: Option<&'a Path>,
}

impl Build<'_> {
    /// Builds the programs and returns the folder that contains them.
    ///
    /// # Errors
    /// Fails if cargo fails, or if the programs cannot be copied.
    pub fn run(&self) -> Result<PathBuf> {
        let target = target_folder();
        let folder = target.join("images").join(self.name);
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        // Cargo gives a program of one name to one selection of features at a time, so the
        // result is copied, and until then no other process may build.
        let lock = target.join("images/lock");
        let lock =
            File::create(&lock).with_context(|| format!("cannot create {}", lock.display()))?;
        lock.lock().context("cannot wait for another build of the firmware")?;

        let mut cargo = Command::new(env!("CARGO"));
        cargo
            .args(["build", "--quiet", "--release", "--no-default-features"])
            .args(["--features", self.features, "--target-dir"])
            .arg(&target)
            .args(self.programs.iter().flat_map(|program| ["--bin", program]))
            // Cargo reads target and link arguments from the configuration in this folder.
            .current_dir(checkout().join(FOLDER))
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("RUSTFLAGS");
        if let Some(flags) = self.flags {
            cargo.env("RUSTFLAGS", flags);
        }
        if let Some(policy) = self.policy {
            cargo.env("LEG_POLICY", policy);
        }
        let status = cargo.status().context("cannot start cargo")?;
        ensure!(status.success(), "the firmware for {} does not build ({status})", self.name);

        let built = target.join("thumbv7em-none-eabihf/release");
        for program in self.programs {
            // Renamed when it is whole: an emulator may be reading the file that it replaces.
            let copy = folder.join(format!("{program}.new"));
            let copied = fs::copy(built.join(program), &copy)
                .and_then(|_| fs::rename(&copy, folder.join(program)));
            copied.with_context(|| format!("cannot copy {program} to {}", folder.display()))?;
        }
        Ok(folder)
    }
}
