//! A session with a controller in another process, from meeting to parting.

use std::io;
use std::process::ExitStatus;
use std::time::Duration;

use controller::host::domain::DomainError;
use controller::host::shm::{ConnectError, Missing, ShmLeg};
use controller::host::{Domain, Stop, Terms};

use super::child::{ControllerCall, ControllerChild};
use super::leg::TickRecord;
use super::lock_step::{self, Options, SessionError};
use super::outcome::Outcome;
use crate::scenario::Scenario;

/// How two processes come together.
#[derive(Clone, Debug)]
pub struct Meeting {
    /// Where.
    pub domain: String,
    /// How long to wait for a missing or silent controller.
    pub timeout: Duration,
    /// The controller to start; `None` waits for one that somebody else starts.
    pub start: Option<ControllerCall>,
}

/// Why there was no run, or not a whole one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlayError {
    /// No controller, or not a fitting one.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The run broke off.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The controller could not be started.
    #[error("cannot start the controller: {0}")]
    Start(io::Error),
    /// The controller that was started ended otherwise than well.
    #[error("the controller failed ({0}); its message is above")]
    Controller(ExitStatus),
}

impl From<DomainError> for PlayError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// Plays `scenario` over shared memory. `tell` hears every few milliseconds
/// that the controller is still missing; `observe` sees every tick.
///
/// Whatever happens, a controller started here has ended and is reaped when
/// this returns, and nothing is left in shared memory.
///
/// # Errors
/// [`PlayError`].
pub fn play(
    scenario: &Scenario,
    meeting: &Meeting,
    stop: &Stop,
    tell: impl FnMut(&Missing),
    observe: impl FnMut(&TickRecord),
) -> Result<Outcome, PlayError> {
    let options = Options { timeout: meeting.timeout, ..Options::default() };
    play_by(scenario.terms(), meeting, stop, tell, |mut link| {
        Ok(lock_step::run(scenario, &mut link, options, observe)?)
    })
}

/// As [`play`], in whatever way `run` plays once the two have met on `terms`.
///
/// # Errors
/// As [`play`].
pub fn play_by<R>(
    terms: Terms,
    meeting: &Meeting,
    stop: &Stop,
    mut tell: impl FnMut(&Missing),
    run: impl FnOnce(ShmLeg) -> Result<R, PlayError>,
) -> Result<R, PlayError> {
    // Before the child and dropped after it, so that the last to leave is this process,
    // and takes along what a killed child left.
    let domain = Domain::join(&meeting.domain)?;
    let mut child =
        meeting.start.as_ref().map(ControllerChild::spawn).transpose().map_err(PlayError::Start)?;

    let link = ShmLeg::connect_watching(&domain, terms, meeting.timeout, stop, |missing| {
        tell(missing);
        child.as_mut().is_none_or(|child| child.ended().is_none())
    });
    let link = match (link, child.as_mut().and_then(ControllerChild::ended)) {
        (Err(_), Some(status)) => return Err(PlayError::Controller(status)),
        (link, _) => link?,
    };
    let outcome = run(link)?;
    match child.map(ControllerChild::finish) {
        Some(Ok(status)) if !status.success() => Err(PlayError::Controller(status)),
        Some(Err(cause)) => Err(PlayError::Start(cause)),
        _ => Ok(outcome),
    }
}
