//! What the `controller` program does with a flashed controller.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use serde_json::{Value, json};

use super::client::{Client, ClientError, HELLO_PATIENCE};
use super::identity::{DeviceIdentity, PolicyIdentity};
use super::stream::{EndpointArgs, OpenError};
use super::upload::{Progress, roll_back, upload};
use super::virtual_board::VirtualBoard;
use crate::Role;
use crate::cli::parse_timeout;
use crate::flash::MemoryFlash;
use crate::socket::{SocketError, SocketFile};
use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::message::{Mode, Slot, SlotReport};
use leg_process::Stop;
use leg_process::policy_file::{PolicyFile, PolicyFileError};
use leg_process::stdout;

/// A command to a flashed controller.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Command {
    /// Ask a flashed controller who it is.
    Identify(Line),
    /// See or change the policies in a flashed controller.
    Policy {
        /// Which of it.
        #[command(subcommand)]
        command: PolicyCommand,
    },
    /// Be a flashed controller without a board, behind a unix socket.
    VirtualBoard(VirtualBoardArgs),
}

/// What to do with the policies.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum PolicyCommand {
    /// Show what lies in the two slots.
    List(Line),
    /// Bring a policy into the idle slot; it runs from the leg's next apex on.
    Upload {
        /// The policy blob; it is checked before anything is sent.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Where, and how to report.
        #[command(flatten)]
        line: Line,
        /// How long to wait for it to run.
        #[command(flatten)]
        wait: Wait,
    },
    /// Go back to the policy in the other slot, from the leg's next apex on.
    RollBack {
        /// Where, and how to report.
        #[command(flatten)]
        line: Line,
        /// How long to wait for it to run.
        #[command(flatten)]
        wait: Wait,
    },
}

/// Where the controller is, and how to report.
#[derive(Clone, Debug, clap::Args)]
pub struct Line {
    /// Where.
    #[command(flatten)]
    pub endpoint: EndpointArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// How long to wait for a swap.
#[derive(Clone, Debug, clap::Args)]
pub struct Wait {
    /// How long to wait for the apex at which it is swapped in, s.
    #[arg(long = "wait", value_name = "S", default_value = "10", value_parser = parse_timeout, allow_negative_numbers = true)]
    patience: Duration,
}

/// What the virtual board is made of.
#[derive(Clone, Debug, clap::Args)]
pub struct VirtualBoardArgs {
    /// The socket to listen on; one caller at a time.
    #[arg(long, value_name = "PATH")]
    unix: PathBuf,
    /// The policy in its slot A [default: the shipped one].
    #[arg(long, value_name = "FILE", conflicts_with = "empty")]
    policy: Option<PathBuf>,
    /// Leave both slots empty.
    #[arg(long)]
    empty: bool,
}

/// Why a command came to nothing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The local file is no policy to run.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The line could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The controller could not be talked to, or would not.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The socket to listen on cannot be had.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The system refused.
    #[error("cannot {0}: {1}")]
    System(&'static str, io::Error),
}

/// Carries a command out, reports, and gives the exit status.
#[must_use]
pub fn main(command: &Command) -> ExitCode {
    match run(command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", Role::Controller);
            ExitCode::from(if matches!(error, CommandError::Policy(_)) { 2 } else { 1 })
        }
    }
}

fn run(command: &Command) -> Result<(), CommandError> {
    let stop =
        Stop::on_signals().map_err(|cause| CommandError::System("listen to signals", cause))?;
    match command {
        Command::Identify(line) => {
            let who = connect(line, &stop)?.1;
            print(line, &who_json(&who), &who_text(&who))?;
        }
        Command::Policy { command } => policy(command, &stop)?,
        Command::VirtualBoard(args) => virtual_board(args, &stop)?,
    }
    Ok(())
}

fn policy(command: &PolicyCommand, stop: &Stop) -> Result<(), CommandError> {
    match command {
        PolicyCommand::List(line) => {
            let (mut client, _) = connect(line, stop)?;
            let slots = client.slots()?;
            let rows = || Slot::ALL.into_iter().zip(&slots);
            let json: Vec<_> = rows().map(|(name, slot)| slot_json(name, slot)).collect();
            let text: Vec<_> = rows().map(|(name, slot)| slot_text(name, slot)).collect();
            print(line, &json!({ "slots": json }), &text.join("\n"))?;
        }
        PolicyCommand::Upload { file, line, wait } => {
            // First of all: a bad file is never begun with.
            let blob = PolicyFile::read(file)?;
            let policy = blob.policy()?;
            let (mut client, _) = connect(line, stop)?;
            let shows = !line.json && io::stderr().is_terminal();
            let show = |progress| {
                if shows {
                    show(progress);
                }
            };
            let done = upload(
                &mut client,
                &policy,
                blob.as_slice(),
                &file.display().to_string(),
                wait.patience,
                show,
            )?;
            let (name, crc32) = (policy.manifest().name, policy.crc32());
            let (bytes, slot) = (blob.as_slice().len(), done.slot);
            let took_s = done.took.as_secs_f64();
            let json = json!({
                "name": name,
                "crc32": hex(crc32),
                "slot": slot_name(slot),
                "bytes": bytes,
                "upload_s": took_s,
                "swapped_after_s": done.swapped_after.map(|after| after.as_secs_f64()),
            });
            let text = format!(
                "policy {name} ({}) in slot {}: {bytes} bytes in {took_s:.2} s; {}",
                hex(crc32),
                slot_name(slot),
                swapped(done.swapped_after)
            );
            print(line, &json, &text)?;
        }
        PolicyCommand::RollBack { line, wait } => {
            let (mut client, _) = connect(line, stop)?;
            let (slot, after) = roll_back(&mut client, wait.patience)?;
            let slots = client.slots()?;
            let policy = slots[slot as usize].content.ok();
            let (name, crc32) = policy.unwrap_or_default();
            let json = json!({
                "name": name,
                "crc32": hex(crc32),
                "slot": slot_name(slot),
                "swapped_after_s": after.map(|after| after.as_secs_f64()),
            });
            let text = format!(
                "back to policy {name} ({}) in slot {}; {}",
                hex(crc32),
                slot_name(slot),
                swapped(after)
            );
            print(line, &json, &text)?;
        }
    }
    Ok(())
}

