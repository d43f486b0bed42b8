//! The lock on a role in a domain, and the record that its holder publishes.
//!
//! Each role has a file in the domain's folder, locked by the process that holds
//! the role. The lock excludes a second holder and distinguishes a live holder
//! from a dead one; the text of the file publishes the holder's session parameters
//! before the first message, and then its progress. A process that ends in good order
//! writes a last line and removes the file; a killed one leaves it behind, unlocked.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::domain::{Domain, still_named};
use crate::link::{Role, SessionParams, TimeMode};

/// Names of the time modes in a record.
const TIME_MODES: [(TimeMode, &str); 2] =
    [(TimeMode::LockStep, "lock-step"), (TimeMode::RealTime, "real-time")];

/// Longest record that is read, bytes.
const MAX_RECORD: usize = 4096;

/// Identifies one tenure of a role: a random number. A process id does not, because in a
/// container a process that is started again has the same one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tenure(u64);

impl Tenure {
    fn random() -> io::Result<Self> {
        let mut bytes = [0; 8];
        rustix::rand::getrandom(&mut bytes, rustix::rand::GetRandomFlags::empty())?;
        Ok(Self(u64::from_ne_bytes(bytes)))
    }

    fn parse(text: &str) -> Option<Self> {
        u64::from_str_radix(text, 16).ok().map(Self)
    }
}

impl fmt::Display for Tenure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// What the holder of a role publishes about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RoleRecord {
    pub(crate) tenure: Tenure,
    /// Process id of the holder in its own container; for messages only.
    pub(crate) pid: u32,
    pub(crate) params: SessionParams,
    /// The tenure of the peer whose ports the holder has found: it will receive that peer's
    /// messages.
    pub(crate) connected_to: Option<Tenure>,
    /// The tenure of the peer whose session parameters the holder has rejected.
    pub(crate) rejected: Option<Tenure>,
}

impl RoleRecord {
    fn new(params: SessionParams) -> io::Result<Self> {
        let (tenure, pid) = (Tenure::random()?, std::process::id());
        Ok(Self { tenure, pid, params, connected_to: None, rejected: None })
    }

    /// Returns the text of the record without the progress, which is appended later.
    fn text(self) -> String {
        let SessionParams { wire_version, rate_hz, gravity_m_s2, leg, time_mode } = self.params;
        let leg = leg.map_or_else(String::new, |leg| format!("leg {leg:08x}\n"));
        let time_mode = TIME_MODES
            .into_iter()
            .find(|(mode, _)| Some(*mode) == time_mode)
            .map_or_else(String::new, |(_, name)| format!("time_mode {name}\n"));
        // A float is written with the digits needed to read the same bits back. Gravity comes
        // last: its line marks the record as complete.
        format!(
            "tenure {}\npid {}\nwire {wire_version}\nrate_hz {rate_hz}\n{leg}{time_mode}gravity_m_s2 \
             {gravity_m_s2}\n",
            self.tenure, self.pid
        )
    }

    /// Parses a record; `None` while it is incomplete, or if its format is unknown.
    fn parse(text: &str) -> Option<Self> {
        let field = |name: &str| field(text, name);
        Some(Self {
            tenure: field("tenure").and_then(Tenure::parse)?,
            pid: field("pid")?.parse().ok()?,
            params: SessionParams {
                wire_version: field("wire")?.parse().ok()?,
                rate_hz: field("rate_hz")?.parse().ok()?,
                gravity_m_s2: field("gravity_m_s2")?.parse().ok()?,
                leg: field("leg").and_then(|leg| u32::from_str_radix(leg, 16).ok()),
                time_mode: field("time_mode").and_then(|name| {
                    TIME_MODES.into_iter().find(|(_, known)| *known == name).map(|(mode, _)| mode)
                }),
            },
            connected_to: field("connected_to").and_then(Tenure::parse),
            rejected: field("rejected").and_then(Tenure::parse),
        })
    }
}

