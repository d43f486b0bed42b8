//! `--record`: a recording beside a run, or none.

use std::path::Path;

use leg_control::policy::Policy;
use leg_host::Pace;
use leg_host::realtime::{Listener, Word};

use super::misuse;
use crate::record::schema::{Config, End, Loop, Policy as PolicyMessage};
use crate::record::{OnFull, PolicyWatch, RecordError, Recorder, Tap};
use crate::scenario::{Scenario, Settings};
use crate::session::{Hooks, Options, Outcome, TickRecord};

/// A recording under way, if one is wanted.
#[derive(Debug, Default)]
pub(super) struct Recording(Option<Active>);

#[derive(Debug)]
struct Active {
    tap: Tap,
    policies: Option<PolicyWatch>,
    recorder: Recorder,
}

impl Recording {
    /// Begins one at `path`, if there is one.
    pub(super) fn begin(
        path: Option<&Path>,
        settings: &Settings,
        scenario: &Scenario,
        pace: Pace,
    ) -> anyhow::Result<Self> {
        let Some(path) = path else { return Ok(Self(None)) };
        let config = Config::of(settings, scenario, pace)
            .map_err(|cause| misuse(format!("the scenario cannot be recorded: {cause}")))?;
        let on_full = match pace {
            Pace::LockStep => OnFull::Wait,
            Pace::RealTime => OnFull::Drop,
        };
        let (recorder, tap) = Recorder::begin(path, &config, on_full).map_err(misuse)?;
        Ok(Self(Some(Active { tap, policies: None, recorder })))
    }

    /// The policy of this process's own controller.
    pub(super) fn policy(&self, blob: &[u8], policy: &Policy<'_>) {
        if let Some(active) = &self.0 {
            active.recorder.notes().policy(PolicyMessage::of(
                blob,
                policy,
                Options::default().run_id,
                0,
            ));
        }
    }

    /// From now on asks the controller in `domain` what it runs in the run `run_id`.
    pub(super) fn ask_for_policies(&mut self, domain: &str, run_id: u32) {
        if let Some(active) = &mut self.0 {
            let notes = active.recorder.notes();
            active.policies = Some(PolicyWatch::begin(domain, run_id, notes));
        }
    }

    /// What is to see the rows of the loop, to record them too.
    pub(super) fn listener(&self) -> Option<Listener> {
        let notes = self.0.as_ref()?.recorder.notes();
        Some(Listener::new(move |row| {
            // Outside of a run there is no tick to speak of.
            if matches!(row.word, Word::New | Word::Stale) {
                notes.loop_row(Loop::of(row));
            }
        }))
    }

    /// Takes in a tick.
    pub(super) fn push(&mut self, tick: &TickRecord<'_>) {
        if let Some(active) = &mut self.0 {
            active.tap.push(tick);
        }
    }

    /// Finishes the file. It says on stderr what of the run is not in it.
    pub(super) fn finish(
        self,
        outcome: Result<&Outcome, &anyhow::Error>,
    ) -> Result<(), RecordError> {
        let Some(Active { policies, recorder, .. }) = self.0 else { return Ok(()) };
        drop(policies);
        let end = match outcome {
            Ok(outcome) => End::of(outcome),
            Err(error) => End::broken_off(error),
        };
        let recorded = recorder.finish(end)?;
        if recorded.dropped > 0 {
            eprintln!(
                "sim-host: warning: the recording lacks {} ticks and events, for which its ring \
                 had no room; is the machine too busy?",
                recorded.dropped
            );
        }
        Ok(())
    }
}

impl Hooks for Recording {
    fn observe(&mut self, tick: &TickRecord<'_>) {
        self.push(tick);
    }
}
