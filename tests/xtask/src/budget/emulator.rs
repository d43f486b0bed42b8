//! Runs a bench image on an emulated Cortex-M4F and writes down what it executes.

use super::disassembly::Disassembly;
use super::profile::Profile;
use super::trace::{self, Calls};
use anyhow::{Context, Result, bail, ensure};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

const QEMU: &str = "qemu-system-arm";
/// No devices.
const BOARD: &str = "-machine mps2-an386 -nodefaults -nic user,restrict=on -display none \
    -monitor none -serial none -semihosting-config enable=on,target=native";
/// One instruction a step, each with a line on standard error.
const TRACE: &str = "-singlestep -d exec,nochain";
/// What a function of the bench image is called when its calls are to be counted.
const PREFIX: &str = "figure_";

/// The costliest call of each figure of an image, by the figures' names.
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
        let worst = profiles.entry(call.figure).or_default();
        if profile.instructions > worst.instructions {
            *worst = profile;
        }
    }
    if let Some(name) = watched.values().find(|&name| !profiles.contains_key(name)) {
        bail!("{}: `{PREFIX}{name}` was never called", image.display());
    }
    Ok(profiles)
}

/// Runs an image to its end, which must be a good one.
pub(super) fn run(image: &Path) -> Result<()> {
    watch(image, "", |_| ())
}

/// Runs an image; `each` gets the address of every instruction that is logged.
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
    let mut said = String::new();
    for line in BufReader::new(log).lines() {
        let line = line?;
        match trace::address_of(&line) {
            Some(address) => each(address),
            None => said = line,
        }
    }
    let status = child.wait()?;
    ensure!(status.success(), "{} ended with {status} on {QEMU}; {said}", image.display());
    Ok(())
}