/// Returns the last value of a field in a record. Only complete lines count, since the last
/// may be in the middle of a write.
fn field<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let lines = text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'));
    lines.filter_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).next_back()
}

/// Whether a role is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Presence {
    /// No process holds the role, or its holder has left in good order.
    Absent,
    /// The holder was killed.
    Dead,
    /// A process holds the role; it may not have written its record yet.
    Alive(Option<RoleRecord>),
}

fn path(root: &Path, role: Role) -> PathBuf {
    root.join(format!("{}.role", role.as_str()))
}

/// The file of a role, open for reading. It shows the end of its holder even after the
/// folder of the domain was removed.
#[derive(Debug)]
pub(crate) struct RoleFile(File);

impl RoleFile {
    /// Opens the file of `role` in the folder of a domain, if there is one. The process need
    /// not have joined the domain.
    pub(crate) fn open(root: &Path, role: Role) -> io::Result<Option<Self>> {
        match File::open(path(root, role)) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
            file => file.map(|file| Some(Self(file))),
        }
    }

    /// Reads whether the role is held.
    pub(crate) fn presence(&self) -> io::Result<Presence> {
        let is_free = match self.0.try_lock_shared() {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => false,
            Err(TryLockError::Error(cause)) => return Err(cause),
        };
        if is_free {
            self.0.unlock()?;
        }
        let mut bytes = [0; MAX_RECORD];
        let len = self.0.read_at(&mut bytes, 0)?;
        let text = String::from_utf8_lossy(&bytes[..len]);
        Ok(match (is_free, field(&text, "left")) {
            (true, Some(_)) => Presence::Absent,
            (true, None) => Presence::Dead,
            (false, _) => Presence::Alive(RoleRecord::parse(&text)),
        })
    }
}

/// Reads whether `role` is held in the domain with this folder. The process need not have
/// joined it.
pub(crate) fn presence_in(root: &Path, role: Role) -> io::Result<Presence> {
    RoleFile::open(root, role)?.map_or(Ok(Presence::Absent), |file| file.presence())
}

/// A role held by this process; released when dropped.
#[derive(Debug)]
pub(crate) struct RoleLock {
    file: File,
    path: PathBuf,
    tenure: Tenure,
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
                File::options().create(true).truncate(false).read(true).append(true).open(&path)?;
            match file.try_lock() {
                Ok(()) if still_named(&file, &path) => {
                    let record = RoleRecord::new(params)?;
                    file.set_len(0)?;
                    file.write_all(record.text().as_bytes())?;
                    return Ok(Self { file, path, tenure: record.tenure });
                }
                Ok(()) => (),
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
                Err(TryLockError::Error(cause)) => return Err(cause.into()),
            }
        }
        Err(RoleLockError::Taken(match presence_in(domain.root(), role)? {
            Presence::Alive(record) => record.map(|record| record.pid),
            _ => None,
        }))
    }

    /// Returns the tenure of this process.
    pub(crate) fn tenure(&self) -> Tenure {
        self.tenure
    }

    /// Publishes that this end receives the messages of the peer with this tenure.
    pub(crate) fn publish_connection(&self, peer: Tenure) -> io::Result<()> {
        self.append(&format!("connected_to {peer}\n"))
    }

    /// Publishes that this end rejects the session parameters of the peer with this tenure.
    pub(crate) fn publish_rejection(&self, peer: Tenure) -> io::Result<()> {
        self.append(&format!("rejected {peer}\n"))
    }

    /// Appends a line in one write, so that a reader always sees the rest complete.
    fn append(&self, line: &str) -> io::Result<()> {
        (&self.file).write_all(line.as_bytes())
    }
}

