//! The controller process: serves one run after the other.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::background::{Background, Reload, lock};
use super::hint::{self, with_hint};
use super::{Args, CliError, REPORT_AFTER, Summary, TIMEOUT, log, other_leg};
use crate::TimeMode;
use crate::link::LinkError;
use crate::node_loop::NodeLoop;
use crate::node_server::{NodeServer, StatusSources};
use crate::policy_cache;
use crate::realtime::LatestReport;
use crate::serve::{ServeError, serve_reporting_silence};
use crate::shm::{ConnectError, ShmController};
use crate::{Domain, SessionParams};
use leg_control::config::Config;
use leg_process::Stop;
use leg_process::policy_file::PolicyFile;

/// Serves the runs of legs, one after the other.
pub(super) struct RunServer {
    // Declared before the link, so that it is dropped before the role is given up.
    _background: Background,
    pub(super) link: ShmController,
    pub(super) node: NodeLoop,
    pub(super) server: Arc<Mutex<NodeServer>>,
    pub(super) stop: Stop,
    /// How long to wait for a missing leg; `None` is without limit.
    pub(super) timeout: Option<Duration>,
    /// How long to wait for a leg that lives and sends nothing, as one that is paused.
    silence_timeout: Option<Duration>,
    pub(super) once: bool,
    has_reported_missing: bool,
    /// The process whose run is over.
    served: Option<u32>,
}

/// Runs the controller: until a signal ends it or, with `--once`, for one run. `on_summary`
/// receives the summary of each run; in real time without `--once`, then the total.
pub(super) fn run(args: &Args, on_summary: impl FnMut(&Summary) + Send) -> Result<(), CliError> {
    let figures = LatestReport::default();
    let server = RunServer::begin(args, &figures)?;
    match args.time_mode() {
        TimeMode::LockStep => server.serve_in_lock_step(on_summary),
        TimeMode::RealTime => server.serve_in_real_time(args, figures, on_summary),
    }
}

impl RunServer {
    /// Takes the role, and opens the control socket.
    fn begin(args: &Args, figures: &LatestReport) -> Result<Self, CliError> {
        Config::at_rate(args.rate)?.with_gravity(args.gravity)?;
        let stale_limit_ns = args.law.stale_limit_ns()?;
        let estimator = args.law.estimator()?.unwrap_or_default();
        let blob = PolicyFile::load(args.policy.as_deref())?;
        let leg = blob.policy()?.manifest().leg;
        let policy = policy_cache::intern(blob.as_slice())?;
        let (stop, reload) = match &args.policy {
            // Without a file there is nothing to read again.
            None => (Stop::on_signals().map_err(CliError::Signals)?, None),
            Some(policy) => {
                let (stop, sighup) = Stop::on_signals_except_sighup().map_err(CliError::Signals)?;
                (stop, Some(Reload { sighup, policy: policy.clone() }))
            }
        };

        let domain = Domain::join(args.domain.name())?;
        let params = SessionParams::at(args.rate).with_gravity(args.gravity).with_leg(&leg);
        let params = params.with_time_mode(args.time_mode()).with_stale_limit(stale_limit_ns);
        let params = params.with_estimator(estimator);
        let link = ShmController::open(&domain, params, &stop)?;
        let monitor = link.monitor();
        let sources = StatusSources {
            peer: Box::new(move || monitor.status()),
            timing: match args.time_mode() {
                TimeMode::LockStep => None,
                TimeMode::RealTime => Some(figures.clone()),
            },
        };
        let file = blob.path().display().to_string();
        let (node, server) = NodeServer::open(policy, &file, params, sources)?;
        let server = Arc::new(Mutex::new(server));
        let background = Background::open(&domain, &server, reload, &stop);
        Ok(Self {
            _background: background,
            link,
            node,
            server,
            stop,
            // Without --once the process waits without limit, unless a limit is given.
            timeout: args.timeout.or(args.once.then_some(TIMEOUT)),
            silence_timeout: args.timeout,
            once: args.once,
            has_reported_missing: false,
            served: None,
        })
    }

    /// Serves runs in lock-step.
    fn serve_in_lock_step(mut self, mut on_summary: impl FnMut(&Summary)) -> Result<(), CliError> {
        loop {
            match self.wait() {
                Ok(()) => (),
                Err(ConnectError::Stopped(_)) if !self.once => return Ok(()),
                Err(cause) if cause.is_disagreement() && !self.once => {
                    let message = with_hint(&cause, hint::connect_error(&cause));
                    log(format_args!("{message}; still waiting"));
                    continue;
                }
                Err(cause) => return Err(cause.into()),
            }
            match self.serve() {
                Ok(summary) => {
                    on_summary(&summary);
                    self.served = self.link.peer().map(|peer| peer.pid);
                    if self.once {
                        return Ok(());
                    }
                }
                Err(ServeError::Link { ticks: 0, cause: LinkError::Stopped }) if !self.once => {
                    return Ok(());
                }
                Err(ServeError::Link { ticks, cause })
                    if !self.once && cause.lost_peer().is_some() =>
                {
                    // The end of a run was reported before.
                    if cause.lost_peer() != self.served {
                        let message = with_hint(&cause, hint::link_error(&cause));
                        log(format_args!("after {ticks} ticks: {message}; waiting for the next"));
                    }
                }
                Err(cause) => return Err(cause.into()),
            }
            self.node.restart();
        }
    }

    /// Waits until a leg is connected.
    pub(super) fn wait(&mut self) -> Result<(), ConnectError> {
        let (reported, node) = (&mut self.has_reported_missing, &mut self.node);
        let mut failure = None;
        let peer = self.link.wait_for_peer(self.timeout, |missing| {
            node.idle();
            if !*reported && missing.waited >= REPORT_AFTER {
                *reported = true;
                log(format_args!("{missing}; {}; still waiting", hint::missing_peer(missing)));
            }
            if missing.failure != failure {
                failure.clone_from(&missing.failure);
                log(format_args!("{missing}; still waiting"));
            }
            true
        })?;
        // The hint is printed once only.
        *reported = true;
        let warning = self
            .node
            .controller()
            .and_then(|controller| other_leg(controller.policy().manifest(), peer.leg));
        if let Some(warning) = warning {
            log(warning);
        }
        Ok(())
    }

    /// Serves one run.
    fn serve(&mut self) -> Result<Summary, ServeError> {
        let (node, server) = (&mut self.node, &self.server);
        let mut has_begun = false;
        let law = |sample: &_| {
            if !std::mem::replace(&mut has_begun, true) {
                log_set_point(server);
            }
            node.tick(Some(sample))
        };
        serve_reporting_silence(&mut self.link, self.silence_timeout, law, |silence| log(silence))?;
        Ok(Summary {
            policy: policy_name(&self.node),
            result: self.node.result_of_run().unwrap_or_default(),
            is_total: false,
            real_time: None,
        })
    }
}

/// Reports at the start of a run that a request of before is still in force.
pub(super) fn log_set_point(server: &Mutex<NodeServer>) {
    if let Some(set_point_m_s) = lock(server).set_point_m_s() {
        log(format_args!(
            "this run begins with the set-point {set_point_m_s} m/s of an earlier `controller \
             set-point`, in place of that of the samples; `controller set-point` without a value \
             returns to that"
        ));
    }
}

/// Returns the name of the policy that runs.
pub(super) fn policy_name(node: &NodeLoop) -> String {
    let policy = node.controller().map(|controller| controller.policy().manifest().name.to_owned());
    policy.unwrap_or_default()
}
