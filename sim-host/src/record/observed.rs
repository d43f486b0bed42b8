//! A run as an observer sees it: by its messages, without its true states.

use std::time::{SystemTime, UNIX_EPOCH};

use foxglove::Schema;
use leg_control::wire::{Command, Sample, WIRE_VERSION};
use leg_host::TimeMode;
use leg_plant::{Body, Phase};
use std::time::Duration;

use super::display::DisplayTopic;
use super::feeder::SideMessage;
use super::file::PROTOBUF;
use super::pipe::{self, Frame, FrameBuffer};
use super::recorder::RecordSink;
use super::schema::{Channel, Config, DESCRIPTORS, LOCK_STEP, REAL_TIME};
use super::tap::{Known, TickCopy};
use super::translate::Translator;
use crate::scenario::Settings;

/// A position in the plane of the motion: x and height, m.
type Position = (f64, f64);

impl TickCopy {
    /// Creates the tick of a sample as an observer sees it: with the command in force, which is
    /// new at this tick or an earlier one, the positions of foot and mass where they are known,
    /// and the density ratio of the medium.
    pub(crate) fn observed(
        sample: &Sample,
        command: &Command,
        is_new: bool,
        place: Option<[Position; 2]>,
        density_ratio: f64,
    ) -> Self {
        let [foot, mass] = place.unwrap_or_default();
        let (vx_m_s, vy_m_s) = (sample.vx_m_s.into(), sample.vy_m_s.into());
        let phase = if sample.is_in_contact() {
            Phase::Stance { foot_x_m: foot.0, foot_y_m: foot.1 }
        } else {
            Phase::Flight
        };
        Self {
            seq: sample.header.seq,
            t_s: 1e-9 * sample.header.t_ns as f64,
            body: Body { x_m: mass.0, vx_m_s, y_m: mass.1, vy_m_s },
            phase,
            known: if place.is_some() { Known::Place } else { Known::Nothing },
            density_ratio,
            sample: *sample,
            command: *command,
            is_new,
            round_trip: Duration::ZERO,
        }
    }
}

/// What an observer knows of the configuration of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ObservedRun {
    /// Ticks per second.
    pub(crate) rate_hz: u32,
    /// Gravity of the controller, m/s2.
    pub(crate) gravity_m_s2: f32,
    /// Lock-step or real time.
    pub(crate) time_mode: TimeMode,
    /// Density of the medium over that of water.
    pub(crate) density_ratio: f64,
}

impl ObservedRun {
    /// Describes the run, whose time began at `started_unix_ns`, for a recording.
    ///
    /// # Errors
    /// If a number cannot be represented in TOML.
    pub(crate) fn config(&self, started_unix_ns: u64) -> Result<Config, toml::ser::Error> {
        let Self { rate_hz, gravity_m_s2, density_ratio, .. } = *self;
        let settings = Settings {
            rate_hz: Some(rate_hz),
            gravity_m_s2: Some(gravity_m_s2.into()),
            density_ratio: Some(density_ratio),
            ..Settings::default()
        };
        Ok(Config {
            scenario_toml: toml::to_string(&settings)?,
            sim_host_version: env!("CARGO_PKG_VERSION").to_owned(),
            wire_version: WIRE_VERSION.into(),
            rate_hz,
            gravity_m_s2,
            time_mode: match self.time_mode {
                TimeMode::LockStep => LOCK_STEP,
                TimeMode::RealTime => REAL_TIME,
            }
            .to_owned(),
            command_line: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
            started_unix_ns,
        })
    }
}

/// Returns the time, ns since 1970 began.
pub(crate) fn now_unix_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as u64
}

/// Returns the name and the schema of each topic of a recording, in the order of their numbers.
pub(crate) fn topics() -> Vec<(&'static str, Schema)> {
    let ours = Channel::ALL
        .iter()
        .map(|channel| (channel.topic(), Schema::new(channel.schema(), PROTOBUF, DESCRIPTORS)));
    let display = DisplayTopic::ALL.iter().map(|topic| (topic.name(), topic.schema()));
    ours.chain(display).collect()
}

/// The messages of a recording, while the run goes on.
#[derive(Debug)]
pub(crate) struct LiveMessages {
    config: Config,
    translator: Translator,
    frames: FrameBuffer,
    changes: std::sync::mpsc::Receiver<SideMessage>,
}