impl Drop for RoleLock {
    fn drop(&mut self) {
        // Before the lock is released: a file without it means a dead holder.
        let _ = self.append("left in good order\n");
        if still_named(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
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
        let presence = || presence_in(domain.root(), Role::Leg).unwrap();
        let acquire = |role, rate_hz| RoleLock::acquire(&domain, role, SessionParams::at(rate_hz));
        assert_eq!(presence(), Presence::Absent);

        let params = SessionParams::at(1000).with_gravity(0.1 + 0.2).with_leg(&LegModel::HUMAN);
        let lock = RoleLock::acquire(&domain, Role::Leg, params).unwrap();
        let record = RoleRecord { tenure: lock.tenure(), ..RoleRecord::new(params).unwrap() };
        assert_eq!(presence(), Presence::Alive(Some(record)));
        let peer = Tenure::random().unwrap();
        lock.publish_connection(peer).unwrap();
        let connected = RoleRecord { connected_to: Some(peer), ..record };
        assert_eq!(presence(), Presence::Alive(Some(connected)));
        let other = Tenure::random().unwrap();
        lock.publish_rejection(other).unwrap();
        let rejecting = RoleRecord { rejected: Some(other), ..connected };
        assert_eq!(presence(), Presence::Alive(Some(rejecting)));
        let second = acquire(Role::Leg, 500);
        assert!(matches!(second, Err(RoleLockError::Taken(Some(pid))) if pid == record.pid));
        assert!(acquire(Role::Controller, 1000).is_ok());
        drop(lock);
        assert_eq!(presence(), Presence::Absent);

        // A killed process leaves its file like this.
        fs::write(path(domain.root(), Role::Leg), record.text()).unwrap();
        assert_eq!(presence(), Presence::Dead);
        let lock = acquire(Role::Leg, 500).unwrap();
        assert!(matches!(presence(), Presence::Alive(Some(found))
            if found.params.rate_hz == 500 && found.tenure != record.tenure && found.pid == record.pid));
        drop(lock);
    }

    /// The folder may be removed under a run; its two processes go on, and each sees how the
    /// other ends.
    #[test]
    fn an_open_file_shows_the_end_of_its_holder_without_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        for leaves in [true, false] {
            let lock = RoleLock::acquire(&domain, Role::Leg, SessionParams::at(1000)).unwrap();
            let file = RoleFile::open(domain.root(), Role::Leg).unwrap().unwrap();
            fs::remove_file(path(domain.root(), Role::Leg)).unwrap();
            assert!(matches!(file.presence().unwrap(), Presence::Alive(Some(_))));
            let successor = acquire_again(&domain);
            if leaves {
                drop(lock);
                assert_eq!(file.presence().unwrap(), Presence::Absent);
            } else {
                // As the kernel releases the lock of a killed process.
                lock.file.unlock().unwrap();
                assert_eq!(file.presence().unwrap(), Presence::Dead);
                std::mem::forget(lock);
            }
            let alive = presence_in(domain.root(), Role::Leg).unwrap();
            assert!(matches!(alive, Presence::Alive(Some(_))), "the successor keeps its file");
            drop(successor);
        }
    }

    fn acquire_again(domain: &Domain) -> RoleLock {
        RoleLock::acquire(domain, Role::Leg, SessionParams::at(1000)).unwrap()
    }

    #[test]
    fn an_incomplete_record_is_not_parsed() {
        let whole = "tenure 1f\npid 12\nwire 1\nrate_hz 1000\ngravity_m_s2 1.62\n";
        for end in (0..whole.len()).filter(|end| *end < whole.len()) {
            assert_eq!(RoleRecord::parse(&whole[..end]), None, "{}", &whole[..end]);
        }
        let record = RoleRecord::parse(&format!("{whole}connected_to 3")).unwrap();
        assert_eq!(record.connected_to, None, "it may become 34");
        let expected = SessionParams {
            wire_version: 1,
            ..SessionParams::at(1000).with_gravity(1.62).with_any_time_mode()
        };
        assert_eq!((record.params, record.tenure), (expected, Tenure(0x1f)));
        for params in
            [SessionParams::at(50), SessionParams::at(50).with_time_mode(TimeMode::RealTime)]
        {
            let record = RoleRecord { params, ..record };
            assert_eq!(RoleRecord::parse(&record.text()), Some(record));
        }
        assert_eq!(RoleRecord::parse(&whole.replace("12", "x")), None);
    }
}
