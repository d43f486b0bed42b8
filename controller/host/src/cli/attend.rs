//! The controller process: run after run, for whoever comes.

use std::time::Duration;

use super::beside::{Beside, Reload};
use super::hint::{self, with_hint};
use super::{Args, CliError, SAY_AFTER, Summary, other_leg, say};
use crate::TimeMode;
use crate::link::LinkError;
use crate::office::{Office, Windows};
use crate::operated::Operated;
use crate::realtime::LatestReport;
use crate::serve::{ServeError, serve_patiently};
use crate::shelf;
use crate::shm::{ConnectError, ShmController};
use crate::{Domain, SessionParams};
use leg_control::config::Config;
use leg_process::Stop;
use leg_process::policy_file::PolicyFile;

/// Attends to legs, one after the other.
pub(super) struct Attendant {
    // Before the link, and so gone before the role is given up.
    _beside: Beside,
    pub(super) link: ShmController,
    pub(super) controller: Operated,
    pub(super) stop: Stop,
    /// For a leg that is missing or silent; `None` is without end.
    pub(super) patience: Option<Duration>,
    pub(super) once: bool,
    has_said_missing: bool,
    /// The process whose run is over.
    farewell: Option<u32>,
}

/// Runs the controller: until a signal ends it or, with `--once`, for one run.
/// `tell` hears what each run has come to; in real time, all of them.
pub(super) fn run(args: &Args, tell: impl FnMut(&Summary)) -> Result<(), CliError> {
    let figures = LatestReport::default();
    let attendant = Attendant::begin(args, &figures)?;
    match args.pace() {
        TimeMode::LockStep => attendant.attend(tell),
        TimeMode::RealTime => attendant.attend_in_real_time(args, figures, tell),
    }
}

impl Attendant {
    /// Takes the role, and opens the desk.
    fn begin(args: &Args, figures: &LatestReport) -> Result<Self, CliError> {
        let config = Config::at_rate(args.rate)?.with_gravity(args.gravity)?;
        let blob = PolicyFile::load(args.policy.as_deref())?;
        let leg = blob.policy()?.manifest().leg;
        let policy = shelf::keep(blob.as_slice())?;
        let (stop, reload) = match &args.policy {
            // Without a file there is nothing to read again.
            None => (Stop::on_signals().map_err(CliError::Signals)?, None),
            Some(policy) => {
                let (stop, sighup) = Stop::on_signals_except_sighup().map_err(CliError::Signals)?;
                (stop, Some(Reload { sighup, policy: policy.clone() }))
            }
        };

        let domain = Domain::join(args.meeting.domain())?;
        let params = SessionParams::at(args.rate).with_gravity(args.gravity).with_leg(&leg);
        let params = params.with_time_mode(args.pace());
        let link = ShmController::open(&domain, params, &stop)?;
        let monitor = link.monitor();
        let windows = Windows {
            peer: Box::new(move || monitor.status()),
            timing: match args.pace() {
                TimeMode::LockStep => None,
                TimeMode::RealTime => Some(figures.clone()),
            },
        };
        let file = blob.path().display().to_string();
        let (controller, office) = Office::open(policy, &file, config, params, windows);
        let beside = Beside::open(&domain, office, reload, &stop);
        Ok(Self {
            _beside: beside,
            link,
            controller,
            stop,
            // One that stays waits as long as it takes, unless it is told how long.
            patience: if args.once { Some(args.meeting.timeout()) } else { args.meeting.timeout },
            once: args.once,
            has_said_missing: false,
            farewell: None,
        })
    }

    /// In lock-step.
    fn attend(mut self, mut tell: impl FnMut(&Summary)) -> Result<(), CliError> {
        loop {
            match self.wait() {
                Ok(()) => (),
                Err(ConnectError::Stopped(_)) if !self.once => return Ok(()),
                Err(cause) if cause.is_disagreement() && !self.once => {
                    let message = with_hint(&cause, hint::connect_error(&cause));
                    say(format_args!("{message}; still waiting"));
                    continue;
                }
                Err(cause) => return Err(cause.into()),
            }
            match self.serve() {
                Ok(summary) => {
                    tell(&summary);
                    self.farewell = self.link.peer().map(|peer| peer.pid);
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
                    // One whose run is over has said so before.
                    if cause.lost_peer() != self.farewell {
                        let message = with_hint(&cause, hint::link_error(&cause));
                        say(format_args!("after {ticks} ticks: {message}; waiting for the next"));
                    }
                }
                Err(cause) => return Err(cause.into()),
            }
            self.controller.restart();
        }
    }

    /// Until a leg is there.
    pub(super) fn wait(&mut self) -> Result<(), ConnectError> {
        let said = &mut self.has_said_missing;
        let peer = self.link.wait_for_peer(self.patience, |missing| {
            if !*said && missing.waited >= SAY_AFTER {
                *said = true;
                say(format_args!("{missing}; {}; still waiting", hint::missing_peer(missing)));
            }
            true
        })?;
        // The next time it is somebody's second run: he knows how.
        *said = true;
        let manifest = self.controller.controller().policy().manifest();
        if let Some(warning) = other_leg(manifest, peer.leg) {
            say(warning);
        }
        Ok(())
    }

    /// One run of the leg that is there.
    fn serve(&mut self) -> Result<Summary, ServeError> {
        let controller = &mut self.controller;
        let mut apexes = 0;
        let law = |sample: &_| {
            let command = controller.tick(Some(sample));
            apexes = command.apexes;
            command
        };
        let ticks = serve_patiently(&mut self.link, self.patience, law, |silence| say(silence))?;
        Ok(summary(&self.controller, ticks, apexes))
    }
}

/// What a run came to.
pub(super) fn summary(controller: &Operated, ticks: u64, apexes: u32) -> Summary {
    let controller = controller.controller();
    let policy = controller.policy().manifest().name.to_owned();
    Summary { policy, ticks, apexes, counts: *controller.counts(), real_time: None }
}
