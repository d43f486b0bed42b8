//! Host and firmware return the same commands for the same samples, bit for bit: hopping in water, over the shore and on land, with bad samples of
//! every kind, changed set-points, resets and swapped policies in between.

use std::time::Duration;

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::serial::message::{Estimator, Mode, Request, RequestError, SessionParams};
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;
use leg_host::serial::client::{ClientError, IDENTIFY_TIMEOUT};
use leg_host::serial::upload::upload;
use leg_host::{Link, LinkError};
use rand::RngExt;
use rand_pcg::Pcg64;
use sim_host::replay::difference;
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::lock_step::{self, Options};

use crate::bad_samples::BadSamples;
use crate::board::{Flashed, RATE_HZ, image, shipped, skips, ticks};
use crate::policies::sibling;

/// A leg's link to two controllers at once: one in this process, and the flashed one.
struct HostAndFirmware<'f> {
    flashed: &'f mut Flashed,
    host: WireController<'static>,
    config: Config,
    policies: [&'static [u8]; 2],
    /// Index of the one uploaded last.
    current: usize,
    set_point_m_s: Option<f32>,
    bad_samples: BadSamples,
    rng: Pcg64,
    reply: Option<Command>,
    counts: Counts,
}

/// Ticks with the estimator; `cargo xtask soak` plays 100,000.
const ESTIMATED_TICKS: u64 = 8_000;

/// Counts of what the test has covered.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    ticks: u64,
    bad: u64,
    resets: u64,
    swaps: u64,
    set_points: u64,
    apexes: u64,
}

fn policy(blob: &'static [u8]) -> Policy<'static> {
    Policy::parse(blob).expect("a policy")
}

impl<'f> HostAndFirmware<'f> {
    fn new(flashed: &'f mut Flashed, seed: u64) -> Self {
        flashed.reset(Mode::LockStep);
        let config = flashed.params.config().expect("valid parameters");
        Self {
            flashed,
            host: WireController::new(policy(SHIPPED), config),
            config,
            policies: [SHIPPED, sibling()],
            current: 0,
            set_point_m_s: None,
            bad_samples: BadSamples::new(seed),
            rng: Pcg64::new(seed.into(), 9),
            reply: None,
            counts: Counts::default(),
        }
    }

    /// Plays a tick on both and returns their command, which must be the same.
    fn tick(&mut self, sample: &Sample) -> Command {
        let set_point_m_s = self.set_point_m_s.unwrap_or(sample.set_point_m_s);
        let here = self.host.tick(Some(&Sample { set_point_m_s, ..*sample }));
        let there = self.flashed.command(sample);
        let found = difference(&here, &there);
        assert!(found.is_none(), "tick {}: {found:#?} for {sample:#?}", self.counts.ticks);
        self.bad_samples.sent(sample);
        self.counts.ticks += 1;
        here
    }

    fn change_something_at_random(&mut self) {
        match self.rng.random_range(0..6_000) {
            0..2 => self.reset(),
            2..5 => self.swap(),
            5..9 => self.change_set_point(),
            _ => (),
        }
    }

    fn reset(&mut self) {
        self.flashed.reset(Mode::LockStep);
        self.host = WireController::new(policy(self.policies[self.current]), self.config);
        self.set_point_m_s = None;
        self.counts.resets += 1;
    }

    fn swap(&mut self) {
        if self.host.swap_is_pending() {
            return;
        }
        self.current = 1 - self.current;
        let blob = self.policies[self.current];
        upload(&mut self.flashed.client, &policy(blob), blob, "", Duration::ZERO, |_| ()).unwrap();
        self.host.swap(policy(blob));
        self.counts.swaps += 1;
    }

    fn change_set_point(&mut self) {
        let wanted = self.rng.random_range(-0.5_f32..0.5);
        self.set_point_m_s = self.rng.random_bool(0.5).then_some(wanted);
        self.flashed.client.have_done(&Request::SetPoint(self.set_point_m_s)).unwrap();
        self.counts.set_points += 1;
    }
}

impl Link for HostAndFirmware<'_> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, good: &Sample) -> Result<(), LinkError> {
        self.change_something_at_random();
        let mut reply = None;
        for _ in 0..self.bad_samples.burst() {
            let bad = self.bad_samples.bad(good);
            reply = Some(self.tick(&bad));
            self.counts.bad += 1;
        }
        // Sometimes the bad sample replaces the good one.
        let instead = reply.filter(|_| self.rng.random_bool(0.3));
        let mut command = instead.unwrap_or_else(|| self.tick(good));
        // The leg accepts the command, whichever sample it answers.
        command.header = leg_control::wire::Header { flags: command.header.flags, ..good.header };
        self.reply = Some(command);
        Ok(())
    }

    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }
}

