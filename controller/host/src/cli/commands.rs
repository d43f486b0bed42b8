//! The commands to a controller that runs: a process in a domain, or a board.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::status_text::{
    self, Table, Tick, digits, hex, identity_json, identity_text, slot_json, slot_text,
};
use super::target::{ConnectionError, TargetArgs};
use super::{hint, parse_timeout};
use crate::Role;
use crate::flash::MemoryFlash;
use crate::serial::upload::{Progress, roll_back, transfer, upload};
use crate::serial::{Client, ClientError, DeviceIdentity, VirtualBoard};
use crate::socket::{SocketError, SocketFile};
use crate::status::Status;
use leg_control::serial::message::{Activity, Request, RequestError, Slot};
use leg_process::policy_file::{PolicyFile, PolicyFileError};
use leg_process::stdout;
use leg_process::{Stop, remedy, stderr};

/// Time between two checks whether a swap is in force.
const LOOK: Duration = Duration::from_millis(10);

/// A command to a controller.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Command {
    /// Show which device a controller is, and what it runs.
    Identify(TargetArgs),
    /// Show the status of a controller.
    Status(TargetArgs),
    /// Have a controller run another policy, from the leg's next apex on: uploads it as `policy
    /// upload` does, waits for the apex, and prints the policy that ran before.
    Swap {
        /// The policy blob; it is checked before anything changes.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Which controller, and how long to wait for the apex.
        #[command(flatten)]
        target: TargetArgs,
    },
    /// Set the speed that a controller keeps, in place of that in the samples.
    SetPoint {
        /// The speed, m/s; without one, return to that in the samples.
        #[arg(value_name = "M_S", allow_negative_numbers = true)]
        m_s: Option<f32>,
        /// Which controller.
        #[command(flatten)]
        target: TargetArgs,
    },
    /// Show or change the policies of a controller.
    Policy {
        /// What to do.
        #[command(subcommand)]
        command: PolicyCommand,
    },
    /// Be a flashed controller without a board, behind a unix socket.
    VirtualBoard(VirtualBoardArgs),
}

/// What to do with the policies.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum PolicyCommand {
    /// Show the content of the two slots.
    List(TargetArgs),
    /// Upload a policy into the idle slot; it runs from the leg's next apex on. Prints slot,
    /// progress and times; `swap` does the same and prints the policy that ran before.
    Upload {
        /// The policy blob; it is checked before anything is sent.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Which controller.
        #[command(flatten)]
        target: TargetArgs,
        /// How long to wait for it to run.
        #[command(flatten)]
        wait: Wait,
    },
    /// Go back to the policy in the other slot, from the leg's next apex on.
    RollBack {
        /// Which controller.
        #[command(flatten)]
        target: TargetArgs,
        /// How long to wait for it to run.
        #[command(flatten)]
        wait: Wait,
    },
}

