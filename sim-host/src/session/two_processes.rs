//! A session with a controller in another process, from meeting to parting.

use std::fmt;
use std::io;
use std::process::ExitStatus;
use std::time::{Duration, UNIX_EPOCH};

use leg_host::discovery::DomainError;
use leg_host::realtime::LoopReport;
use leg_host::reconnect::{LinkEvent, ReconnectingLink};
use leg_host::shm::{ConnectError, MissingPeer, ShmLeg};
use leg_host::{Domain, LegLink, SessionParams};
use leg_process::Stop;

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
    /// The number of the run; see [`new_run_id`].
    pub run_id: u32,
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

/// What is worth a word, or may be.
#[derive(Clone, Copy, Debug)]
pub enum News<'a> {
    /// Every few milliseconds: the first controller is still missing.
    Missing(&'a MissingPeer),
    /// Something happened to the controller in the middle of the run.
    Notice(&'a LinkEvent),
}

/// A controller that has been met.
pub struct Met<'a> {
    /// The link to it.
    pub link: ShmLeg,
    patience: Duration,
    tell: &'a mut dyn FnMut(News<'_>),
    /// Whether another may come in its place.
    wanted: &'a mut dyn FnMut() -> bool,
}

impl fmt::Debug for Met<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Met").field("link", &self.link).finish_non_exhaustive()
    }
}

impl<'a> Met<'a> {
    /// The link for a run in lock-step, which waits for a controller that is
    /// lost.
    #[must_use]
    pub fn in_lock_step(self) -> impl LegLink + use<'a> {
        let Self { link, patience, tell, wanted } = self;
        ReconnectingLink::new(
            link,
            patience,
            |notice: &LinkEvent| tell(News::Notice(notice)),
            |_: &MissingPeer| wanted(),
        )
    }
}

/// A number for a run that begins now: later ones have higher numbers, whoever
/// plays them, so that a controller that stays takes none for the past. It
/// counts hundredths of a second and wraps after 497 days; half of these count
/// as the future.
#[must_use]
pub fn new_run_id() -> u32 {
    (UNIX_EPOCH.elapsed().unwrap_or_default().as_millis() / 10) as u32
}

/// Plays `scenario` over shared memory, in lock-step. `tell` hears the news;
/// `observe` sees every tick.
///
/// A controller that is lost in the middle of the run is waited for, as long as
/// the first one: the next that comes is asked the same tick again. (Not so if
/// it was started here.)
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
    tell: impl FnMut(News<'_>),
    observe: impl FnMut(&TickRecord),
) -> Result<Outcome, PlayError> {
    let options = Options { timeout: meeting.timeout, run_id: meeting.run_id };
    let (outcome, _) = play_by(scenario.session_params(), meeting, stop, tell, |met| {
        Ok(lock_step::run(scenario, &mut met.in_lock_step(), options, observe)?)
    })?;
    Ok(outcome)
}

/// As [`play`], in whatever way `run` plays once the two have met on `params`.
/// Beside what came of that: the figures of a controller's loop in real time, if
/// it was started here.
///
/// # Errors
/// As [`play`].
pub fn play_by<R>(
    params: SessionParams,
    meeting: &Meeting,
    stop: &Stop,
    mut tell: impl FnMut(News<'_>),
    run: impl FnOnce(Met<'_>) -> Result<R, PlayError>,
) -> Result<(R, Option<LoopReport>), PlayError> {
    // Before the child and dropped after it, so that the last to leave is this process,
    // and takes along what a killed child left.
    let domain = Domain::join(&meeting.domain)?;
    let mut child =
        meeting.start.as_ref().map(ControllerChild::spawn).transpose().map_err(PlayError::Start)?;

    let link = ShmLeg::connect_while(&domain, params, meeting.timeout, stop, |missing| {
        tell(News::Missing(missing));
        child.as_mut().is_none_or(|child| child.ended().is_none())
    });
    let link = match (link, child.as_mut().and_then(ControllerChild::ended)) {
        (Err(_), Some(status)) => return Err(PlayError::Controller(status)),
        (link, _) => link?,
    };
    let mut wanted = || child.as_mut().is_none_or(|child| child.ended().is_none());
    let (patience, tell, wanted) = (meeting.timeout, &mut tell as _, &mut wanted as _);
    let outcome = run(Met { link, patience, tell, wanted })?;
    let Some(child) = child else { return Ok((outcome, None)) };
    match child.finish().map_err(PlayError::Start)? {
        (status, of_its_loop) if status.success() => Ok((outcome, of_its_loop)),
        (status, _) => Err(PlayError::Controller(status)),
    }
}
