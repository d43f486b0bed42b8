//! The leg's task under a simulated clock.

use std::cell::Cell;

use leg_control::wire::{Command, Sample, flags};
use leg_host::memory::Inline;
use leg_host::realtime::{Clock, LoopCounters, StatsWriter, TickSchedule, run_ticks};
use leg_host::{Link, Role};

use super::*;
use crate::scenario::Settings;
use crate::session::TickRecord;
use crate::session::leg::Leg;
use crate::session::lock_step;

/// A clock that wakes on time, except for one wait that ends late.
struct SimulatedClock {
    now_ns: Cell<u64>,
    late: Cell<Option<(u64, u64)>>,
}

impl SimulatedClock {
    fn punctual() -> Self {
        Self { now_ns: Cell::new(250_000), late: Cell::new(None) }
    }

    /// Wakes late by `by_ns` once, at the first wait that ends after `at_ns`.
    fn late(at_ns: u64, by_ns: u64) -> Self {
        Self { late: Cell::new(Some((at_ns, by_ns))), ..Self::punctual() }
    }
}

impl Clock for SimulatedClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn wait_until_ns(&self, instant_ns: u64) {
        let late_ns = match self.late.get() {
            Some((at_ns, by_ns)) if instant_ns >= at_ns => {
                self.late.set(None);
                by_ns
            }
            _ => 0,
        };
        self.now_ns.set(instant_ns + late_ns);
    }

    fn cpu_time_ns(&self) -> u64 {
        0
    }
}

fn law(sample: &Sample) -> Command {
    Command {
        header: sample.header,
        leg_angle_rad: std::f32::consts::FRAC_PI_2 + 0.1 * sample.vx_m_s,
        elongation_m: 0.001 * sample.y_m,
        ..Command::default()
    }
}

fn scenario(text: &str) -> Scenario {
    Scenario::from_settings(&Settings::from_toml(text).unwrap()).unwrap()
}

/// Plays to the end of the run.
fn play(
    scenario: &Scenario,
    clock: &SimulatedClock,
    on_fall: OnFall,
    law: impl FnMut(&Sample) -> Command,
    hooks: &mut impl Hooks,
) -> (Outcome, LoopCounters) {
    let mut link = Inline::new(law);
    let mut task = LegTask::new(scenario, &mut link, Options { run_id: 1, on_fall }, hooks);
    let (mut log, _rows) = StatsWriter::new(scenario.rate_hz);
    let grid = TickSchedule::of(Role::Leg, scenario.rate_hz);
    run_ticks(clock, grid, &mut task, &mut log, &Stop::default()).unwrap();
    let (leg, ending) = task.finish();
    (leg.outcome(ending.unwrap(), 1.0, RoundTrips::default()), log.counters())
}

#[test]
fn equals_the_lock_step_run_if_every_command_is_in_time() {
    let short = scenario("duration_s = 5.0\n[start]\nvx_m_s = 0.3");
    let lock_step =
        lock_step::run(&short, &mut Inline::new(law), lock_step::Options::default(), |_| ());
    let (outcome, c) = play(&short, &SimulatedClock::punctual(), OnFall::End, law, &mut ());
    assert_eq!(outcome.state_hash, lock_step.unwrap().state_hash);
    assert_eq!((outcome.ticks, outcome.ending), (5000, Ending::Duration));
    assert_eq!((c.received, c.stale, c.missed, c.idle), (5000, 0, 0, 1));
}

/// Keeps the numbers of the samples sent.
struct Counting<L> {
    inner: L,
    sent: Vec<u64>,
}

impl<L: Link<Sends = Sample, Receives = Command>> Link for Counting<L> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        self.sent.push(sample.header.seq);
        self.inner.send(sample)
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<Command>, LinkError> {
        self.inner.receive(timeout)
    }
}

#[test]
fn plays_missed_ticks_at_once_under_the_command_in_force() {
    #[derive(Default)]
    struct Seen(Vec<(u64, u64, bool)>);
    impl Hooks for Seen {
        fn observe(&mut self, tick: &TickRecord<'_>) {
            self.0.push((tick.seq, tick.command.header.seq, tick.is_new));
        }
    }
    let short = scenario("duration_s = 0.02");
    let clock = SimulatedClock::late(8_000_000, 3_400_000);
    let mut link = Counting { inner: Inline::new(law), sent: Vec::new() };
    let mut seen = Seen::default();
    let mut task = LegTask::new(&short, &mut link, Options::default(), &mut seen);
    let (mut log, _rows) = StatsWriter::new(1000);
    run_ticks(&clock, TickSchedule::of(Role::Leg, 1000), &mut task, &mut log, &Stop::default())
        .unwrap();
    let (leg, _) = task.finish();
    assert_eq!(leg.ticks(), 20, "time does not wait");
    let c = log.counters();
    assert_eq!((c.ticks, c.missed, c.stale), (21, 3, 0));
    // The first sample at 1.25 ms, so the seventh tick is due at 8.25 ms, and played at 11.65 ms.
    assert_eq!(
        &seen.0[5..11],
        [(5, 5, true), (6, 6, true), (7, 6, false), (8, 6, false), (9, 6, false), (10, 10, true),]
    );
    assert_eq!(&link.sent[6..8], [6, 10], "only the newest sample is sent");
}

