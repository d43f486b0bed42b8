//! `cargo xtask ci`: every check.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use harness::{checkout, firmware};
use requirements::Requirement;

use crate::step::Step;
use crate::{chaos, examples, lanes, setup};

/// Ticks of the shore scenario that the emulated board plays.
const HIL_TICKS: u64 = 4_000;

/// The packages that can be published, in the order of their dependencies.
const PACKAGES: &str = "package -p leg-kernel-m4f -p leg-control -p leg-plant";

/// Requirements that `cargo xtask setup` installs.
const INSTALLED: [Requirement; 7] = [
    Requirement::Qemu,
    Requirement::Gcc,
    Requirement::Gxx,
    Requirement::Clang,
    Requirement::ArmGcc,
    Requirement::Python,
    Requirement::Chromium,
];

/// The steps in the order of their cost: lints, documentation, tests. What an incremental
/// compilation stores costs more than it saves where everything is compiled.
fn in_front(skipped: &Path) -> Vec<Step> {
    let cargo = |name, args| Step::new(name, "cargo", args).with_env("CARGO_INCREMENTAL", "0");
    vec![
        cargo("format", "fmt --all --check"),
        cargo("format of the firmware", "fmt --check").within(firmware::FOLDER),
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
        cargo("documentation", "doc --workspace --no-deps").with_env("RUSTDOCFLAGS", "-D warnings"),
        cargo("tests, doctests", "test --workspace --no-fail-fast")
            .with_env("LEG_REQUIRE", required())
            .with_env("LEG_PYTHON", setup::python().display().to_string())
            .with_env("LEG_SKIPPED", skipped.display().to_string()),
        // Allowed to be dirty: a developer runs this before the commit.
        cargo("packages for crates.io", PACKAGES).with("--allow-dirty"),
    ]
}

/// The steps of the firmware that the tests do not need; they build into a folder of their own.
fn of_firmware(xtask: &str, temporary: &Path) -> Vec<Step> {
    let target = firmware::target_folder().display().to_string();
    let cargo = |name, args| {
        let step = Step::new(name, "cargo", args).within(firmware::FOLDER);
        step.with_env("CARGO_TARGET_DIR", target.clone())
    };
    vec![
        cargo("lints of the firmware", "clippy --release --features minimal -- -D warnings"),
        cargo(
            "lints of the firmware for the STM32F405",
            "clippy --release --no-default-features --features stm32f405 -- -D warnings",
        ),
        Step::new("firmware without a panic", xtask, "image"),
        // The emulator's socket goes into the folder of temporary files.
        cargo(
            "the minimal firmware in the emulator",
            "run --release --bin minimal --features minimal",
        )
        .with_env("TMPDIR", temporary.display().to_string()),
        Step::new("budgets of the firmware", xtask, "budget"),
        Step::new("cost of a policy on a Cortex-M4F", xtask, "budget --policy")
            .with("controller/policies/robust.bin"),
    ]
}

/// The steps that need the release build, which has a folder of its own too.
fn of_release(xtask: &str) -> Vec<Step> {
    vec![
        Step::new("the shore, release build", "cargo", "run --release -- --json"),
        Step::new("hardware in the loop", xtask, "hil").with(&format!("--ticks {HIL_TICKS}")),
        Step::new("hardware in the loop with raw sensors", xtask, "hil --sensors imu")
            .with(&format!("--ticks {HIL_TICKS}")),
    ]
}

/// Runs every check; prints the skipped tests and the time of each step.
pub(crate) fn run() -> Result<()> {
    let begun = Instant::now();
    println!("\n=== setup");
    setup::run()?;
    let mut times = vec![("setup", begun.elapsed())];

    let target = checkout().join("target");
    fs::create_dir_all(&target).with_context(|| format!("cannot create {}", target.display()))?;
    let target = target.canonicalize().context("no folder target")?;
    let skipped = target.join("skipped-tests.txt");
    fs::write(&skipped, "").with_context(|| format!("cannot write {}", skipped.display()))?;
    // `cargo test` replaces the file of this program; those beside the tests start a copy.
    let folder = tempfile::tempdir_in(&target).context("cannot create a temporary folder")?;
    let xtask = folder.path().join("xtask");
    let this = std::env::current_exe().context("no path of this program")?;
    fs::copy(&this, &xtask).with_context(|| format!("cannot copy {}", this.display()))?;
    let xtask = xtask.to_str().context("the path of this repository is not UTF-8")?;

    let beside = [of_firmware(xtask, &target), of_release(xtask)];
    times.extend(lanes::run(&in_front(&skipped), &beside)?);
    // The processes of these run in real time, so nothing runs beside them.
    let mut measure = |name, run: &dyn Fn() -> Result<()>| {
        println!("\n=== {name}");
        let begun = Instant::now();
        run()?;
        times.push((name, begun.elapsed()));
        anyhow::Ok(())
    };
    measure("examples", &examples::run)?;
    measure("cargo xtask chaos --kills 20", &|| chaos::run(&chaos::Args::short()))?;

    println!("\nall passed");
    times.push(("in all, some at the same time", begun.elapsed()));
    for (name, time) in times {
        println!("{:>7.1} s  {name}", time.as_secs_f64());
    }
    print_skipped(&skipped)
}

/// Returns the value of `LEG_REQUIRE`: what setup has installed, and what this machine
/// provides beside it.
fn required() -> String {
    let reference = requirements::reference_folder().is_dir().then_some(Requirement::Reference);
    let all = INSTALLED.into_iter().chain(reference);
    all.map(Requirement::name).collect::<Vec<_>>().join(",")
}

fn print_skipped(log: &Path) -> Result<()> {
    let text = fs::read_to_string(log).with_context(|| format!("cannot read {}", log.display()))?;
    println!("\n{} tests were skipped", text.lines().count());
    print!("{text}");
    Ok(())
}
