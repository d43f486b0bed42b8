//! Who plays which part in a domain, and on what terms.
//!
//! Each part has a card: a file in the domain's folder, locked by the process
//! that plays it. The lock makes a second player impossible and tells the
//! living from the dead; the text tells the peer what this side speaks, before
//! the first message. A process that leaves takes its card along; one that is
//! killed leaves the card behind, unlocked.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::domain::{Domain, still_named};
use leg_control::leg::LegModel;
use leg_control::wire::WIRE_VERSION;

/// The two parts in a domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Plays or drives the leg: the simulator.
    Leg,
    /// Commands it.
    Controller,
}

impl Role {
    /// Its name in files and ports.
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Leg => "leg",
            Self::Controller => "controller",
        }
    }

    /// The command that starts it.
    #[must_use]
    pub fn start_hint(self) -> &'static str {
        match self {
            Self::Leg => "sim-host run",
            Self::Controller => "controller --policy FILE",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leg => "simulator",
            Self::Controller => "controller",
        })
    }
}

/// What sets the time of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    /// Each tick waits for the command that answers its sample.
    LockStep,
    /// Both sides tick by the machine's clock; nobody waits for the other.
    RealTime,
}

impl Pace {
    /// Its name on a card.
    fn as_str(self) -> &'static str {
        match self {
            Self::LockStep => "lock-step",
            Self::RealTime => "real-time",
        }
    }

    fn parse(text: &str) -> Option<Self> {
        [Self::LockStep, Self::RealTime].into_iter().find(|pace| pace.as_str() == text)
    }
}

impl fmt::Display for Pace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LockStep => "lock-step",
            Self::RealTime => "real time",
        })
    }
}

/// What one side says of itself to the other. They must agree on all of it but
/// the leg: a policy may well be tried on a leg that it was not trained for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
    /// Version of the messages.
    pub wire_version: u16,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Gravity where the leg is, m/s2.
    pub gravity_m_s2: f32,
    /// The leg that is played, or that the policy was trained for, as
    /// [`LegModel::fingerprint`] has it; `None` is no word about it.
    pub leg: Option<u32>,
    /// What sets the time; `None` goes along with either.
    pub pace: Option<Pace>,
}

impl Terms {
    /// This build's messages, at `rate_hz`, in lock-step, under the gravity of
    /// Earth; no word about the leg.
    #[must_use]
    pub fn at(rate_hz: u32) -> Self {
        Self {
            wire_version: WIRE_VERSION,
            rate_hz,
            gravity_m_s2: 9.81,
            leg: None,
            pace: Some(Pace::LockStep),
        }
    }

    /// The same at another pace.
    #[must_use]
    pub fn with_pace(self, pace: Pace) -> Self {
        Self { pace: Some(pace), ..self }
    }

    /// The same at whatever pace the peer has.
    #[must_use]
    pub fn with_any_pace(self) -> Self {
        Self { pace: None, ..self }
    }

    /// The same under another gravity, m/s2.
    #[must_use]
    pub fn with_gravity(self, gravity_m_s2: f32) -> Self {
        Self { gravity_m_s2, ..self }
    }

    /// The same for a leg.
    #[must_use]
    pub fn with_leg(self, leg: &LegModel) -> Self {
        Self { leg: Some(leg.fingerprint()), ..self }
    }
}

/// What stands on a card.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Card {
    pub(super) pid: u32,
    pub(super) terms: Terms,
    /// The peer whose ports it has found and is ready to hear.
    pub(super) met: Option<u32>,
}

impl Card {
    fn text(self) -> String {
        let Terms { wire_version, rate_hz, gravity_m_s2, leg, pace } = self.terms;
        let leg = leg.map_or_else(String::new, |leg| format!("leg {leg:08x}\n"));
        let pace = pace.map_or_else(String::new, |pace| format!("pace {}\n", pace.as_str()));
        // A float has the digits it takes to read the same bits back. Gravity is last: with
        // it the card is whole.
        format!(
            "pid {}\nwire {wire_version}\nrate_hz {rate_hz}\n{leg}{pace}gravity_m_s2 {gravity_m_s2}\n",
            self.pid
        )
    }

    /// `None` while it is being written, or when it is of a kind unknown here.
    fn parse(text: &str) -> Option<Self> {
        // Only whole lines: the last may still be on its way. The latest counts.
        let lines = || text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'));
        let field = |name: &str| {
            lines().filter_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).next_back()
        };
        Some(Self {
            pid: field("pid")?.parse().ok()?,
            terms: Terms {
                wire_version: field("wire")?.parse().ok()?,
                rate_hz: field("rate_hz")?.parse().ok()?,
                gravity_m_s2: field("gravity_m_s2")?.parse().ok()?,
                leg: field("leg").and_then(|leg| u32::from_str_radix(leg, 16).ok()),
                pace: field("pace").and_then(Pace::parse),
            },
            met: field("met").and_then(|pid| pid.parse().ok()),
        })
    }
}

/// What the card of a role says about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Presence {
    /// Nobody plays it.
    Absent,
    /// Its player was killed.
    Dead,
    /// Somebody does; the card may not be written yet.
    Alive(Option<Card>),
}

fn path(root: &Path, role: Role) -> PathBuf {
    root.join(format!("{}.card", role.as_str()))
}

/// Looks at the card of `role`.
pub(super) fn presence(domain: &Domain, role: Role) -> io::Result<Presence> {
    presence_in(domain.root(), role)
}