#[test]
fn a_silent_controller_leaves_the_leg_safe_after_ten_ticks() {
    /// Drops the commands that answer a range of samples.
    struct DropsCommands<L>(L, std::ops::Range<u64>, u64);
    impl<L: Link<Sends = Sample, Receives = Command>> Link for DropsCommands<L> {
        type Sends = Sample;
        type Receives = Command;

        fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
            self.2 = sample.header.seq;
            self.0.send(sample)
        }

        fn receive(&mut self, timeout: Duration) -> Result<Option<Command>, LinkError> {
            let command = self.0.receive(timeout)?;
            Ok(command.filter(|_| !self.1.contains(&self.2)))
        }
    }
    let short = scenario("duration_s = 0.2");
    let mut link = DropsCommands(Inline::new(law), 50..100, 0);
    let mut hooks = ();
    let mut task = LegTask::new(&short, &mut link, Options::default(), &mut hooks);
    let (mut log, _rows) = StatsWriter::new(1000);
    let grid = TickSchedule::of(Role::Leg, 1000);
    run_ticks(&SimulatedClock::punctual(), grid, &mut task, &mut log, &Stop::default()).unwrap();
    let (leg, ending) = task.finish();
    let outcome = leg.outcome(ending.unwrap(), 1.0, RoundTrips::default());
    assert_eq!((log.counters().stale, log.counters().safe), (50, 41));
    assert_eq!((outcome.silences, outcome.safe_ticks, outcome.ticks), (1, 41, 200));
}

#[test]
fn restarts_a_fallen_leg_if_configured() {
    let mut run_ids = Vec::new();
    let lying = |sample: &Sample| {
        if sample.header.flags & flags::END == 0 && run_ids.last() != Some(&sample.header.run_id) {
            run_ids.push(sample.header.run_id);
        }
        Command { leg_angle_rad: 0.0, ..law(sample) }
    };
    let long = scenario("duration_s = 5.0");
    let (outcome, c) = play(&long, &SimulatedClock::punctual(), OnFall::Restart, lying, &mut ());
    assert_eq!((outcome.ending, outcome.ticks), (Ending::Duration, 5000));
    assert!(outcome.restarts >= 3, "{}", outcome.restarts);
    assert_eq!(outcome.report().falls, outcome.restarts);
    assert_eq!(run_ids, (1..=outcome.restarts + 1).collect::<Vec<_>>());
    assert_eq!(c.received + c.stale + c.idle, c.ticks);

    let lying = |sample: &Sample| Command { leg_angle_rad: 0.0, ..law(sample) };
    let (outcome, _) = play(&long, &SimulatedClock::punctual(), OnFall::End, lying, &mut ());
    assert_eq!((outcome.ending, outcome.report().falls), (Ending::Fall, 1));
}

#[test]
fn holds_the_leg_at_its_start_for_a_limited_time() {
    // A controller that answers only another run's samples.
    let foreign = |sample: &Sample| {
        let mut command = law(sample);
        command.header.run_id += 1;
        command
    };
    let short = scenario("duration_s = 0.5");
    let (outcome, c) = play(&short, &SimulatedClock::punctual(), OnFall::End, foreign, &mut ());
    assert_eq!((outcome.ticks, c.idle, c.stale), (500, 1000, 500));
    assert_eq!((outcome.safe_ticks, c.safe), (500, 500));
}

/// Regression: a request between the sending of a sample and its tick changed the recorded one.
#[test]
fn observers_see_the_samples_that_were_sent_also_when_the_set_point_changes() {
    #[derive(Default)]
    struct Steers {
        calls: u32,
        seen: Vec<Sample>,
    }
    impl Hooks for Steers {
        fn steer(&mut self, leg: &mut Leg<'_>) {
            self.calls += 1;
            leg.override_set_point(Some(1e-4 * f64::from(self.calls)));
        }
        fn observe(&mut self, tick: &TickRecord<'_>) {
            self.seen.push(*tick.sample);
        }
    }
    let noisy = scenario("duration_s = 0.5\n[[fault]]\nnoise = 0.05");
    let mut received = Vec::new();
    let law = |sample: &Sample| {
        received.push(*sample);
        law(sample)
    };
    let mut hooks = Steers::default();
    let clock = SimulatedClock::late(8_000_000, 3_400_000);
    let (outcome, _) = play(&noisy, &clock, OnFall::End, law, &mut hooks);
    assert_eq!((outcome.ticks, outcome.faults[0].touched), (500, 500));
    received.retain(|sample| sample.header.flags & flags::END == 0);
    assert!(received.len() > 490, "{}", received.len());
    for sample in received {
        let seen = hooks.seen[sample.header.seq as usize];
        assert_eq!(seen, sample);
    }
}