fn connect(line: &Line, stop: &Stop) -> Result<(Client, DeviceIdentity), CommandError> {
    let mut client = Client::new(line.endpoint.endpoint().open()?, stop);
    let who = client.identify(HELLO_PATIENCE)?;
    Ok((client, who))
}

fn virtual_board(args: &VirtualBoardArgs, stop: &Stop) -> Result<(), CommandError> {
    let mut flash = MemoryFlash::new();
    if !args.empty {
        let blob = PolicyFile::load(args.policy.as_deref())?;
        blob.policy()?;
        flash = flash.loaded(Slot::A, blob.as_slice());
    }
    let (_file, listener) = SocketFile::bind(&args.unix)?;
    let mut board = VirtualBoard::power_up(flash);
    eprintln!("a virtual board behind {}; end it by Ctrl-C", args.unix.display());
    board
        .listen(&listener, || !stop.is_raised())
        .map_err(|cause| CommandError::System("listen", cause))
}

fn print(line: &Line, json: &Value, text: &str) -> Result<(), CommandError> {
    let printed = if line.json { stdout::print_line(json) } else { stdout::print_line(text) };
    printed.map_err(|cause| CommandError::System("print the result", cause))
}

fn show(progress: Progress) {
    match progress {
        Progress::Sent(sent, all) => eprint!("\r{sent} of {all} bytes"),
        Progress::Checking => eprint!("\r\x1b[Kchecking"),
        Progress::Committed => eprint!("\r\x1b[Kwaiting for the apex\r\x1b[K"),
    }
    let _ = io::stderr().flush();
}

fn swapped(after: Option<Duration>) -> String {
    after.map_or_else(
        || "it waits for the leg's next apex, and is the one to run after a power-up".into(),
        |after| format!("it runs, {:.2} s after the commit", after.as_secs_f64()),
    )
}

fn hex(value: u32) -> String {
    format!("{value:08x}")
}

/// The number with the fewest digits that is this float.
fn digits(value: f32) -> Option<f64> {
    value.to_string().parse().ok()
}

/// A slot's name.
#[must_use]
pub fn slot_name(slot: Slot) -> &'static str {
    match slot {
        Slot::A => "A",
        Slot::B => "B",
    }
}

/// A mode's name.
#[must_use]
pub fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Idle => "idle",
        Mode::LockStep => "lock-step",
        Mode::Live => "live",
    }
}

fn who_json(who: &DeviceIdentity) -> Value {
    let policy = who.policy.as_ref().map(|PolicyIdentity { slot, name, crc32, leg }| {
        json!({ "slot": slot_name(*slot), "name": name, "crc32": hex(*crc32), "leg": hex(*leg) })
    });
    json!({
        "board": who.board,
        "firmware": who.firmware,
        "protocol_version": PROTOCOL_VERSION,
        "wire_version": who.wire_version,
        "session": who.session,
        "mode": mode_name(who.mode),
        "rate_hz": who.rate_hz,
        "gravity_m_s2": digits(who.gravity_m_s2),
        "policy": policy,
    })
}

fn who_text(who: &DeviceIdentity) -> String {
    let policy = who.policy.as_ref().map_or_else(
        || "none; the leg stays in the safe command".into(),
        |PolicyIdentity { slot, name, crc32, .. }| {
            format!("{name} ({}) in slot {}", hex(*crc32), slot_name(*slot))
        },
    );
    let session = who.session.map_or_else(|| "none since power-up".into(), hex);
    format!(
        "board     {}, firmware {} (protocol {PROTOCOL_VERSION}, messages {})\n\
         policy    {policy}\n\
         run       {}, {} Hz, {} m/s2; session {session}",
        who.board,
        who.firmware,
        who.wire_version,
        mode_name(who.mode),
        who.rate_hz,
        who.gravity_m_s2,
    )
}

fn slot_json(name: Slot, slot: &SlotReport<'_>) -> Value {
    let mut json = json!({
        "slot": slot_name(name),
        "sequence": slot.sequence,
        "running": slot.running,
    });
    match slot.content {
        Ok((policy, crc32)) => {
            json["name"] = policy.into();
            json["crc32"] = hex(crc32).into();
        }
        Err(fault) => json["fault"] = fault.to_string().into(),
    }
    json
}

fn slot_text(name: Slot, slot: &SlotReport<'_>) -> String {
    let content = match slot.content {
        Ok((policy, crc32)) => format!("{policy} ({})", hex(crc32)),
        Err(fault) => fault.to_string(),
    };
    let runs = if slot.running { ", runs" } else { "" };
    format!("slot {}    {content}, sequence {}{runs}", slot_name(name), slot.sequence)
}
