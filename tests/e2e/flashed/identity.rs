//! Host and firmware return the same commands for the same samples, bit for bit: hopping in
//! water, over the shore and on land, with bad samples of every kind, changed set-points, resets
//! and swapped policies in between.

use std::time::Duration;

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::serial::message::{Mode, Request};
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;
use leg_host::serial::upload::upload;
use leg_host::{Link, LinkError};
use rand::RngExt;
use rand_pcg::Pcg64;
use sim_host::replay::difference;
use sim_host::scenario::{DensitySense, Scenario, Settings, StartSettings};
use sim_host::session::lock_step::{self, Options};

use crate::bad_samples::BadSamples;
use crate::board::{Flashed, RATE_HZ, shipped, skips, ticks};
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
    /// Whether the estimate was lost and has not begun again.
    is_lost: bool,
    /// Estimates lost, and apexes decided, since the last reset.
    lost_since_reset: u32,
    decided_since_reset: u32,
}

/// Counts of what the test has covered.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) ticks: u64,
    bad: u64,
    resets: u64,
    swaps: u64,
    set_points: u64,
    /// Apexes of the leg, and those for which the controller decided on an action.
    apexes: u64,
    pub(crate) decided: u64,
    /// Ticks with an estimate in flight and in stance; ticks at which it was lost, and began
    /// again afterwards.
    pub(crate) in_flight: u64,
    pub(crate) in_stance: u64,
    pub(crate) lost: u64,
    pub(crate) recovered: u64,
    /// All flags of the samples, before a fault of the line.
    pub(crate) flags: u16,
    /// Ticks in water and on land.
    pub(crate) in_water: u64,
    pub(crate) on_land: u64,
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
            is_lost: false,
            lost_since_reset: 0,
            decided_since_reset: 0,
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
        self.counts.decided += u64::from(here.apexes > self.decided_since_reset);
        self.decided_since_reset = here.apexes;
        self.count_estimate();
        here
    }

    fn count_estimate(&mut self) {
        let lost = self.host.counts().estimates_lost;
        if lost > self.lost_since_reset {
            (self.lost_since_reset, self.is_lost) = (lost, true);
            self.counts.lost += 1;
        }
        if let Some(estimate) = self.host.estimate() {
            self.counts.in_stance += u64::from(estimate.in_stance);
            self.counts.in_flight += u64::from(!estimate.in_stance);
            self.counts.recovered += u64::from(std::mem::take(&mut self.is_lost));
        }
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
        (self.is_lost, self.lost_since_reset) = (false, 0);
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

/// Returns the shore scenario, shortened so that the run reaches the land. Its density is
/// estimated and measured in turn.
pub(crate) fn settings(run: u64, left: u64) -> Settings {
    let density =
        if run.is_multiple_of(2) { DensitySense::Estimated } else { DensitySense::Measured };
    Settings {
        density_profile: Some(vec![[6.0, 1.0], [9.0, 0.0]]),
        set_point_m_s: Some(0.5),
        duration_s: Some(left.min(40_000) as f64 / f64::from(RATE_HZ)),
        start: StartSettings { x_m: Some(3.0), ..StartSettings::default() },
        density: Some(density),
        ..Settings::default()
    }
}

/// Plays runs until a controller has had so many ticks, and compares it with the flashed one.
pub(crate) fn compare(
    flashed: &mut Flashed,
    wanted: u64,
    scenario: impl Fn(u64, u64) -> Scenario,
) -> Counts {
    let mut both = HostAndFirmware::new(flashed, 1);
    let (mut run, mut flags, mut in_water, mut on_land) = (0, 0, 0, 0);
    while both.counts.ticks < wanted {
        run += 1;
        let options = Options { run_id: run as u32, ..Options::default() };
        let scenario = scenario(run, wanted - both.counts.ticks);
        let outcome = lock_step::run(&scenario, &mut both, options, |tick| {
            flags |= tick.sample.header.flags;
            in_water += u64::from(tick.medium.density_ratio() >= 1.0);
            on_land += u64::from(tick.medium.density_ratio() <= 0.0);
        });
        both.counts.apexes += outcome.expect("a run").apexes;
    }
    let counts = Counts { flags, in_water, on_land, ..both.counts };
    println!("{run} runs, {counts:?}\n{:?}", flashed.status());
    assert!(counts.bad > wanted / 100, "{counts:?}");
    assert!(counts.apexes >= wanted / 2_000 && counts.decided > 0, "{counts:?}");
    counts
}

/// Checks that the controller was reset, got other policies and other set-points.
pub(crate) fn assert_changed(counts: &Counts) {
    assert!(counts.resets >= 1 && counts.swaps >= 1 && counts.set_points >= 1, "{counts:?}");
}

#[test]
fn host_and_firmware_give_the_same_commands_bit_for_bit() {
    if skips() {
        return;
    }
    let counts = compare(&mut Flashed::start(Some(&shipped())), ticks(12_000), |run, left| {
        Scenario::from_settings(&settings(run, left)).expect("a scenario")
    });
    assert_changed(&counts);
}
