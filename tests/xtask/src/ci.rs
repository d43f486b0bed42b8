//! `cargo xtask ci`: every check, the cheapest first.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use harness::checkout;
use requirements::Requirement;

use crate::step::Step;
use crate::{budget, chaos, examples, hil, image, setup};

/// Ticks of the shore scenario that the emulated board plays.
const HIL_TICKS: u64 = 10_000;

/// The firmware's own workspace.
const FIRMWARE: &str = "controller/firmware";

/// The packages that can be published, in the order of their dependencies.
const PACKAGES: &str = "package -p leg-kernel-m4f -p leg-control -p leg-plant";

/// Requirements that `cargo xtask setup` installs.
const INSTALLED: [Requirement; 6] = [
    Requirement::Qemu,
    Requirement::Gcc,
    Requirement::Gxx,
    Requirement::ArmGcc,
    Requirement::Python3,
    Requirement::Chromium,
];

fn checks() -> Vec<Step> {
    let cargo = |name, args| Step::new(name, "cargo", args);
    vec![
        cargo("format", "fmt --all --check"),
        cargo("format of the firmware", "fmt --check").within(FIRMWARE),
        cargo(
            "lints of leg-control on a Cortex-M4F",
            "clippy -p leg-control --all-features --target thumbv7em-none-eabihf -- -D warnings",
        ),
        cargo(
            "leg-control and leg-plant on a Cortex-M0",
            "check -p leg-control -p leg-plant --target thumbv6m-none-eabi",
        ),
        cargo(
            "leg-control on RISC-V",
            "check -p leg-control --target riscv32imac-unknown-none-elf",
        ),
        // All targets: this compiles the benches too.
        cargo("lints", "clippy --workspace --all-targets -- -D warnings"),
        cargo("lints of the firmware", "clippy --release --features minimal -- -D warnings")
            .within(FIRMWARE),
        cargo(
            "lints of the firmware for the STM32F405",
            "clippy --release --no-default-features --features stm32f405 -- -D warnings",
        )
        .within(FIRMWARE),
        cargo("documentation", "doc --workspace --no-deps").with_env("RUSTDOCFLAGS", "-D warnings"),
    ]
}

/// Runs every check; prints the skipped tests and the time of each step.
pub(crate) fn run() -> Result<()> {
    let mut times = Times::default();
    times.measure("setup", setup::run)?;
    for check in checks() {
        times.step(&check)?;
    }

    let skipped = checkout().join("target/skipped-tests.txt");
    clear(&skipped)?;
    let tests = Step::new("tests, doctests", "cargo", "test --workspace")
        .with_env("LEG_REQUIRE", required())
        .with_env("LEG_SKIPPED", skipped.display().to_string());
    times.step(&tests)?;
    times.measure("examples", examples::run)?;
    // Allowed to be dirty: a developer runs this before the commit.
    times.step(&Step::new("packages for crates.io", "cargo", PACKAGES).with("--allow-dirty"))?;
    times.step(&Step::new("the shore, release build", "cargo", "run --release -- --json"))?;
    times.measure("cargo xtask chaos --kills 20", || chaos::run(&chaos::Args::short()))?;
    times.measure("cargo xtask image", image::run)?;
    // The emulator's socket goes into the folder of temporary files.
    let minimal = Step::new(
        "the minimal firmware in the emulator",
        "cargo",
        "run --release --bin minimal --features minimal",
    );
    let temporary = checkout().join("target").canonicalize().context("no folder target")?;
    let minimal = minimal.within(FIRMWARE).with_env("TMPDIR", temporary.display().to_string());
    times.step(&minimal)?;
    times.measure("cargo xtask budget", || budget::run(&budget::Args::default()))?;
    let hil = hil::Args::emulated(HIL_TICKS);
    times.measure("cargo xtask hil --ticks 10000", || hil::run(&hil))?;

    println!("\nall passed");
    times.print();
    print_skipped(&skipped)
}

/// Returns the value of `LEG_REQUIRE`: what setup has installed, and what this machine
/// provides beside it.
fn required() -> String {
    let reference = requirements::reference_folder().is_dir().then_some(Requirement::Reference);
    let python = std::env::var_os("LEG_PYTHON").map(|_| Requirement::Python);
    let all = INSTALLED.into_iter().chain(reference).chain(python);
    all.map(Requirement::name).collect::<Vec<_>>().join(",")
}

fn clear(log: &Path) -> Result<()> {
    let folder: PathBuf = log.parent().context("the log has no folder")?.into();
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    fs::write(log, "").with_context(|| format!("cannot write {}", log.display()))
}

fn print_skipped(log: &Path) -> Result<()> {
    let text = fs::read_to_string(log).with_context(|| format!("cannot read {}", log.display()))?;
    println!("\n{} tests were skipped", text.lines().count());
    print!("{text}");
    Ok(())
}

/// How long each step took.
#[derive(Default)]
struct Times(Vec<(&'static str, Duration)>);

impl Times {
    fn step(&mut self, step: &Step) -> Result<()> {
        self.0.push((step.name, step.run()?));
        Ok(())
    }

    fn measure(&mut self, name: &'static str, run: impl FnOnce() -> Result<()>) -> Result<()> {
        println!("\n=== {name}");
        let start = Instant::now();
        run()?;
        self.0.push((name, start.elapsed()));
        Ok(())
    }

    fn print(&self) {
        let total: Duration = self.0.iter().map(|(_, time)| *time).sum();
        for (name, time) in self.0.iter().copied().chain([("in all", total)]) {
            println!("{:>7.1} s  {name}", time.as_secs_f64());
        }
    }
}
