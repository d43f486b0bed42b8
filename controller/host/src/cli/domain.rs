//! `controller domain`: what a program in another language needs to connect.

use std::fmt;
use std::io::{self, Write as _};
use std::path::PathBuf;

use leg_control::wire::WIRE_VERSION;
use serde::Serialize;

use super::{CliError, DomainArgs};
use crate::discovery::{Domain, DomainError, Session, holder};
use crate::link::Role;
use crate::shm::layout::{FLAGS, ServiceLayout, services};
use crate::shm::{SESSION_VERSION, socket_in};

/// Print the names, types and sizes that a program in another language needs to connect.
///
/// SESSION.md of the package leg-host says how. Nothing is created or changed.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    domain: DomainArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What is known of a domain, and what holds for all.
#[derive(Clone, Debug, Serialize)]
struct Report {
    domain: String,
    session_version: u16,
    wire_version: u16,
    /// Version of iceoryx2.
    iceoryx2: &'static str,
    folder: PathBuf,
    /// Where the controller listens for a leg.
    socket: PathBuf,
    /// What the names of shared memory start with; `None` while there is no folder.
    prefix: Option<String>,
    /// The session that takes place, or last took place.
    session: Option<Session>,
    leg: Holder,
    controller: Holder,
    services: [ServiceLayout; 2],
    flags: Vec<Flag>,
}

/// Who holds a role.
#[derive(Clone, Copy, Debug, Serialize)]
struct Holder {
    is_held: bool,
    pid: Option<u32>,
}

/// A flag of a header.
#[derive(Clone, Copy, Debug, Serialize)]
struct Flag {
    name: &'static str,
    bit: u32,
}

impl Report {
    fn of(name: &str) -> Result<Self, DomainError> {
        let folder = Domain::folder(name)?;
        let (prefix, session) = Domain::prefix_and_session(name)?.unzip();
        let held = |role| {
            let holder = holder(&folder, role).ok().flatten();
            Holder { is_held: holder.is_some(), pid: holder.and_then(|holder| holder.pid) }
        };
        Ok(Self {
            domain: name.to_owned(),
            session_version: SESSION_VERSION,
            wire_version: WIRE_VERSION,
            iceoryx2: "0.10",
            socket: socket_in(&folder),
            prefix,
            session: session.flatten(),
            leg: held(Role::Leg),
            controller: held(Role::Controller),
            services: services(),
            flags: FLAGS.map(|(name, flag)| Flag { name, bit: flag.trailing_zeros() }).to_vec(),
            folder,
        })
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { is_held: false, .. } => f.write_str("nobody"),
            Self { pid: Some(pid), .. } => write!(f, "process {pid}"),
            Self { pid: None, .. } => f.write_str("a process"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let row = |f: &mut fmt::Formatter<'_>, name: &str, value: &dyn fmt::Display| {
            writeln!(f, "{name:<12} {value}")
        };
        row(f, "domain", &self.domain)?;
        row(
            f,
            "versions",
            &format_args!(
                "session protocol {}, messages {}, iceoryx2 {}",
                self.session_version, self.wire_version, self.iceoryx2
            ),
        )?;
        row(f, "folder", &self.folder.display())?;
        row(f, "socket", &self.socket.display())?;
        row(f, "prefix", &self.prefix.as_deref().unwrap_or("none yet: nobody has joined"))?;
        match &self.session {
            None => row(f, "session", &"none")?,
            Some(session) => row(
                f,
                "session",
                &format_args!("prefix {}, root path {}", session.prefix, session.folder.display()),
            )?,
        }
        row(f, "leg", &self.leg)?;
        row(f, "controller", &self.controller)?;
        for service in &self.services {
            writeln!(
                f,
                "\n{}: {}, {} bytes, alignment {}, sent by the {}",
                service.name,
                service.payload_type,
                service.bytes,
                service.alignment,
                service.sender
            )?;
            for field in service.fields {
                writeln!(f, "  {:>3}  {:<9} {}", field.offset, field.kind, field.name)?;
            }
        }
        Ok(())
    }
}

/// Prints the report.
pub(super) fn run(args: &Args) -> Result<(), CliError> {
    let report = Report::of(args.domain.name())?;
    let _ = if args.json {
        writeln!(io::stdout(), "{}", serde_json::json!(report))
    } else {
        write!(io::stdout(), "{report}")
    };
    Ok(())
}
