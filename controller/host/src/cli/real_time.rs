//! The controller process in real time.

use std::sync::{Mutex, PoisonError};

use super::background::lock;
use super::run_server::{RunServer, log_set_point, policy_name};
use super::{Args, CliError, Summary, hint, log, other_leg};
use crate::Role;
use crate::link::LinkError;
use crate::realtime::{self, ExitOn, LatestReport, ServeOutcome};
use crate::shm::PeerEvent;
use leg_control::policy::Manifest;

impl RunServer {
    /// Ticks by the clock, whoever is there or not.
    pub(super) fn serve_in_real_time(
        mut self,
        args: &Args,
        figures: LatestReport,
        on_summary: impl FnMut(&Summary) + Send,
    ) -> Result<(), CliError> {
        if self.once {
            self.wait()?;
            log_set_point(&self.server);
        }
        let once = self.once;
        let exit_on = if once { ExitOn::EndOfRun } else { ExitOn::StopSignal };
        let stale_limit_ns = args.law.stale_limit_ns()?;
        let options = args.real_time.options(Role::Controller, args.rate, figures);
        let options = realtime::LoopOptions { stale_limit_ns, ..options };
        let manifest: Option<Manifest<'static>> =
            self.node.controller().map(|controller| controller.policy().manifest().clone());
        let server = &self.server;
        let on_event = move |event: &PeerEvent| {
            if let PeerEvent::Connected(peer) = event {
                if let Some(warning) =
                    manifest.as_ref().and_then(|manifest| other_leg(manifest, peer.leg))
                {
                    log(warning);
                }
                log_set_point(server);
            }
            if let Some(message) = hint::peer_event(event) {
                log(message);
            }
        };
        // The supervisor reports the runs that end meanwhile.
        let on_summary = Mutex::new(on_summary);
        let report = |summary: &Summary| {
            (on_summary.lock().unwrap_or_else(PoisonError::into_inner))(summary);
        };
        let report_ended_runs = || {
            let next = || {
                let mut server = lock(server);
                server.ended_run().map(|result| (server.in_force().name, result))
            };
            while !once && let Some((policy, result)) = next() {
                report(&Summary { policy, result, is_total: false, real_time: None });
            }
        };
        let (lost_peer, mut supervise) =
            realtime::supervise_peer(&self.link, &self.stop, self.timeout, on_event);
        let supervise = || {
            supervise();
            report_ended_runs();
        };
        let ServeOutcome { ended, report: figures, .. } =
            realtime::serve(self.link, &mut self.node, exit_on, &options, &self.stop, supervise);
        self.node.end_run();
        report_ended_runs();
        report(&Summary {
            policy: policy_name(&self.node),
            result: self.node.total(),
            is_total: !once,
            real_time: Some(figures),
        });
        match lost_peer.get().cloned().map_or(ended, Err) {
            // For one that stays, the way to end.
            Err(LinkError::Stopped) if !once => Ok(()),
            ended => Ok(ended?),
        }
    }
}
