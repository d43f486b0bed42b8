//! Runs a bench image on an emulated Cortex-M4F and reads the trace of its instructions.

use super::disassembly::Disassembly;
use super::profile::Profile;
use super::trace::{self, Calls};
use anyhow::{Context, Result, bail, ensure};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

const QEMU: &str = "qemu-system-arm";
/// An MPS2 board without devices.
const BOARD: &str = "-machine mps2-an386 -nodefaults -nic user,restrict=on -display none \
    -monitor none -serial none -semihosting-config enable=on,target=native";
/// Logs every instruction on the standard error.
const TRACE: &str = "-singlestep -d exec,nochain";
/// Prefix of the functions in a bench image whose calls are counted.
const PREFIX: &str = "measured_";

/// Returns the costliest call of each counted function of an image, by its name without
/// the prefix.
pub(super) fn profiles(image: &Path) -> Result<BTreeMap<String, Profile>> {
    let disassembly = Disassembly::of(image)?;
    let watched = disassembly.functions(PREFIX);
    ensure!(!watched.is_empty(), "{} has no function `{PREFIX}...`", image.display());
    let length_of = |address| disassembly.at(address).map(|i| i.length);
    let mut calls = Calls::new(&watched, &length_of);
    watch(image, TRACE, |address| calls.push(address))?;
    let mut profiles = BTreeMap::<String, Profile>::new();
    for call in calls.finish() {
        let profile = Profile::of(&call, &disassembly)?;
        let worst = profiles.entry(call.function).or_default();
        if profile.instructions > worst.instructions {
            *worst = profile;
        }
    }
    if let Some(name) = watched.values().find(|&name| !profiles.contains_key(name)) {
        bail!("{}: `{PREFIX}{name}` was never called", image.display());
    }
    Ok(profiles)
}

/// Runs an image to its end; fails if its exit status is not zero.
pub(super) fn run(image: &Path) -> Result<()> {
    watch(image, "", |_| ())
}

/// Runs an image and calls `each` with the address of every logged instruction.
fn watch(image: &Path, log: &str, mut each: impl FnMut(u32)) -> Result<()> {
    let mut child = Command::new(QEMU)
        .args(BOARD.split_whitespace().chain(log.split_whitespace()))
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| {
            format!("cannot start `{QEMU}`: install it with `apt install qemu-system-arm`")
        })?;
    let log = child.stderr.take().context("no log")?;
    let mut message = String::new();
    for line in BufReader::new(log).lines() {
        let line = line?;
        match trace::address_of(&line) {
            Some(address) => each(address),
            None => message = line,
        }
    }
    let status = child.wait()?;
    ensure!(status.success(), "{} ended with {status} on {QEMU}; {message}", image.display());
    Ok(())
}