impl LiveMessages {
    /// Begins with the configuration, and `display_rate_hz` pictures per second of simulated
    /// time. Returns the sink for what changes the commands beside the samples, too.
    pub(crate) fn begin(config: Config, display_rate_hz: u32) -> (Self, RecordSink) {
        let (sender, changes) = std::sync::mpsc::channel();
        let translator = Translator::new(&config, display_rate_hz);
        let mut frames = FrameBuffer::default();
        translator.begin(&config, &mut frames);
        (Self { config, translator, frames, changes }, RecordSink::new(sender))
    }

    /// Adds a tick.
    pub(crate) fn tick(&mut self, tick: &TickCopy) {
        self.translator.tick(tick, &mut self.frames);
        while let Ok(change) = self.changes.try_recv() {
            self.translator.side(&change, &mut self.frames);
        }
    }

    /// Repeats what is sent only once, with the next tick: for who has come later, or because
    /// the medium has another density now.
    pub(crate) fn repeat(&mut self, density_ratio: f64) {
        self.frames.add(self.config.started_unix_ns, &self.config);
        self.translator.redraw(density_ratio);
    }

    /// Returns the latest time of a message, ns since 1970 began.
    pub(crate) fn latest_ns(&self) -> u64 {
        self.frames.latest_ns()
    }

    /// Passes number of the topic, time in ns since 1970 began, and bytes of each message that
    /// was added since the last call.
    pub(crate) fn take(&mut self, mut each: impl FnMut(usize, u64, &[u8])) {
        let mut bytes = self.frames.as_slice();
        let mut buffer = Vec::new();
        while let Ok(Some(frame)) = pipe::read(&mut bytes, &mut buffer) {
            if let Frame::Message { topic, log_time_ns, message, .. } = frame {
                each(topic, log_time_ns, message);
            }
        }
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    use leg_control::wire::{Header, flags};

    use super::*;

    fn tick(seq: u64, command: &Command, place: Option<[Position; 2]>) -> TickCopy {
        let flags = flags::STATE_SENSED;
        let header = Header { seq, t_ns: 1_000_000 * seq, flags, ..Header::default() };
        TickCopy::observed(&Sample { header, ..Sample::default() }, command, true, place, 1.0)
    }

    fn taken(live: &mut LiveMessages) -> Vec<&'static str> {
        let topics = topics();
        let mut names = Vec::new();
        live.take(|topic, _, _| names.push(topics[topic].0));
        names
    }

    #[test]
    fn an_observer_has_no_true_state_and_draws_the_leg_only_where_it_knows_it() {
        let run = ObservedRun {
            rate_hz: 1000,
            gravity_m_s2: 9.81,
            time_mode: TimeMode::LockStep,
            density_ratio: 1.0,
        };
        let (mut live, _) = LiveMessages::begin(run.config(1).unwrap(), 50);
        assert_eq!(taken(&mut live), ["/config", "/log"]);
        live.tick(&tick(0, &Command::default(), None));
        assert_eq!(taken(&mut live), ["/sample", "/command"]);
        let place = Some([(0.0, 0.0), (0.0, 1.0)]);
        live.tick(&tick(7, &Command::default(), place));
        let drawn = taken(&mut live);
        for topic in ["/sample", "/command", "/tf", "/scene", "/points/leg", "/points/ground"] {
            assert!(drawn.contains(&topic), "{drawn:?}");
        }
        // One picture for each 20 ms, also if its first tick was missed.
        live.tick(&tick(19, &Command::default(), place));
        assert_eq!(taken(&mut live), ["/sample", "/command"]);
        live.tick(&tick(21, &Command::default(), place));
        let drawn = taken(&mut live);
        assert!(drawn.contains(&"/tf") && !drawn.contains(&"/points/ground"), "{drawn:?}");
        live.repeat(0.5);
        live.tick(&tick(41, &Command { apexes: 1, ..Command::default() }, place));
        let all = taken(&mut live);
        for topic in ["/config", "/points/ground", "/apex", "/log"] {
            assert!(all.contains(&topic), "{all:?}");
        }
        assert!(!all.contains(&"/state"), "{all:?}");
    }
}
