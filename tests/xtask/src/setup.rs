//! `cargo xtask setup`: installs what the checks need beside cargo.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use harness::checkout;

use crate::step::{Step, output_of};

/// Targets that the controller is built for: the Cortex-M4F and M7 of the
/// firmware, the smallest Cortex-M, and RISC-V.
const TARGETS: [&str; 3] =
    ["thumbv7em-none-eabihf", "thumbv6m-none-eabi", "riscv32imac-unknown-none-elf"];

/// A program: its possible names, the arguments with which it succeeds if it is complete, and
/// the Debian package that contains it.
struct Program {
    names: &'static [&'static str],
    probe: &'static [&'static str],
    package: &'static str,
}

const fn program(names: &'static [&'static str], package: &'static str) -> Program {
    Program { names, probe: &["--version"], package }
}

/// The emulator, and the ARM binutils that disassemble images.
const EMULATION: [Program; 2] = [
    program(&["qemu-system-arm"], "qemu-system-arm"),
    program(&["arm-none-eabi-objdump"], "binutils-arm-none-eabi"),
];

/// The compilers for the exported policies, the Python for the bridge to it, and the browser
/// that lays out the report.
const TESTS: [Program; 7] = [
    program(&["gcc"], "gcc"),
    program(&["g++"], "g++"),
    program(&["clang"], "clang"),
    program(&["arm-none-eabi-gcc"], "gcc-arm-none-eabi"),
    program(&["python3"], "python3"),
    // Debian's python3 makes no virtual environment without it.
    Program {
        names: &["python3"],
        probe: &["-m", "ensurepip", "--version"],
        package: "python3-venv",
    },
    program(&requirements::CHROMIUM_NAMES, "chromium"),
];

/// Folder of the virtual environment, below the checkout.
const ENVIRONMENT: &str = "target/python";

/// Its packages with their versions.
const REQUIREMENTS: &str = "tests/requirements.txt";

/// Installs what is missing.
pub(crate) fn run() -> Result<()> {
    rust()?;
    let programs: Vec<&Program> = EMULATION.iter().chain(&TESTS).collect();
    install(&programs)?;
    environment()?;
    let packages: Vec<&str> = programs.iter().map(|program| program.package).collect();
    let (targets, packages) = (TARGETS.join(", "), packages.join(", "));
    println!(
        "setup: rustfmt, clippy, {targets}, {packages} and the packages of {REQUIREMENTS} \
         are installed"
    );
    Ok(())
}

/// Returns the interpreter with the packages of `tests/requirements.txt`.
pub(crate) fn python() -> PathBuf {
    checkout().join(ENVIRONMENT).join("bin/python")
}

/// Makes the virtual environment anew unless it has the packages that are wanted.
fn environment() -> Result<()> {
    let wanted = checkout().join(REQUIREMENTS);
    let wanted =
        fs::read_to_string(&wanted).with_context(|| format!("cannot read {}", wanted.display()))?;
    let folder = checkout().join(ENVIRONMENT);
    // Written last, so that an interrupted installation is begun again.
    let mark = folder.join("requirements.txt");
    if fs::read_to_string(&mark).is_ok_and(|installed| installed == wanted) {
        return Ok(());
    }
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            return Err(error).with_context(|| format!("cannot remove {}", folder.display()));
        }
        _ => (),
    }
    Step::new("virtual environment", "python3", "-m venv").with(ENVIRONMENT).run()?;
    Step::new("Python packages", python().display().to_string(), "-m pip install --quiet")
        .with("--disable-pip-version-check --requirement")
        .with(REQUIREMENTS)
        .run()?;
    fs::write(&mark, wanted).with_context(|| format!("cannot write {}", mark.display()))
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
    let is_there = |program: &Program| {
        program.names.iter().any(|name| output_of(name, program.probe).is_some())
    };
    let missing: Vec<&str> = programs
        .iter()
        .filter(|program| !is_there(program))
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
