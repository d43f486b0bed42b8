//! `cargo xtask budget`: instructions, flash, RAM and stack of the firmware, measured in
//! the emulator.
//!
//! The bench images of `controller/firmware/src/bench` run the control law and compare
//! the kernels; QEMU logs every instruction ([`trace`]), objdump disassembles it
//! ([`disassembly`]), and a table estimates its cycles ([`cost`]). The same image gives the
//! same counts, to the instruction.

mod budgets;
mod cost;
mod disassembly;
mod emulator;
mod policy;
mod profile;
mod size;
mod stack;
mod trace;

use anyhow::{Context, Result};
use budgets::{Budgets, Measured};
use harness::board::BOARDS;
use harness::checkout;
use harness::firmware::Build;
use profile::Profile;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The committed budgets.
const BUDGETS: &str = "controller/firmware/budgets.toml";
/// The portable kernel, measured in the image that lets the compiler use VMLA, as it is
/// written for; by default LLVM takes VMLA to be slow on a Cortex-M4.
const PORTABLE: &str = "inference_without_tanh_portable";
const WITH_VMLA: &str = "-Ctarget-cpu=cortex-m4 -Ctarget-feature=-slowfpvmlx";
/// Functions whose cycles are estimated and whose histograms are printed.
const WITH_CYCLES: [&str; 2] = ["inference_without_tanh", PORTABLE];

/// Measure instructions, cycles and bytes of the firmware against the committed budgets.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Write the measured values into the file of budgets.
    #[arg(long)]
    accept: bool,
    /// Count the functions `measured_...` of another image, without a comparison.
    #[arg(long, value_name = "ELF", conflicts_with = "accept")]
    image: Option<PathBuf>,
    /// Count an inference of this policy, without a comparison.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["accept", "image"])]
    policy: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(image) = &args.image {
        for (function, profile) in emulator::profiles(image)? {
            println!("{function}\n{profile}\n");
        }
        return Ok(());
    }
    if let Some(policy) = &args.policy {
        return policy::print(policy);
    }
    let images = Images::build(None)?;
    let with_vmla = Images::build(Some(WITH_VMLA))?;
    for image in [&images.compare, &with_vmla.compare] {
        emulator::run(image).context("the assembly gives other bits, or could not be compared")?;
    }
    println!(
        "assembly: the same bits as the portable kernel on 12,000 random networks and inputs, and \
         as libm on a million square roots\n"
    );

    let mut profiles = emulator::profiles(&images.measure)?;
    profiles.extend(emulator::profiles(&with_vmla.measure)?.remove_entry(PORTABLE));
    for function in WITH_CYCLES {
        let profile =
            profiles.get(function).with_context(|| format!("{function} is not measured"))?;
        println!("{function}\n{profile}\n");
    }

    let mut measured = counts(&profiles);
    for (features, with) in [("", ""), (stack::ESTIMATOR, " with the estimator")] {
        let [flash, ram] = size::of(&BOARDS[0].build_with(features)?.path)?;
        let value = stack::deepest(BOARDS[0], features)?;
        let stack = Measured { metric: "deepest stack".to_owned(), unit: "bytes", value };
        measured.extend(
            [flash, ram, stack]
                .map(|one| Measured { metric: format!("{}{with}", one.metric), ..one }),
        );
    }
    let path = checkout().join(BUDGETS);
    let budgets = Budgets::read(&path)?;
    println!("{}", budgets.table(&measured));
    if args.accept {
        budgets.accept(&measured, &path)?;
        println!("\nwritten to {BUDGETS}");
        return Ok(());
    }
    budgets.check(&measured)
}

/// Returns the counts of each function, with the estimated cycles where they are compared.
fn counts(profiles: &BTreeMap<String, Profile>) -> Vec<Measured> {
    let mut counts = Vec::new();
    for (name, profile) in profiles {
        let mut push = |unit, value| {
            counts.push(Measured { metric: name.replace('_', " "), unit, value });
        };
        push("instructions", profile.instructions);
        if WITH_CYCLES.contains(&name.as_str()) {
            push("cycles", profile.cycles);
        }
    }
    counts
}

/// The bench images.
struct Images {
    measure: PathBuf,
    compare: PathBuf,
}

impl Images {
    /// Builds the images with the flags of the firmware, or with other ones.
    fn build(flags: Option<&str>) -> Result<Self> {
        let folder = Build {
            name: flags.map_or("bench", |_| "bench-vmla"),
            features: "mps2-an386,bench",
            programs: &["measure", "compare"],
            flags,
            policy: None,
        }
        .run()?;
        let at = |name: &str| folder.join(name);
        Ok(Self { measure: at("measure"), compare: at("compare") })
    }
}
