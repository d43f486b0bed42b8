//! A session with a controller in another process, from connecting to leaving.

use std::fmt;
use std::io;
use std::process::ExitStatus;
use std::time::{Duration, UNIX_EPOCH};

use leg_host::discovery::DomainError;
use leg_host::realtime::LoopReport;
use leg_host::reconnect::{LinkEvent, ReconnectingLink};
use leg_host::shm::{ConnectError, MissingPeer, ShmLeg};
use leg_host::{Domain, LegLink, Role, SessionParams};
use leg_process::Stop;

use super::child::{ControllerArgs, ControllerChild};
use super::hooks::Hooks;
use super::lock_step::{self, Options, SessionError};
use super::outcome::Outcome;
use crate::scenario::Scenario;

/// How to connect to a controller process.
#[derive(Clone, Debug)]
pub struct ConnectOptions {
    /// The domain in which both processes connect.
    pub domain: String,
    /// Longest wait for a missing or silent controller.
    pub timeout: Duration,
    /// The controller to start; `None` waits for one that is started elsewhere.
    pub start: Option<ControllerArgs>,
    /// Identifies the run; see [`new_run_id`].
    pub run_id: u32,
}

/// Why a run did not start, or ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlayError {
    /// No controller connected, or one with other parameters.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The session ended early.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The controller process could not be started.
    #[error("cannot start the controller: {0}")]
    Start(io::Error),
    /// The controller process that was started here failed.
    #[error("the controller failed ({0}); its message is above")]
    Controller(ExitStatus),
}

impl From<DomainError> for PlayError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// An event of the connection.
#[derive(Clone, Copy, Debug)]
pub enum SessionEvent<'a> {
    /// The first controller is still missing; sent every few milliseconds.
    Missing(&'a MissingPeer),
    /// The controller was lost or came back during the run.
    Peer(&'a LinkEvent),
}

/// A connected controller.
pub struct Connected<'a> {
    /// The link to the controller.
    pub link: ShmLeg,
    timeout: Duration,
    on_event: &'a mut dyn FnMut(SessionEvent<'_>),
    /// Returns whether to wait for another controller if this one is lost.
    may_wait: &'a mut dyn FnMut() -> bool,
}

impl fmt::Debug for Connected<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Connected").field("link", &self.link).finish_non_exhaustive()
    }
}

impl<'a> Connected<'a> {
    /// Returns a link for a run in lock-step, which waits for another controller
    /// if this one is lost.
    #[must_use]
    pub fn in_lock_step(self) -> impl LegLink + use<'a> {
        let Self { link, timeout, on_event, may_wait } = self;
        ReconnectingLink::new(
            link,
            timeout,
            |event: &LinkEvent| on_event(SessionEvent::Peer(event)),
            |_: &MissingPeer| may_wait(),
        )
    }
}

/// Returns an id for a run that begins now. Later runs have higher ids, whichever
/// process plays them, so that a controller that stays running does not take a
/// new run for an old one. The id counts hundredths of a second and wraps after
/// 497 days; ids up to half of that ahead count as newer.
#[must_use]
pub fn new_run_id() -> u32 {
    (UNIX_EPOCH.elapsed().unwrap_or_default().as_millis() / 10) as u32
}

/// Plays `scenario` over shared memory in lock-step, with hooks.
///
/// If the controller is lost during the run, the run waits for another one as
/// long as for the first and sends it the same sample again, unless the
/// controller was started here.
///
/// When this returns, a controller started here has ended and is reaped, and
/// nothing is left in shared memory.
///
/// # Errors
/// [`PlayError`].
pub fn run_lock_step(
    scenario: &Scenario,
    connect: &ConnectOptions,
    stop: &Stop,
    on_event: impl FnMut(SessionEvent<'_>),
    hooks: &mut impl Hooks,
) -> Result<Outcome, PlayError> {
    let options = Options { timeout: connect.timeout, run_id: connect.run_id };
    let (outcome, controller) =
        connect_and_run(scenario.session_params(), connect, stop, on_event, |connected| {
            Ok(lock_step::run_with(scenario, &mut connected.in_lock_step(), options, hooks)?)
        })?;
    controller.map(|_| outcome)
}

/// How a controller that was started here ended: the report of its loop, if it ran in real
/// time, or its failure. Without one it is `Ok(None)`.
pub type ControllerEnd = Result<Option<LoopReport>, PlayError>;

/// Connects on `params` and calls `run`. Returns its result, which a failure of the controller
/// at the end does not take away, and how a controller ended that was started here.
///
/// A signal that ends the run, as that of a terminal, may reach both processes: then the
/// controller ends by it as well, which is no failure.
///
/// # Errors
/// [`PlayError`].
pub fn connect_and_run<R>(
    params: SessionParams,
    connect: &ConnectOptions,
    stop: &Stop,
    mut on_event: impl FnMut(SessionEvent<'_>),
    run: impl FnOnce(Connected<'_>) -> Result<R, PlayError>,
) -> Result<(R, ControllerEnd), PlayError> {
    // Joined before the child and left after it, so that this process removes what a killed
    // child leaves.
    let domain = Domain::join(&connect.domain)?;
    let mut child =
        connect.start.as_ref().map(ControllerChild::spawn).transpose().map_err(PlayError::Start)?;

    let mut link = ShmLeg::open(&domain, params, stop)?;
    let connected = link.wait_for_peer(Some(connect.timeout), |missing| {
        on_event(SessionEvent::Missing(missing));
        child.as_mut().is_none_or(|child| child.ended().is_none())
    });
    match (connected, child.as_mut().and_then(ControllerChild::ended)) {
        (Err(_), Some(_)) if stop.is_raised() => {
            return Err(ConnectError::Stopped(Role::Controller).into());
        }
        (Err(_), Some(status)) => return Err(PlayError::Controller(status)),
        (connected, _) => drop(connected?),
    }
    let mut may_wait = || child.as_mut().is_none_or(|child| child.ended().is_none());
    let outcome = run(Connected {
        link,
        timeout: connect.timeout,
        on_event: &mut on_event,
        may_wait: &mut may_wait,
    })?;
    let Some(child) = child else { return Ok((outcome, Ok(None))) };
    let ended = match child.finish().map_err(PlayError::Start) {
        Ok((status, report)) if status.success() || stop.is_raised() => Ok(report),
        Ok((status, _)) => Err(PlayError::Controller(status)),
        Err(cause) => Err(cause),
    };
    Ok((outcome, ended))
}
