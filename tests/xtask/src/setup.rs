//! What the checks need beside cargo, and how to get it.

use crate::step::{Step, output_of};
use anyhow::{Result, bail};

/// Targets that the controller is built for: the Cortex-M4F and M7 of the
/// firmware, the smallest Cortex-M, and RISC-V.
const TARGETS: [&str; 3] =
    ["thumbv7em-none-eabihf", "thumbv6m-none-eabi", "riscv32imac-unknown-none-elf"];

/// Programs, each with the Debian package that has it.
const PROGRAMS: [(&str, &str); 3] = [
    ("qemu-system-arm", "qemu-system-arm"),
    ("arm-none-eabi-objdump", "binutils-arm-none-eabi"),
    ("chromium", "chromium"),
];

/// Installs what is missing.
pub(crate) fn run() -> Result<()> {
    rust()?;
    programs()?;
    let (targets, programs) = (TARGETS.join(", "), PROGRAMS.map(|(program, _)| program).join(", "));
    println!("setup: rustfmt, clippy, {targets}, {programs} are there");
    Ok(())
}

fn rust() -> Result<()> {
    let components = output_of("rustup", &["component", "list", "--installed"]).unwrap_or_default();
    for component in ["rustfmt", "clippy"] {
        if !components.lines().any(|line| line.starts_with(component)) {
            Step::new(component, "rustup", "component add").with(component).run()?;
        }
    }
    let targets = output_of("rustup", &["target", "list", "--installed"]).unwrap_or_default();
    for target in TARGETS {
        if !targets.lines().any(|line| line == target) {
            Step::new(target, "rustup", "target add").with(target).run()?;
        }
    }
    Ok(())
}

fn is_there(program: &str) -> bool {
    match program {
        // It goes by several names.
        "chromium" => tests::browser::installed().is_some(),
        program => output_of(program, &["--version"]).is_some(),
    }
}

/// The emulator, the ARM binutils that disassemble what runs on it, and the
/// browser that reports are looked at with.
pub(crate) fn programs() -> Result<()> {
    let missing: Vec<_> = PROGRAMS
        .iter()
        .filter(|(program, _)| !is_there(program))
        .map(|(_, package)| *package)
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let packages = missing.join(" ");
    let is_root = output_of("id", &["-u"]).is_some_and(|id| id.trim() == "0");
    if !is_root || output_of("apt-get", &["--version"]).is_none() {
        bail!(
            "missing: {packages} (by their Debian names). Install them, for instance with \
             `sudo apt-get install {packages}`, then run this again"
        );
    }
    Step::new("package lists", "apt-get", "update").run()?;
    Step::new("packages", "apt-get", "install --yes --no-install-recommends")
        .with(&packages)
        .with_env("DEBIAN_FRONTEND", "noninteractive")
        .run()?;
    Ok(())
}
