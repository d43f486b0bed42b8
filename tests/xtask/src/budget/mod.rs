//! `cargo xtask budget`: what the firmware costs, counted in the emulator.
//!
//! The bench images of `controller/firmware/src/bench` run the figures and compare
//! the kernels; QEMU logs every instruction ([`trace`]), objdump says what it was
//! ([`disassembly`]), a table what it costs ([`cost`]). Same image, same figures,
//! to the instruction.

mod cost;
mod disassembly;
mod emulator;
mod ledger;
mod profile;
mod size;
mod stack;
mod trace;

use anyhow::{Context, Result, ensure};
use harness::board::BOARDS;
use harness::root;
use ledger::{Ledger, Measured};
use profile::Profile;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The committed figures.
const LEDGER: &str = "controller/firmware/budgets.toml";
/// Measured in the image that lets the compiler use VMLA, which it takes to be slow
/// on a Cortex-M4: what the portable kernel is written for.
const PORTABLE: &str = "inference_without_tanh_portable";
const WITH_VMLA: &str = "-Ctarget-cpu=cortex-m4 -Ctarget-feature=-slowfpvmlx";
/// Figures of which the cycles are estimated, too, and the histogram is shown.
const WITH_CYCLES: [&str; 2] = ["inference_without_tanh", PORTABLE];

/// Instructions, cycles and bytes of the firmware, against the committed budgets.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Write what is measured into the file of budgets.
    #[arg(long)]
    accept: bool,
    /// Count the functions `figure_...` of another image, and compare them with nothing.
    #[arg(long, value_name = "ELF", conflicts_with = "accept")]
    image: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(image) = &args.image {
        for (figure, profile) in emulator::profiles(image)? {
            println!("{figure}\n{profile}\n");
        }
        return Ok(());
    }
    let images = Images::build(None)?;
    let with_vmla = Images::build(Some(WITH_VMLA))?;
    for image in [&images.compare, &with_vmla.compare] {
        emulator::run(image).context("the kernels differ, or could not be compared")?;
    }
    println!("kernels: the same bits from both, on 12,000 random networks and inputs\n");

    let mut profiles = emulator::profiles(&images.measure)?;
    profiles.extend(emulator::profiles(&with_vmla.measure)?.remove_entry(PORTABLE));
    for figure in WITH_CYCLES {
        let profile = profiles.get(figure).with_context(|| format!("{figure} is not measured"))?;
        println!("{figure}\n{profile}\n");
    }

    let mut measured = figures(&profiles);
    measured.extend(size::of(&BOARDS[0].build()?.path)?);
    measured.push(Measured {
        figure: "deepest stack".to_owned(),
        unit: "bytes",
        value: stack::deepest(BOARDS[0])?,
    });
    let path = root().join(LEDGER);
    let ledger = Ledger::read(&path)?;
    println!("{}", ledger.table(&measured));
    if args.accept {
        ledger.accept(&measured, &path)?;
        println!("\nwritten to {LEDGER}");
        return Ok(());
    }
    ledger.check(&measured)
}

fn figures(profiles: &BTreeMap<String, Profile>) -> Vec<Measured> {
    let mut figures = Vec::new();
    for (name, profile) in profiles {
        let mut push = |unit, value| {
            figures.push(Measured { figure: name.replace('_', " "), unit, value });
        };
        push("instructions", profile.instructions);
        if WITH_CYCLES.contains(&name.as_str()) {
            push("cycles", profile.cycles);
        }
    }
    figures
}

/// The bench images.
struct Images {
    measure: PathBuf,
    compare: PathBuf,
}

impl Images {
    /// Builds them as the firmware is built, or with other flags.
    fn build(flags: Option<&str>) -> Result<Self> {
        // A folder each: changing flags does not build anew.
        let target = root().join("target/firmware").join(flags.map_or("bench", |_| "bench-vmla"));
        let mut cargo = Command::new(env!("CARGO"));
        cargo
            .args(["build", "--quiet", "--release", "--features", "bench"])
            .args(["--bin", "measure", "--bin", "compare", "--target-dir"])
            .arg(&target)
            .current_dir(root().join("controller/firmware"))
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("RUSTFLAGS");
        if let Some(flags) = flags {
            cargo.env("RUSTFLAGS", flags);
        }
        let status = cargo.status().context("cannot start cargo")?;
        ensure!(status.success(), "the bench images do not build ({status})");
        let at = |name: &str| Path::new(&target).join("thumbv7em-none-eabihf/release").join(name);
        Ok(Self { measure: at("measure"), compare: at("compare") })
    }
}
