//! The bridge: a flashed controller brought to where a controller process
//! would be, so that the simulator cannot tell one from the other.
//!
//! One thread waits for the simulator on shared memory and for the controller
//! on the line. `target` keeps the line and the run on it, `forward` moves
//! samples and commands, `share` lets others ask the controller meanwhile.

mod forward;
mod report;
mod share;
mod target;

use std::path::PathBuf;
use std::time::Duration;

use leg_control::wire::WIRE_VERSION;
use leg_host::discovery::DomainError;
use leg_host::serial::{ClientError, OpenError};
use leg_host::serve::ServeError;
use leg_host::shm::{ConnectError, ShmController};
use leg_host::socket::SocketError;
use leg_host::{Domain, LinkError, SessionParams};
use leg_process::Stop;

use forward::Forwarder;
pub use report::Report;
use share::Share;
use target::Target;
pub use target::{Dial, Notice, OnUnplug, RunTerms, Tell};

/// How a bridge is to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// On what terms.
    pub terms: RunTerms,
    /// Where to meet the simulator.
    pub domain: String,
    /// How long to wait for a missing or silent simulator or controller, or for
    /// a line that is unplugged.
    pub timeout: Duration,
    /// What to do when the line breaks.
    pub on_unplug: OnUnplug,
    /// A socket for others' requests.
    pub share: Option<PathBuf>,
}

/// Why there was no run, or not a whole one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The line cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The controller cannot be talked to, or will not.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// Its messages are of another version.
    #[error(
        "the controller speaks version {theirs} of the messages, this program version \
         {WIRE_VERSION}; flash a firmware of this release, or use the program of that one"
    )]
    WireVersion {
        /// The controller's.
        theirs: u16,
    },
    /// No simulator, or not a fitting one.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The simulator is gone, or silent.
    #[error(transparent)]
    Simulator(#[from] ServeError),
    /// The simulator is gone while the line is being opened again.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The controller does not answer any more.
    #[error(
        "after {ticks} ticks: the controller has not answered for {waited_s:.1} s, though the line \
         is open; is it stopped, or live without a timer? --timeout sets the patience"
    )]
    NoAnswer {
        /// Samples answered until then.
        ticks: u64,
        /// How long, s.
        waited_s: f64,
    },
    /// The line broke, and was not to be opened again.
    #[error("{0} (--on-unplug reconnect would wait for it)")]
    Unplugged(ClientError),
    /// The line broke, and was not open again in time.
    #[error("the line was not back after {:.1} s: {last}; --timeout sets the patience", waited.as_secs_f64())]
    NotBack {
        /// For so long.
        waited: Duration,
        /// What the last try came to.
        last: Box<BridgeError>,
    },
    /// The socket for others cannot be had.
    #[error("--share: {0}")]
    Share(#[from] SocketError),
}

impl From<DomainError> for BridgeError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// Joins the domain as a controller does, for one run of the simulator; the
/// commands are those of the controller that `dial` reaches. `tell` hears what
/// is worth a word meanwhile.
///
/// However it ends, a controller that still hears is left idle.
///
/// # Errors
/// [`BridgeError`].
pub fn run(options: &Options, dial: Dial, tell: Tell, stop: &Stop) -> Result<Report, BridgeError> {
    let Options { terms, timeout, on_unplug, .. } = *options;
    let share = options.share.as_deref().map(Share::listen).transpose()?;
    let mut target = Target::find(dial, tell, terms, on_unplug, timeout, stop)?;
    let domain = Domain::join(&options.domain)?;
    let leg = target.who.policy.as_ref().map(|policy| policy.leg);
    // It goes along with either pace.
    let meeting = SessionParams {
        leg,
        ..SessionParams::at(terms.rate_hz).with_gravity(terms.gravity_m_s2).with_any_time_mode()
    };

    // Refused terms are the caller's error, to be said at once; and a controller left in the
    // middle of another run stops.
    if let Err(cause) = target.begin() {
        target.recover(cause, || Ok(()))?;
    }
    let mut forwarder = Forwarder::new(target, share, terms.mode, timeout);
    let mut said = false;
    let mut broke = None;
    let link = ShmController::connect_while(&domain, meeting, timeout, stop, |missing| {
        if !said && missing.waited >= leg_host::cli::SAY_AFTER {
            said = true;
            let hint = leg_host::cli::hint::missing_peer(missing);
            forwarder.notice(&Notice::Waiting(format!("{missing}; {hint}")));
        }
        broke = forwarder.serve_others().err();
        broke.is_none()
    });
    let outcome = match (broke, link) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(error.into()),
        (None, Ok(mut link)) => forwarder.play(&mut link),
    };
    match outcome.and_then(|()| forwarder.finish()) {
        Ok(report) => Ok(report),
        Err(error) => {
            forwarder.leave();
            Err(error)
        }
    }
}
