//! What is done to which process and when, drawn from a seed.

use std::fmt;
use std::time::Duration;

use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use super::process::Role;

/// The kind of an injected failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// SIGKILL; the process is started again.
    Kill,
    /// SIGSTOP, later SIGCONT.
    Stop,
    /// SIGHUP, as from a closed terminal; the process is started again.
    HangUp,
    /// SIGTERM, and SIGKILL while it ends; the process is started again.
    KillAtEnd,
}

impl Kind {
    pub(super) const ALL: [Self; 4] = [Self::Kill, Self::Stop, Self::HangUp, Self::KillAtEnd];

    /// Returns whether the process ends.
    pub(super) fn ends(self) -> bool {
        self != Self::Stop
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kill => "killed",
            Self::Stop => "stopped",
            Self::HangUp => "hung up",
            Self::KillAtEnd => "killed while it ended",
        })
    }
}

/// One failure to inject.
#[derive(Clone, Copy, Debug)]
pub(super) struct Injection {
    pub(super) target: Role,
    pub(super) kind: Kind,
    /// Pause since the previous one.
    pub(super) after: Duration,
    /// Time from the peer's report of the loss to the return of the target.
    pub(super) gone: Duration,
    /// Time from SIGTERM to SIGKILL of a target that is killed while it ends.
    pub(super) ending: Duration,
    /// If set, the target is killed once more, so long after it was started again.
    pub(super) killed_at_start: Option<Duration>,
}

impl Injection {
    /// Draws one: pauses are uniform up to 150 and 100 ms, an end is interrupted within 10 ms. A start is interrupted within 15 ms,
    /// in which the shared memory is created, or within 60 ms, in which the peers connect.
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        let mut ms = |most: u64| Duration::from_micros(random.random_range(0..=1000 * most));
        let (after, gone, ending) = (ms(150), ms(100), ms(10));
        let (early, late) = (ms(15), ms(60));
        let at_start = if random.random() { early } else { late };
        let target = if random.random() { Role::Leg } else { Role::Controller };
        let kind = Kind::ALL[random.random_range(0..Kind::ALL.len())];
        let killed_at_start = random.random_bool(0.5).then_some(at_start);
        Self { target, kind, after, gone, ending, killed_at_start }
    }
}

impl fmt::Display for Injection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { target, kind, after, gone, ending, killed_at_start } = self;
        write!(f, "the {target} {kind} after {after:?}, gone for {gone:?}")?;
        if *kind == Kind::KillAtEnd {
            write!(f, ", killed {ending:?} after SIGTERM")?;
        }
        match killed_at_start.filter(|_| kind.ends()) {
            Some(time) => write!(f, ", and killed {time:?} after its start"),
            None => Ok(()),
        }
    }
}
