//! `cargo xtask setup`: installs what the checks need beside cargo.

use crate::step::{Step, output_of};
use anyhow::{Result, bail};

/// Targets that the controller is built for: the Cortex-M4F and M7 of the
/// firmware, the smallest Cortex-M, and RISC-V.
const TARGETS: [&str; 3] =
    ["thumbv7em-none-eabihf", "thumbv6m-none-eabi", "riscv32imac-unknown-none-elf"];

/// A program: its possible names, and the Debian package that contains it.
struct Program {
    names: &'static [&'static str],
    package: &'static str,
}

/// The emulator, and the ARM binutils that disassemble images.
const EMULATION: [Program; 2] = [
    Program { names: &["qemu-system-arm"], package: "qemu-system-arm" },
    Program { names: &["arm-none-eabi-objdump"], package: "binutils-arm-none-eabi" },
];

/// The compilers for the exported policies, the Python for the bridge to it, and the browser
/// that lays out the report.
const TESTS: [Program; 5] = [
    Program { names: &["gcc"], package: "gcc" },
    Program { names: &["g++"], package: "g++" },
    Program { names: &["arm-none-eabi-gcc"], package: "gcc-arm-none-eabi" },
    Program { names: &["python3"], package: "python3" },
    Program { names: &requirements::CHROMIUM_NAMES, package: "chromium" },
];

/// Installs what is missing.
pub(crate) fn run() -> Result<()> {
    rust()?;
    let programs: Vec<&Program> = EMULATION.iter().chain(&TESTS).collect();
    install(&programs)?;
    let programs: Vec<&str> = programs.iter().map(|program| program.names[0]).collect();
    let (targets, programs) = (TARGETS.join(", "), programs.join(", "));
    println!("setup: rustfmt, clippy, {targets}, {programs} are installed");
    Ok(())
}

/// Installs what the emulated board needs, if it is missing.
pub(crate) fn emulation() -> Result<()> {
    install(&EMULATION.iter().collect::<Vec<_>>())
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

fn install(programs: &[&Program]) -> Result<()> {
    let is_there = |name: &&str| output_of(name, &["--version"]).is_some();
    let missing: Vec<&str> = programs
        .iter()
        .filter(|program| !program.names.iter().any(is_there))
        .map(|program| program.package)
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
