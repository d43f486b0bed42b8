//! The option `--record`: a recording beside a run, or none.

use leg_process::{check_apart, stderr};
use std::path::{Path, PathBuf};

use leg_control::estimator::Estimate;
use leg_control::policy::Policy;
use leg_control::serial::message::Estimator;
use leg_host::TimeMode;
use leg_host::realtime::{RxStatus, TickObserver};

use super::misuse;
use crate::record::config;
use crate::record::schema::{End, Policy as PolicyMessage};
use crate::record::{ChangePoller, OnFull, RecordError, RecordOptions, RecordTap, Recorder};
use crate::scenario::{Scenario, Settings};
use crate::session::{Hooks, Options, Outcome, TickRecord};

/// The options of a recording.
#[derive(Debug, clap::Args)]
pub(super) struct RecordArgs {
    /// Record every tick to an MCAP file, for `replay`, `plot` and other programs.
    #[arg(long, value_name = "FILE")]
    pub(super) record: Option<PathBuf>,
    /// Pictures of the leg per second in the recording, for viewers such as Foxglove and Rerun; 0
    /// leaves out all that is for viewers.
    #[arg(long, value_name = "HZ", requires = "record", default_value_t = DISPLAY_RATE_HZ)]
    display_rate: u32,
}

/// Pictures per second unless given: twice those of a film.
pub(super) const DISPLAY_RATE_HZ: u32 = 50;

/// A recording in progress, if one was requested.
#[derive(Debug, Default)]
pub(super) struct Recording(Option<Active>);

#[derive(Debug)]
struct Active {
    tap: RecordTap,
    changes: Option<ChangePoller>,
    recorder: Recorder,
}

impl Recording {
    /// Starts a recording if there is a file for it, which must be none of the `other` files of the run.
    pub(super) fn begin<'a>(
        args: &RecordArgs,
        other: impl IntoIterator<Item = &'a Path>,
        settings: &Settings,
        scenario: &Scenario,
        time_mode: TimeMode,
    ) -> anyhow::Result<Self> {
        let Some(path) = args.record.as_deref() else { return Ok(Self(None)) };
        check_apart(path, other).map_err(|error| {
            misuse(format!("cannot write the recording {}: {error}", path.display()))
        })?;
        let config = config::of_run(settings, scenario, time_mode)
            .map_err(|cause| misuse(format!("the scenario cannot be recorded: {cause}")))?;
        let on_full = match time_mode {
            TimeMode::LockStep => OnFull::Wait,
            TimeMode::RealTime => OnFull::Drop,
        };
        let options = RecordOptions { on_full, display_rate_hz: args.display_rate };
        let (recorder, tap) = Recorder::begin(path, &config, options).map_err(misuse)?;
        Ok(Self(Some(Active { tap, changes: None, recorder })))
    }

    /// Records the policy of a controller in this process.
    pub(super) fn policy(&self, blob: &[u8], policy: &Policy<'_>) {
        if let Some(active) = &self.0 {
            let run_id = Options::default().run_id;
            active.recorder.sink().policy(PolicyMessage::of(blob, policy, run_id, 0));
        }
    }

    /// Records how the control law runs; `stepped` in turn with the leg, in this thread.
    pub(super) fn law(&self, estimator: Estimator, stale_limit_ns: u64, stepped: bool) {
        if let Some(active) = &self.0 {
            active.recorder.sink().law(config::of_law(estimator, stale_limit_ns, stepped));
        }
    }

    /// Starts to poll the controller in `domain` for the policies and set-points of a run.
    pub(super) fn poll_changes(&mut self, domain: &str, run_id: u32) {
        if let Some(active) = &mut self.0 {
            let sink = active.recorder.sink();
            active.changes = Some(ChangePoller::begin(domain, run_id, sink));
        }
    }

    /// Returns an observer that records the timing of the leg's loop.
    pub(super) fn tick_observer(&self) -> Option<TickObserver> {
        let sink = self.0.as_ref()?.recorder.sink();
        Some(TickObserver::new(move |tick| {
            // Other records belong to no tick of a run.
            if matches!(tick.rx, RxStatus::New | RxStatus::Stale) {
                sink.timing(config::of_tick(tick));
            }
        }))
    }

    /// Records a tick, and the estimate of a controller in this process after its sample.
    pub(super) fn push(&mut self, tick: &TickRecord<'_>, estimate: Option<Estimate>) {
        if let Some(active) = &mut self.0 {
            active.tap.push_estimated(tick, estimate);
        }
    }

    /// Completes the file, and warns on stderr if ticks are missing.
    pub(super) fn finish(
        self,
        outcome: Result<&Outcome, &anyhow::Error>,
    ) -> Result<(), RecordError> {
        let Some(Active { changes, recorder, .. }) = self.0 else { return Ok(()) };
        drop(changes);
        let end = match outcome {
            Ok(outcome) => config::of_end(outcome),
            Err(error) => End::broken_off(error),
        };
        let summary = recorder.finish(end)?;
        if summary.dropped > 0 {
            stderr::print_line(format_args!(
                "sim-host: warning: {} ticks and events are missing from the recording, because \
                 its buffer was full; the machine may be too busy",
                summary.dropped
            ));
        }
        Ok(())
    }
}

impl Hooks for Recording {
    fn observe(&mut self, tick: &TickRecord<'_>) {
        self.push(tick, None);
    }

    fn before_end(&mut self) {
        if let Some(active) = &mut self.0 {
            active.changes = None;
        }
    }
}
