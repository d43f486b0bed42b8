//! The lock on a role in a domain, and the record that its holder publishes.
//!
//! Each role has a file in the domain's folder, locked by the process that holds
//! the role. The lock excludes a second holder and distinguishes a live holder
//! from a dead one; the text of the file publishes the holder's session parameters
//! before the first message. A process that ends in good order removes its file; a
//! killed one leaves the file behind, unlocked.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::domain::{Domain, still_named};
use crate::link::{Role, SessionParams, TimeMode};

/// Names of the time modes in a record.
const TIME_MODES: [(TimeMode, &str); 2] =
    [(TimeMode::LockStep, "lock-step"), (TimeMode::RealTime, "real-time")];

/// What the holder of a role publishes about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RoleRecord {
    /// Process id of the holder.
    pub(crate) pid: u32,
    pub(crate) params: SessionParams,
    /// Process id of the peer whose ports the holder has found: it will receive that
    /// peer's messages.
    pub(crate) connected_to: Option<u32>,
    /// Process id of the peer whose session parameters the holder has rejected.
    pub(crate) rejected: Option<u32>,
}

impl RoleRecord {
    fn text(self) -> String {
        let SessionParams { wire_version, rate_hz, gravity_m_s2, leg, time_mode } = self.params;
        let leg = leg.map_or_else(String::new, |leg| format!("leg {leg:08x}\n"));
        let time_mode = TIME_MODES
            .into_iter()
            .find(|(mode, _)| Some(*mode) == time_mode)
            .map_or_else(String::new, |(_, name)| format!("pace {name}\n"));
        // A float is written with the digits needed to read the same bits back. Gravity comes
        // last: its line marks the record as complete.
        format!(
            "pid {}\nwire {wire_version}\nrate_hz {rate_hz}\n{leg}{time_mode}gravity_m_s2 {gravity_m_s2}\n",
            self.pid
        )
    }

    /// Parses a record; `None` while it is incomplete, or if its format is unknown.
    fn parse(text: &str) -> Option<Self> {
        // Use complete lines only, since the last may be in the middle of a write. Of lines
        // with the same name the last one counts.
        let lines = || text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'));
        let field = |name: &str| {
            lines().filter_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).next_back()
        };
        Some(Self {
            pid: field("pid")?.parse().ok()?,
            params: SessionParams {
                wire_version: field("wire")?.parse().ok()?,
                rate_hz: field("rate_hz")?.parse().ok()?,
                gravity_m_s2: field("gravity_m_s2")?.parse().ok()?,
                leg: field("leg").and_then(|leg| u32::from_str_radix(leg, 16).ok()),
                time_mode: field("pace").and_then(|name| {
                    TIME_MODES.into_iter().find(|(_, known)| *known == name).map(|(mode, _)| mode)
                }),
            },
            connected_to: field("met").and_then(|pid| pid.parse().ok()),
            rejected: field("rejected").and_then(|pid| pid.parse().ok()),
        })
    }
}

/// Whether a role is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Presence {
    /// No process holds the role.
    Absent,
    /// The holder was killed and left its file.
    Dead,
    /// A process holds the role; it may not have written its record yet.
    Alive(Option<RoleRecord>),
}

fn path(root: &Path, role: Role) -> PathBuf {
    root.join(format!("{}.card", role.as_str()))
}

/// Reads whether `role` is held in `domain`.
pub(crate) fn presence(domain: &Domain, role: Role) -> io::Result<Presence> {
    presence_in(domain.root(), role)
}

/// As [`presence`], in the folder of a domain that this process need not have joined.
pub(crate) fn presence_in(root: &Path, role: Role) -> io::Result<Presence> {
    read_presence(&path(root, role))
}

fn read_presence(path: &Path) -> io::Result<Presence> {
    let mut file = match File::open(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(Presence::Absent),
        file => file?,
    };
    match file.try_lock_shared() {
        Ok(()) if still_named(&file, path) => Ok(Presence::Dead),
        Ok(()) => Ok(Presence::Absent),
        Err(TryLockError::WouldBlock) => {
            let mut text = String::new();
            file.read_to_string(&mut text)?;
            Ok(Presence::Alive(RoleRecord::parse(&text)))
        }
        Err(TryLockError::Error(cause)) => Err(cause),
    }
}

/// A role held by this process; released when dropped.
#[derive(Debug)]
pub(crate) struct RoleLock {
    file: File,
    path: PathBuf,
}

/// A role could not be acquired.
#[derive(Debug)]
pub(crate) enum RoleLockError {
    /// Another process holds the role; its id, if its record is readable.
    Taken(Option<u32>),
    /// The file system failed.
    Io(io::Error),
}

impl From<io::Error> for RoleLockError {
    fn from(cause: io::Error) -> Self {
        Self::Io(cause)
    }
}

