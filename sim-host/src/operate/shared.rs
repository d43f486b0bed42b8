//! What the loop and the socket's thread share: the settings one way, the progress of the
//! run the other, each as a whole struct in a triple buffer, so that neither waits.

use std::time::Duration;

use leg_plant::EventKind;
use leg_process::Stop;
use triple_buffer::{Input, Output, triple_buffer};

use crate::session::leg::{Leg, TickRecord};

/// Bars of the histogram of round trips: the first up to 0.25 us, each twice as
/// wide as the one before, the last without an end.
pub const BUCKETS: usize = 20;

/// Time between two checks while a run is paused.
const PAUSE_CHECK: Duration = Duration::from_millis(2);

/// What a user has set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RunSettings {
    /// A set-point in place of the scenario's, m/s.
    pub(super) set_point_m_s: Option<f64>,
    /// Whether a run in lock-step is paused.
    pub(super) is_paused: bool,
    /// Whether the run ends.
    pub(super) is_ended: bool,
}

/// The last tick, and counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RunProgress {
    pub(super) run_id: u32,
    pub(super) seq: u64,
    pub(super) t_s: f64,
    pub(super) x_m: f64,
    pub(super) density_ratio: f64,
    pub(super) ticks: u64,
    pub(super) hops: u64,
    pub(super) falls: u64,
    pub(super) safe_ticks: u64,
    pub(super) held_ticks: u64,
    pub(super) rejected: u32,
    /// Round trips by duration; see [`BUCKETS`].
    pub(super) round_trips: [u32; BUCKETS],
}

/// The loop's side: reads the settings, publishes the progress.
#[derive(Debug)]
pub(super) struct LoopSide {
    settings: Output<RunSettings>,
    /// Whether the leg has yet to be given the set-point.
    is_new: bool,
    progress: RunProgress,
    published: Input<RunProgress>,
}

/// The socket's side: changes the settings, reads the progress.
#[derive(Debug)]
pub(super) struct SocketSide {
    settings: RunSettings,
    published: Input<RunSettings>,
    progress: Output<RunProgress>,
}

/// Returns the two sides of a run.
pub(super) fn pair() -> (LoopSide, SocketSide) {
    let (settings_in, settings_out) = triple_buffer(&RunSettings::default());
    let (progress_in, progress_out) = triple_buffer(&RunProgress::default());
    (
        LoopSide {
            settings: settings_out,
            is_new: false,
            progress: RunProgress::default(),
            published: progress_in,
        },
        SocketSide {
            settings: RunSettings::default(),
            published: settings_in,
            progress: progress_out,
        },
    )
}

impl LoopSide {
    /// Publishes a tick. Takes some nanoseconds.
    pub(super) fn publish(&mut self, tick: &TickRecord<'_>) {
        let progress = &mut self.progress;
        progress.run_id = tick.sample.header.run_id;
        progress.seq = tick.seq;
        progress.t_s = tick.t_s;
        progress.x_m = tick.body.x_m;
        progress.density_ratio = tick.medium.density_ratio();
        progress.rejected = tick.command.rejected;
        progress.ticks += 1;
        progress.safe_ticks += u64::from(tick.command.is_safe());
        progress.held_ticks += u64::from(!tick.is_new);
        for event in tick.events.iter() {
            match event.kind {
                EventKind::Touchdown { .. } => progress.hops += 1,
                EventKind::Fall => progress.falls += 1,
                EventKind::LiftOff | EventKind::Apex => (),
            }
        }
        if tick.is_new {
            let count = &mut progress.round_trips[bucket(tick.round_trip)];
            *count = count.wrapping_add(1);
        }
        self.published.write(*progress);
    }

    /// Gives the leg the set-point of the settings, if they have changed.
    pub(super) fn steer(&mut self, leg: &mut Leg<'_>) {
        let set_point_m_s = self.latest().set_point_m_s;
        if std::mem::take(&mut self.is_new) {
            leg.override_set_point(set_point_m_s);
        }
    }

    /// Waits while the run is paused.
    pub(super) fn wait_while_paused(&mut self, stop: &Stop) {
        while !stop.is_raised() && self.latest().is_paused && !self.latest().is_ended {
            std::thread::sleep(PAUSE_CHECK);
        }
    }

    /// Returns whether the run ends.
    pub(super) fn is_ended(&mut self) -> bool {
        self.latest().is_ended
    }

    fn latest(&mut self) -> RunSettings {
        self.is_new |= self.settings.update();
        *self.settings.output_buffer()
    }
}

impl SocketSide {
    /// Returns the settings.
    pub(super) fn settings(&self) -> RunSettings {
        self.settings
    }

    /// Changes the settings, from the next tick on.
    pub(super) fn set(&mut self, settings: RunSettings) {
        self.settings = settings;
        self.published.write(settings);
    }

    /// Returns the progress of the run.
    pub(super) fn progress(&mut self) -> RunProgress {
        *self.progress.read()
    }
}

/// Returns the bar of a round trip.
fn bucket(time: Duration) -> usize {
    let quarters_us = time.as_nanos() / 250;
    (128 - quarters_us.leading_zeros() as usize).min(BUCKETS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bar_is_twice_as_wide_as_the_one_before() {
        let at = |ns: u64| bucket(Duration::from_nanos(ns));
        assert_eq!((at(0), at(249), at(250), at(499)), (0, 0, 1, 1));
        assert_eq!((at(500), at(999), at(1000), at(1999), at(2000)), (2, 2, 3, 3, 4));
        assert_eq!(at(u64::MAX), BUCKETS - 1);
    }
}
