//! `cargo xtask flash`: writes the firmware and a policy to a real board with probe-rs.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};
use harness::board::{BOARDS, Board};

use crate::Misuse;
use crate::step::output_of;

/// Flash the firmware, and a policy into slot A, with probe-rs.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Board at the probe.
    #[arg(long, value_name = "BOARD", value_parser = Board::named)]
    board: Board,
    /// Policy for slot A [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let board = args.board;
    let Some(chip) = board.chip else {
        let real = BOARDS.iter().filter(|board| board.chip.is_some());
        let names: Vec<_> = real.map(|board| board.name).collect();
        return Err(Misuse::of(format!(
            "{} is an emulated board and cannot be flashed: `cargo run --release` in \
             controller/firmware starts it. Real boards: {}",
            board.name,
            names.join(", ")
        )));
    };
    if output_of("probe-rs", &["--version"]).is_none() {
        bail!(
            "probe-rs is not installed: `cargo install probe-rs-tools --locked` builds it (see \
             its documentation for the udev rules that let a user open a probe)"
        );
    }
    let probes = output_of("probe-rs", &["list"]).unwrap_or_default();
    if probes.contains("No debug probes were found") || probes.trim().is_empty() {
        bail!(
            "probe-rs finds no probe: is it plugged in, and may this user open it? \
             `probe-rs list` shows what it sees"
        );
    }
    let image = board.build()?;
    let policy = args
        .policy
        .clone()
        .unwrap_or_else(|| harness::checkout().join("controller/policies/robust.bin"));
    if !policy.is_file() {
        return Err(Misuse::of(format!("no policy at {}; --policy names one", policy.display())));
    }
    let slot = image.symbol("__slot_a")?;
    probe_rs(Command::new("probe-rs").args(["download", "--chip", chip]).arg(&image.path))?;
    probe_rs(
        Command::new("probe-rs")
            .args(["download", "--chip", chip, "--binary-format", "bin"])
            .args(["--base-address", &format!("{slot:#x}")])
            .arg(&policy),
    )?;
    probe_rs(Command::new("probe-rs").args(["reset", "--chip", chip]))?;
    println!(
        "{} runs with {} in slot A; check it with `controller identify --serial PORT`",
        board.name,
        policy.display()
    );
    Ok(())
}

fn probe_rs(command: &mut Command) -> Result<()> {
    println!("{command:?}");
    let status = command.status().context("cannot start probe-rs")?;
    if !status.success() {
        bail!("probe-rs ended with {status}; its message is above");
    }
    Ok(())
}