/// Returns the shore scenario, shortened so that the run reaches the land.
fn scenario(run: u64, left: u64) -> Scenario {
    Scenario::from_settings(&settings(run, left)).expect("a scenario")
}

fn settings(run: u64, left: u64) -> Settings {
    let start = sim_host::scenario::StartSettings { x_m: Some(3.0), ..Default::default() };
    Settings {
        density_profile: Some(vec![[6.0, 1.0], [9.0, 0.0]]),
        set_point_m_s: Some(0.5),
        duration_s: Some(left.min(40_000) as f64 / f64::from(RATE_HZ)),
        start,
        // Estimated and measured in turn.
        density: Some(if run.is_multiple_of(2) {
            sim_host::scenario::DensitySense::Estimated
        } else {
            sim_host::scenario::DensitySense::Measured
        }),
        ..Settings::default()
    }
}

/// Plays runs until a controller has had so many ticks, and compares it with the flashed one.
fn compare(flashed: &mut Flashed, wanted: u64, scenario: impl Fn(u64, u64) -> Scenario) -> Counts {
    let mut both = HostAndFirmware::new(flashed, 1);
    let mut run = 0;
    while both.counts.ticks < wanted {
        run += 1;
        let options = Options { run_id: run as u32, ..Options::default() };
        let scenario = scenario(run, wanted - both.counts.ticks);
        let outcome = lock_step::run(&scenario, &mut both, options, |_| ()).expect("a run");
        both.counts.apexes += outcome.apexes;
    }
    let counts = both.counts;
    println!("{run} runs, {counts:?}\n{:?}", flashed.status());
    assert!(counts.bad > wanted / 100, "{counts:?}");
    assert!(counts.apexes >= wanted / 2_000, "{counts:?}");
    assert!(counts.resets >= 1 && counts.swaps >= 1 && counts.set_points >= 1, "{counts:?}");
    counts
}

#[test]
fn host_and_firmware_give_the_same_commands_bit_for_bit() {
    if skips() {
        return;
    }
    compare(&mut Flashed::start(Some(&shipped())), ticks(12_000), scenario);
}

/// Noisy, late and lost readings, and all other sensors beside them.
const HARSH: &str = r#"
sensors = "trained-with"

[sensor]
accelerometer-rate = 1600
leg-angle-rate = 1000
gyro-rate = 1000
pitch-rate = 100
velocity-rate = 10
height-rate = 10
pressure-rate = 50

[[fault]]
noise = 0.3

[[fault]]
noise = 0.02
field = "contact"

[[fault]]
jitter = 5

[[fault]]
drop = 0.1

[[fault]]
duplicate = 0.02

[[fault]]
reorder = 0.02

[[fault]]
corrupt = 0.02
bits = 2

[[fault]]
freeze = 30

[[fault]]
stuck = 20
field = "y"

[[fault]]
nan = 0.02
"#;

#[test]
fn with_the_estimator_they_do_so_under_faults_of_every_kind() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start_image(&image("estimator"), Some(&shipped()), |stream| stream);
    flashed.params.stale_limit_ns = 60_000_000;
    flashed.params.estimator =
        Estimator::State { velocity_m_s: 0.02, height_m: 0.01, leg_length_m: 0.002 };
    let harsh = Settings::from_toml(HARSH).expect("valid settings");
    compare(&mut flashed, ticks(ESTIMATED_TICKS), |run, left| {
        let base = Settings { seed: Some(run), ..harsh.clone() };
        let mut scenario = Scenario::from_settings(&settings(run, left).over(base)).unwrap();
        // The leg holds commands as long.
        scenario.stale_limit_ns = 60_000_000;
        scenario
    });
}

#[test]
fn firmware_without_the_estimator_refuses_it_by_name() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    let estimator = Estimator::State { velocity_m_s: 0.1, height_m: 0.1, leg_length_m: 0.1 };
    let params = SessionParams { estimator, ..flashed.params };
    let refused = flashed.client.have_done(&Request::Reset { session: 3, params }).unwrap_err();
    assert!(matches!(refused, ClientError::Refused(RequestError::NoEstimator)), "{refused}");
    assert!(refused.to_string().contains("flash firmware built with the feature `estimator`"));
    // Nothing has changed.
    assert_eq!(flashed.client.identify(IDENTIFY_TIMEOUT).unwrap().session, None);
}
