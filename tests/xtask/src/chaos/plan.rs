//! What is done to whom, and when: by chance, from a seed.

use std::fmt;
use std::time::Duration;

use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use super::actor::Part;

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum How {
    /// SIGKILL, and started again.
    Kill,
    /// SIGSTOP, and SIGCONT.
    Stop,
    /// SIGHUP, as by a closed terminal, and started again.
    HangUp,
}

impl How {
    pub(super) const ALL: [Self; 3] = [Self::Kill, Self::Stop, Self::HangUp];

    /// Whether the process is no more.
    pub(super) fn ends(self) -> bool {
        self != Self::Stop
    }
}

impl fmt::Display for How {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kill => "killed",
            Self::Stop => "stopped",
            Self::HangUp => "hung up",
        })
    }
}

/// One blow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blow {
    pub(super) victim: Part,
    pub(super) how: How,
    /// After the one before.
    pub(super) after: Duration,
    /// For how long it is gone after it was missed.
    pub(super) gone: Duration,
    /// Killed once more, so long after it was started again.
    pub(super) killed_at_start: Option<Duration>,
}

impl Blow {
    pub(super) fn choose(random: &mut Pcg64Mcg) -> Self {
        let mut ms = |most: u64| Duration::from_micros(random.random_range(0..=1000 * most));
        let (after, gone, at_start) = (ms(150), ms(100), ms(60));
        let victim = if random.random() { Part::Leg } else { Part::Controller };
        let how = How::ALL[random.random_range(0..How::ALL.len())];
        let killed_at_start = random.random_bool(0.25).then_some(at_start);
        Self { victim, how, after, gone, killed_at_start }
    }
}

impl fmt::Display for Blow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { victim, how, after, gone, killed_at_start } = self;
        write!(f, "the {victim} {how} after {after:?}, gone for {gone:?}")?;
        match killed_at_start.filter(|_| how.ends()) {
            Some(time) => write!(f, ", and killed {time:?} after its start"),
            None => Ok(()),
        }
    }
}
