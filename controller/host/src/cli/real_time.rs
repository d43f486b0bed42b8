//! The controller process in real time.

use super::attend::{Attendant, summary};
use super::{Args, CliError, Summary, other_leg, say};
use crate::Role;
use crate::link::LinkError;
use crate::realtime::{self, Ends, Served, Shared};
use leg_control::policy::Manifest;

impl Attendant {
    /// Ticks by the clock, whoever is there or not.
    pub(super) fn attend_in_real_time(
        mut self,
        args: &Args,
        figures: Shared,
        mut tell: impl FnMut(&Summary),
    ) -> Result<(), CliError> {
        if self.once {
            self.wait()?;
        }
        let once = self.once;
        let ends = if once { Ends::AtFarewell } else { Ends::Never };
        let options = args.real_time.options(Role::Controller, args.rate, figures);
        let manifest: Manifest<'static> = self.controller.controller().policy().manifest().clone();
        let greet = move |peer: crate::shm::Peer| {
            if let Some(warning) = other_leg(&manifest, peer.leg) {
                say(warning);
            }
        };
        let (gave_up, look) = realtime::watch(&self.link, &self.stop, self.patience, greet);
        let Served { ended, samples, last, report } =
            realtime::serve(self.link, &mut self.controller, ends, &options, &self.stop, look);
        tell(&Summary {
            real_time: Some(report),
            ..summary(&self.controller, samples, last.apexes)
        });
        match gave_up.get().cloned().map_or(ended, Err) {
            // For one that stays, the way to end.
            Err(LinkError::Stopped) if !once => Ok(()),
            ended => Ok(ended?),
        }
    }
}
