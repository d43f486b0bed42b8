//! The controller process in real time.

use super::run_server::{RunServer, summary};
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
        mut on_summary: impl FnMut(&Summary),
    ) -> Result<(), CliError> {
        if self.once {
            self.wait()?;
        }
        let once = self.once;
        let exit_on = if once { ExitOn::EndOfRun } else { ExitOn::StopSignal };
        let options = args.real_time.options(Role::Controller, args.rate, figures);
        let manifest: Option<Manifest<'static>> =
            self.node.controller().map(|controller| controller.policy().manifest().clone());
        let on_event = move |event: &PeerEvent| {
            if let PeerEvent::Connected(peer) = event
                && let Some(warning) =
                    manifest.as_ref().and_then(|manifest| other_leg(manifest, peer.leg))
            {
                log(warning);
            }
            if let Some(message) = hint::peer_event(event) {
                log(message);
            }
        };
        let (lost_peer, supervise) =
            realtime::supervise_peer(&self.link, &self.stop, self.timeout, on_event);
        let ServeOutcome { ended, samples, last, report } =
            realtime::serve(self.link, &mut self.node, exit_on, &options, &self.stop, supervise);
        on_summary(&Summary {
            real_time: Some(report),
            ..summary(&self.node, samples, last.apexes)
        });
        match lost_peer.get().cloned().map_or(ended, Err) {
            // For one that stays, the way to end.
            Err(LinkError::Stopped) if !once => Ok(()),
            ended => Ok(ended?),
        }
    }
}