/// The same, in the folder of a domain that need not be joined.
pub(super) fn presence_in(root: &Path, role: Role) -> io::Result<Presence> {
    look(&path(root, role))
}

fn look(path: &Path) -> io::Result<Presence> {
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
            Ok(Presence::Alive(Card::parse(&text)))
        }
        Err(TryLockError::Error(cause)) => Err(cause),
    }
}

/// A role held by this process; given up when dropped.
#[derive(Debug)]
pub(super) struct Held {
    file: File,
    path: PathBuf,
}

/// Why a role could not be had.
#[derive(Debug)]
pub(super) enum Refusal {
    /// Somebody plays it; their process, when the card says.
    Taken(Option<u32>),
    /// The file system refused.
    Io(io::Error),
}

impl From<io::Error> for Refusal {
    fn from(cause: io::Error) -> Self {
        Self::Io(cause)
    }
}

/// Takes `role`, if nobody has it.
pub(super) fn take(domain: &Domain, role: Role, terms: Terms) -> Result<Held, Refusal> {
    // A peer that looks at a card locks it for an instant: only a lock that stays is an owner.
    const TRIES: u32 = 10;
    let path = path(domain.root(), role);
    for _ in 0..TRIES {
        let mut file =
            File::options().create(true).truncate(false).read(true).write(true).open(&path)?;
        match file.try_lock() {
            Ok(()) if still_named(&file, &path) => {
                let card = Card { pid: std::process::id(), terms, met: None };
                file.set_len(0)?;
                file.rewind()?;
                file.write_all(card.text().as_bytes())?;
                return Ok(Held { file, path });
            }
            Ok(()) => (),
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
            Err(TryLockError::Error(cause)) => return Err(cause.into()),
        }
    }
    Err(Refusal::Taken(match look(&path)? {
        Presence::Alive(card) => card.map(|card| card.pid),
        _ => None,
    }))
}

impl Held {
    /// Adds to the card that the peer has been met. In one write, behind what
    /// is there, so that a reader sees the rest whole at any moment.
    pub(super) fn meet(&mut self, pid: u32) -> io::Result<()> {
        self.file.write_all(format!("met {pid}\n").as_bytes())
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        // First the name, then the lock: whoever sees the name unlocked sees a death.
        let _ = fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_has_one_player_and_shows_whether_it_lives() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let look = || presence(&domain, Role::Leg).unwrap();
        assert_eq!(look(), Presence::Absent);

        let terms = Terms::at(1000).with_gravity(0.1 + 0.2).with_leg(&LegModel::HUMAN);
        let mut held = take(&domain, Role::Leg, terms).unwrap();
        let card = Card { pid: std::process::id(), terms, met: None };
        assert_eq!(look(), Presence::Alive(Some(card)));
        held.meet(77).unwrap();
        assert_eq!(look(), Presence::Alive(Some(Card { met: Some(77), ..card })));
        let second = take(&domain, Role::Leg, Terms::at(500));
        assert!(matches!(second, Err(Refusal::Taken(Some(pid))) if pid == card.pid));
        assert!(take(&domain, Role::Controller, Terms::at(1000)).is_ok());
        drop(held);
        assert_eq!(look(), Presence::Absent);

        // As a killed process leaves it.
        fs::write(path(domain.root(), Role::Leg), card.text()).unwrap();
        assert_eq!(look(), Presence::Dead);
        let held = take(&domain, Role::Leg, Terms::at(500)).unwrap();
        assert!(matches!(look(), Presence::Alive(Some(card)) if card.terms.rate_hz == 500));
        drop(held);
    }

    #[test]
    fn a_card_half_written_is_not_yet_one() {
        assert_eq!(Card::parse(""), None);
        assert_eq!(Card::parse("pid 12\nwire 1\n"), None);
        assert_eq!(Card::parse("pid 12\nwire 1\nrate_hz 10"), None, "it may become 1000");
        assert_eq!(Card::parse("pid 12\nwire 1\nrate_hz 1000\ngravity_m_s2 1"), None);
        let text = "pid 12\nwire 1\nrate_hz 1000\ngravity_m_s2 1.62\n";
        let card = Card::parse(&format!("{text}met 3")).unwrap();
        assert_eq!(card.met, None, "it may become 34");
        assert_eq!(card.terms, Terms::at(1000).with_gravity(1.62).with_any_pace());
        for terms in [Terms::at(50), Terms::at(50).with_pace(Pace::RealTime)] {
            let card = Card { terms, ..card };
            assert_eq!(Card::parse(&card.text()), Some(card));
        }
        assert_eq!(Card::parse(&text.replace("12", "x")), None);
    }

    #[test]
    fn every_parameter_of_a_leg_tells() {
        type Change = fn(&mut LegModel);
        let human = LegModel::HUMAN.fingerprint();
        let changes: [Change; 10] = [
            |leg| leg.mass_kg = 3.0,
            |leg| leg.added_mass_kg = 3.0,
            |leg| leg.stiffness_n_m = 3.0,
            |leg| leg.volume_m3 = 3.0,
            |leg| leg.rest_length_m = 3.0,
            |leg| leg.max_elongation_m = 3.0,
            |leg| leg.area_x_m2 = 3.0,
            |leg| leg.area_y_m2 = 3.0,
            |leg| leg.drag_x = 3.0,
            |leg| leg.drag_y = 3.0,
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut leg = LegModel::HUMAN;
            change(&mut leg);
            assert_ne!(leg.fingerprint(), human, "parameter {i}");
        }
    }
}