/// How long to wait for a swap.
#[derive(Clone, Debug, clap::Args)]
pub struct Wait {
    /// How long to wait for the apex at which it is swapped in, s.
    #[arg(long = "wait", value_name = "S", default_value = "10", value_parser = parse_timeout, allow_negative_numbers = true)]
    limit: Duration,
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

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The local file is no policy to run.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The local file is no policy to run; the policy of this name stays.
    #[error("{cause}; the policy {stays} stays")]
    PolicyStays {
        /// What is wrong with the file.
        cause: PolicyFileError,
        /// Name and checksum.
        stays: String,
    },
    /// There is no connection to the controller.
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    /// The controller does not answer, or refuses.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The socket to listen on cannot be bound.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The report of the process cannot be read.
    #[error("the status cannot be read ({0}); build both programs from the same release")]
    Report(#[from] serde_json::Error),
    /// The system refused.
    #[error("cannot {0}: {1}")]
    System(&'static str, io::Error),
}

impl CommandError {
    fn is_misuse(&self) -> bool {
        matches!(
            self,
            Self::Policy(_)
                | Self::PolicyStays { .. }
                | Self::Connection(ConnectionError::Domain(_))
                | Self::Client(ClientError::Refused(RequestError::SetPoint { .. }))
        ) || matches!(self, Self::Socket(SocketError::Io { cause, .. }) if remedy::is_wrong_path(cause))
    }
}

/// Carries a command out, reports, and returns the exit status.
#[must_use]
pub fn main(command: &Command) -> ExitCode {
    match run(command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let hint = match &error {
                CommandError::Connection(ConnectionError::Domain(cause)) => {
                    hint::domain_error(cause)
                }
                CommandError::Client(cause)
                | CommandError::Connection(ConnectionError::Client(cause)) => {
                    hint::client_error(cause)
                }
                _ => None,
            };
            stderr::print_line(format_args!(
                "{}: {}",
                Role::Controller,
                hint::with_hint(&error, hint)
            ));
            ExitCode::from(if error.is_misuse() { 2 } else { 1 })
        }
    }
}

fn run(command: &Command) -> Result<(), CommandError> {
    let stop =
        Stop::on_signals().map_err(|cause| CommandError::System("listen to signals", cause))?;
    match command {
        Command::Identify(target) => {
            let identity = target.connect(&stop)?.1;
            print(target, &identity_json(&identity), &identity_text(&identity))
        }
        Command::Status(target) => {
            let (mut client, identity) = target.connect(&stop)?;
            let (json, text) = status(&mut client, &identity)?;
            print(target, &json, &text)
        }
        Command::Swap { file, target } => swap(file, target, &stop),
        Command::SetPoint { m_s, target } => {
            let (mut client, _) = target.connect(&stop)?;
            client.have_done(&Request::SetPoint(*m_s))?;
            let text = m_s.map_or_else(
                || "the set-point is that of the samples".to_owned(),
                |m_s| format!("the set-point is {m_s} m/s, in place of that of the samples"),
            );
            print(target, &json!({ "set_point_m_s": m_s.and_then(digits) }), &text)
        }
        Command::Policy { command } => policy(command, &stop),
        Command::VirtualBoard(args) => virtual_board(args, &stop),
    }
}

/// Reads the report of a process; `None` from a board.
fn report(client: &mut Client) -> Result<Option<Status>, CommandError> {
    let report = client.report()?;
    Ok(report.map(|json| serde_json::from_slice(&json)).transpose()?)
}

fn status(client: &mut Client, identity: &DeviceIdentity) -> Result<(Value, String), CommandError> {
    if let Some(status) = report(client)? {
        let text = Table(&status).to_string();
        return Ok((serde_json::to_value(&status)?, text.trim_end().to_owned()));
    }
    let status = client.status()?;
    Ok(status_text::board(identity, &status, &client.slots()?))
}

fn swap(file: &std::path::Path, target: &TargetArgs, stop: &Stop) -> Result<(), CommandError> {
    let blob = PolicyFile::read(file)?;
    let connection = target.connect(stop);
    let policy = match (blob.policy(), &connection) {
        (Ok(policy), _) => policy,
        (Err(cause), Ok((_, DeviceIdentity { policy: Some(runs), .. }))) => {
            let stays = format!("{} ({})", runs.name, hex(runs.crc32));
            return Err(CommandError::PolicyStays { cause, stays });
        }
        (Err(cause), _) => return Err(cause.into()),
    };
    let (mut client, before) = connection?;
    let begun = Instant::now();
    let origin = file.display().to_string();
    transfer(&mut client, &policy, blob.as_slice(), &origin, target.timeout(), |_| ())?;
    let run = loop {
        let run = client.status()?.run;
        let waits = run.pending.is_some() && run.activity != Activity::Waiting;
        if !waits || begun.elapsed() >= target.timeout() {
            break run;
        }
        std::thread::sleep(LOOK);
    };
    let after = client.identify(target.timeout())?;
    if target.json {
        let (json, text) = status(&mut client, &after)?;
        return print(target, &json, &text);
    }
    let outcome = if run.pending.is_none() {
        let since = report(&mut client)?.and_then(|status| status.since);
        let at = since.map_or_else(String::new, |at| format!(" from {}", Tick(at)));
        let before = before.policy.map_or_else(
            || "none".to_owned(),
            |before| format!("{} ({})", before.name, hex(before.crc32)),
        );
        format!("runs{at}, instead of {before}")
    } else if run.activity == Activity::Waiting {
        "is taken, and runs as soon as a leg comes".to_owned()
    } else {
        let waited_s = begun.elapsed().as_secs_f64();
        format!("is taken, and still waits for an apex after {waited_s:.1} s")
    };
    let (name, crc32) = (policy.manifest().name, hex(policy.crc32()));
    print(target, &Value::Null, &format!("the policy {name} ({crc32}) {outcome}"))
}

fn policy(command: &PolicyCommand, stop: &Stop) -> Result<(), CommandError> {
    match command {
        PolicyCommand::List(target) => {
            let (mut client, _) = target.connect(stop)?;
            let slots = client.slots()?;
            let rows = || Slot::ALL.into_iter().zip(&slots);
            let json: Vec<_> = rows().map(|(name, slot)| slot_json(name, slot)).collect();
            let text: Vec<_> = rows().map(|(name, slot)| slot_text(name, slot)).collect();
            print(target, &json!({ "slots": json }), &text.join("\n"))?;
        }
        PolicyCommand::Upload { file, target, wait } => {
            // First of all: a bad file is never begun with.
            let blob = PolicyFile::read(file)?;
            let policy = blob.policy()?;
            let (mut client, _) = target.connect(stop)?;
            let shows = !target.json && io::stderr().is_terminal();
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
                wait.limit,
                show,
            )?;
            let (name, crc32) = (policy.manifest().name, policy.crc32());
            let (bytes, slot) = (blob.as_slice().len(), done.slot);
            let took_s = done.took.as_secs_f64();
            let json = json!({
                "name": name,
                "crc32": hex(crc32),
                "slot": slot.to_string(),
                "bytes": bytes,
                "upload_s": took_s,
                "swapped_after_s": done.swapped_after.map(|after| after.as_secs_f64()),
            });
            let text = format!(
                "policy {name} ({}) in slot {}: {bytes} bytes in {took_s:.2} s; {}",
                hex(crc32),
                slot,
                swapped(done.swapped_after)
            );
            print(target, &json, &text)?;
        }
        PolicyCommand::RollBack { target, wait } => {
            let (mut client, _) = target.connect(stop)?;
            let (slot, after) = roll_back(&mut client, wait.limit)?;
            let slots = client.slots()?;
            let policy = slots[slot as usize].content.ok();
            let (name, crc32) = policy.unwrap_or_default();
            let json = json!({
                "name": name,
                "crc32": hex(crc32),
                "slot": slot.to_string(),
                "swapped_after_s": after.map(|after| after.as_secs_f64()),
            });
            let text = format!(
                "back to policy {name} ({}) in slot {}; {}",
                hex(crc32),
                slot,
                swapped(after)
            );
            print(target, &json, &text)?;
        }
    }
    Ok(())
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
    stderr::print_line(format_args!(
        "a virtual board behind {}; end it by Ctrl-C",
        args.unix.display()
    ));
    board
        .listen(&listener, || !stop.is_raised())
        .map_err(|cause| CommandError::System("listen", cause))
}

fn print(target: &TargetArgs, json: &Value, text: &str) -> Result<(), CommandError> {
    let printed = if target.json { stdout::print_line(json) } else { stdout::print_line(text) };
    printed.map_err(|cause| CommandError::System("print the result", cause))
}

/// Shows the progress of an upload on the standard error, in place of the last one.
fn show(progress: Progress) {
    let mut to = io::stderr();
    // An error, for example of a closed terminal, is ignored.
    let _ = match progress {
        Progress::Sent(sent, all) => write!(to, "\r{sent} of {all} bytes"),
        Progress::Checking => write!(to, "\r\x1b[Kchecking"),
        Progress::Committed => write!(to, "\r\x1b[Kwaiting for the apex\r\x1b[K"),
    };
    let _ = to.flush();
}

fn swapped(after: Option<Duration>) -> String {
    after.map_or_else(
        || "it waits for the leg's next apex, and is the one to run after a power-up".into(),
        |after| format!("it runs, {:.2} s after the commit", after.as_secs_f64()),
    )
}
