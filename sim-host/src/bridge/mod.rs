//! The bridge: connects a controller on a serial line to the simulator, in place of a
//! controller process.
//!
//! One thread waits for the simulator on shared memory and for the controller on the line.
//! `device` maintains the line and the session, `forward` moves samples and commands,
//! `request_mux` lets other programs send requests to the controller meanwhile.

mod device;
mod forward;
mod report;
mod request_mux;

use std::path::PathBuf;
use std::time::Duration;

use leg_control::wire::WIRE_VERSION;
use leg_host::discovery::DomainError;
use leg_host::serial::client::taken_by;
use leg_host::serial::{ClientError, OpenError};
use leg_host::serve::ServeError;
use leg_host::shm::{ConnectError, ShmController};
use leg_host::socket::SocketError;
use leg_host::{Domain, LinkError, SessionParams};
use leg_process::Stop;

use device::Device;
pub use device::{Connector, Notice, NoticeSink, OnUnplug, RunParams};
use forward::Forwarder;
pub use report::Report;
use request_mux::RequestMux;

/// The options of a bridge.
#[derive(Clone, Debug)]
pub struct Options {
    /// The parameters of the run.
    pub params: RunParams,
    /// The domain of the simulator.
    pub domain: String,
    /// How long to wait for a missing or silent simulator or controller, or for
    /// a line that is unplugged.
    pub timeout: Duration,
    /// What to do when the line breaks.
    pub on_unplug: OnUnplug,
    /// A unix socket for clients' requests, beside the one in the domain.
    pub share: Option<PathBuf>,
}

/// Why a run did not begin, or broke off.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The line cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The controller does not answer, or refuses.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The controller uses another wire version.
    #[error(
        "the controller uses wire version {theirs}, this program {WIRE_VERSION}; flash the \
         firmware of this release, or use the program of that one"
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
    /// The controller does not answer.
    #[error(
        "after {ticks} ticks: the controller has not answered for {waited_s:.1} s, though the line \
         is open: {}is it stopped, or live without a timer?",
        taken_by(others)
    )]
    NoAnswer {
        /// Samples answered until then.
        ticks: u64,
        /// How long, s.
        waited_s: f64,
        /// Other processes that have the port open.
        others: Vec<String>,
    },
    /// The line broke and is not to be opened again.
    #[error("{0}")]
    Unplugged(ClientError),
    /// The line broke and could not be opened again in time.
    #[error("the line was not back after {:.1} s: {last}", waited.as_secs_f64())]
    NotBack {
        /// For so long.
        waited: Duration,
        /// The error of the last try.
        last: Box<BridgeError>,
    },
    /// The socket for clients cannot be bound.
    #[error(transparent)]
    RequestMux(#[from] SocketError),
}

impl From<DomainError> for BridgeError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// Joins the domain as a controller does, for one run of the simulator; the commands are
/// those of the controller that `connect` opens a line to. `on_notice` receives the events
/// meanwhile. However the run ends, a controller that still answers is left idle.
///
/// # Errors
/// [`BridgeError`].
pub fn run(
    options: &Options,
    connect: Connector,
    on_notice: NoticeSink,
    stop: &Stop,
) -> Result<Report, BridgeError> {
    let Options { params, timeout, on_unplug, .. } = *options;
    let mut requests = RequestMux::new();
    if let Some(path) = &options.share {
        requests.listen(path)?;
    }
    let mut device = Device::find(connect, on_notice, params, on_unplug, timeout, stop)?;
    let domain = Domain::join(&options.domain)?;
    let leg = device.identity.policy.as_ref().map(|policy| policy.leg);
    // Fits a leg in lock-step and one in real time.
    let meeting = SessionParams {
        leg,
        ..SessionParams::at(params.law.rate_hz)
            .with_gravity(params.law.gravity_m_s2)
            .with_stale_limit(params.law.stale_limit_ns.into())
            .with_estimator(params.law.estimator)
            .with_any_time_mode()
    };

    // Refused parameters are the caller's error, to report at once. A controller that was left
    // in the middle of another run stops.
    if let Err(cause) = device.begin() {
        device.recover(cause, || Ok(()))?;
    }
    let mut forwarder = Forwarder::new(device, requests, params.mode, timeout);
    let mut is_reported = false;
    let mut broke = None;
    let link = ShmController::open(&domain, meeting, stop).and_then(|mut link| {
        forwarder.listen_in(&domain);
        let connected = link.wait_for_peer(Some(timeout), |missing| {
            if !is_reported && missing.waited >= leg_host::cli::REPORT_AFTER {
                is_reported = true;
                let hint = leg_host::cli::hint::missing_peer(missing);
                forwarder.notice(&Notice::Waiting(format!("{missing}; {hint}")));
            }
            broke = forwarder.serve_others().err();
            broke.is_none()
        });
        if connected.is_err() {
            forwarder.stop_listening();
        }
        connected.map(|_| link)
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