impl RoleLock {
    /// Acquires `role` in `domain` and publishes `params`.
    pub(crate) fn acquire(
        domain: &Domain,
        role: Role,
        params: SessionParams,
    ) -> Result<Self, RoleLockError> {
        // A peer that reads the file locks it for an instant, so only a lock that persists
        // belongs to a holder.
        const ATTEMPTS: u32 = 10;
        let path = path(domain.root(), role);
        for _ in 0..ATTEMPTS {
            let mut file =
                File::options().create(true).truncate(false).read(true).write(true).open(&path)?;
            match file.try_lock() {
                Ok(()) if still_named(&file, &path) => {
                    let record = RoleRecord {
                        pid: std::process::id(),
                        params,
                        connected_to: None,
                        rejected: None,
                    };
                    file.set_len(0)?;
                    file.rewind()?;
                    file.write_all(record.text().as_bytes())?;
                    return Ok(Self { file, path });
                }
                Ok(()) => (),
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
                Err(TryLockError::Error(cause)) => return Err(cause.into()),
            }
        }
        Err(RoleLockError::Taken(match read_presence(&path)? {
            Presence::Alive(record) => record.map(|record| record.pid),
            _ => None,
        }))
    }

    /// Publishes that this end receives the messages of process `pid`.
    pub(crate) fn publish_connection(&self, pid: u32) -> io::Result<()> {
        self.append(format_args!("met {pid}\n"))
    }

    /// Publishes that this end rejects the session parameters of process `pid`.
    pub(crate) fn publish_rejection(&self, pid: u32) -> io::Result<()> {
        self.append(format_args!("rejected {pid}\n"))
    }

    /// Appends a line in one write, so that a reader always sees the rest complete.
    fn append(&self, line: fmt::Arguments<'_>) -> io::Result<()> {
        (&self.file).write_all(line.to_string().as_bytes())
    }
}

impl Drop for RoleLock {
    fn drop(&mut self) {
        // Remove the name before releasing the lock: a file without a lock means a dead holder.
        let _ = fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::leg::LegModel;

    #[test]
    fn a_role_has_one_holder_and_its_presence_is_readable() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let leg_presence = || presence(&domain, Role::Leg).unwrap();
        let acquire = |role, rate_hz| RoleLock::acquire(&domain, role, SessionParams::at(rate_hz));
        assert_eq!(leg_presence(), Presence::Absent);

        let params = SessionParams::at(1000).with_gravity(0.1 + 0.2).with_leg(&LegModel::HUMAN);
        let lock = RoleLock::acquire(&domain, Role::Leg, params).unwrap();
        let record =
            RoleRecord { pid: std::process::id(), params, connected_to: None, rejected: None };
        assert_eq!(leg_presence(), Presence::Alive(Some(record)));
        lock.publish_connection(77).unwrap();
        let connected = RoleRecord { connected_to: Some(77), ..record };
        assert_eq!(leg_presence(), Presence::Alive(Some(connected)));
        lock.publish_rejection(78).unwrap();
        let rejecting = RoleRecord { rejected: Some(78), ..connected };
        assert_eq!(leg_presence(), Presence::Alive(Some(rejecting)));
        let second = acquire(Role::Leg, 500);
        assert!(matches!(second, Err(RoleLockError::Taken(Some(pid))) if pid == record.pid));
        assert!(acquire(Role::Controller, 1000).is_ok());
        drop(lock);
        assert_eq!(leg_presence(), Presence::Absent);

        // A killed process leaves its file like this.
        fs::write(path(domain.root(), Role::Leg), record.text()).unwrap();
        assert_eq!(leg_presence(), Presence::Dead);
        let lock = acquire(Role::Leg, 500).unwrap();
        assert!(
            matches!(leg_presence(), Presence::Alive(Some(record)) if record.params.rate_hz == 500)
        );
        drop(lock);
    }

    #[test]
    fn an_incomplete_record_is_not_parsed() {
        assert_eq!(RoleRecord::parse(""), None);
        assert_eq!(RoleRecord::parse("pid 12\nwire 1\n"), None);
        assert_eq!(RoleRecord::parse("pid 12\nwire 1\nrate_hz 10"), None, "it may become 1000");
        assert_eq!(RoleRecord::parse("pid 12\nwire 1\nrate_hz 1000\ngravity_m_s2 1"), None);
        let text = "pid 12\nwire 1\nrate_hz 1000\ngravity_m_s2 1.62\n";
        let record = RoleRecord::parse(&format!("{text}met 3")).unwrap();
        assert_eq!(record.connected_to, None, "it may become 34");
        let expected = SessionParams {
            wire_version: 1,
            ..SessionParams::at(1000).with_gravity(1.62).with_any_time_mode()
        };
        assert_eq!(record.params, expected);
        for params in
            [SessionParams::at(50), SessionParams::at(50).with_time_mode(TimeMode::RealTime)]
        {
            let record = RoleRecord { params, ..record };
            assert_eq!(RoleRecord::parse(&record.text()), Some(record));
        }
        assert_eq!(RoleRecord::parse(&text.replace("12", "x")), None);
    }
}
