//! Host and firmware, given the same samples, return the same commands, to the
//! last bit: hopping in water, over the shore and on land, with bad samples of
//! every kind, changed set-points, resets and swapped policies in between.

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
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::lock_step::{self, Options};

use crate::board::{Flashed, GRAVITY_M_S2, RATE_HZ, bits, shipped, skips, ticks};
use crate::policies::sibling;
use crate::senses::BadSenses;

/// A leg's link to both: a controller in this process, and the flashed one.
struct Twins<'f> {
    flashed: &'f mut Flashed,
    host: WireController<'static>,
    policies: [&'static [u8]; 2],
    /// Which of them was uploaded last.
    current: usize,
    set_point_m_s: Option<f32>,
    senses: BadSenses,
    rng: Pcg64,
    reply: Option<Command>,
    did: Did,
}

/// What happened, for the proof that it did.
#[derive(Clone, Copy, Debug, Default)]
struct Did {
    ticks: u64,
    bad: u64,
    resets: u64,
    swaps: u64,
    set_points: u64,
    apexes: u64,
}

fn config() -> Config {
    Config::at_rate(RATE_HZ).unwrap().with_gravity(GRAVITY_M_S2).unwrap()
}

fn policy(blob: &'static [u8]) -> Policy<'static> {
    Policy::parse(blob).expect("a policy")
}

impl<'f> Twins<'f> {
    fn new(flashed: &'f mut Flashed, seed: u64) -> Self {
        flashed.reset(Mode::LockStep);
        Self {
            flashed,
            host: WireController::new(policy(SHIPPED), config()),
            policies: [SHIPPED, sibling()],
            current: 0,
            set_point_m_s: None,
            senses: BadSenses::new(seed),
            rng: Pcg64::new(seed.into(), 9),
            reply: None,
            did: Did::default(),
        }
    }

    /// The same tick for both; their one command.
    fn tick(&mut self, sample: &Sample) -> Command {
        let set_point_m_s = self.set_point_m_s.unwrap_or(sample.set_point_m_s);
        let here = self.host.tick(Some(&Sample { set_point_m_s, ..*sample }));
        let there = self.flashed.command(sample);
        assert_eq!(
            bits(&here),
            bits(&there),
            "tick {}: {here:#?} here, {there:#?} there, for {sample:#?}",
            self.did.ticks
        );
        self.senses.sent(sample);
        self.did.ticks += 1;
        here
    }

    fn perhaps_something_else(&mut self) {
        match self.rng.random_range(0..6_000) {
            0..2 => self.reset(),
            2..5 => self.swap(),
            5..9 => self.change_set_point(),
            _ => (),
        }
    }

    fn reset(&mut self) {
        self.flashed.reset(Mode::LockStep);
        self.host = WireController::new(policy(self.policies[self.current]), config());
        self.set_point_m_s = None;
        self.did.resets += 1;
    }

    fn swap(&mut self) {
        if self.host.swap_is_pending() {
            return;
        }
        self.current = 1 - self.current;
        let blob = self.policies[self.current];
        upload(&mut self.flashed.client, &policy(blob), blob, "", Duration::ZERO, |_| ()).unwrap();
        self.host.swap(policy(blob));
        self.did.swaps += 1;
    }

    fn change_set_point(&mut self) {
        let wanted = self.rng.random_range(-0.5_f32..0.5);
        self.set_point_m_s = self.rng.random_bool(0.5).then_some(wanted);
        self.flashed.client.have_done(&Request::SetPoint(self.set_point_m_s)).unwrap();
        self.did.set_points += 1;
    }
}

impl Link for Twins<'_> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, good: &Sample) -> Result<(), LinkError> {
        self.perhaps_something_else();
        let mut reply = None;
        for _ in 0..self.senses.burst() {
            let bad = self.senses.spoilt(good);
            reply = Some(self.tick(&bad));
            self.did.bad += 1;
        }
        // Now and then the bad one comes in place of the good one.
        let instead = reply.filter(|_| self.rng.random_bool(0.3));
        let mut command = instead.unwrap_or_else(|| self.tick(good));
        // The leg does what it is told, whatever that answered.
        command.header = leg_control::wire::Header { flags: command.header.flags, ..good.header };
        self.reply = Some(command);
        Ok(())
    }

    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }
}

/// The way ashore, shorter, so that all of it is met.
fn scenario(run: u64, left: u64) -> Scenario {
    let start = sim_host::scenario::StartSettings { x_m: Some(3.0), ..Default::default() };
    let settings = Settings {
        density_profile: Some(vec![[6.0, 1.0], [9.0, 0.0]]),
        set_point_m_s: Some(0.5),
        duration_s: Some(left.min(40_000) as f64 / f64::from(RATE_HZ)),
        start,
        // Told or estimated, in turn.
        density: Some(if run.is_multiple_of(2) {
            sim_host::scenario::DensitySense::Estimated
        } else {
            sim_host::scenario::DensitySense::Measured
        }),
        ..Settings::default()
    };
    Scenario::from_settings(&settings).expect("a scenario")
}

#[test]
fn host_and_firmware_give_the_same_commands_bit_for_bit() {
    if skips() {
        return;
    }
    let wanted = ticks(12_000);
    let mut flashed = Flashed::start(Some(&shipped()));
    let mut twins = Twins::new(&mut flashed, 1);
    let mut run = 0;
    while twins.did.ticks < wanted {
        run += 1;
        let options = Options { run_id: run as u32, ..Options::default() };
        let scenario = scenario(run, wanted - twins.did.ticks);
        let outcome = lock_step::run(&scenario, &mut twins, options, |_| ()).expect("a run");
        twins.did.apexes += outcome.apexes;
    }
    let did = twins.did;
    println!("{run} runs, {did:?}\n{:?}", flashed.status());
    assert!(did.bad > wanted / 100, "{did:?}");
    assert!(did.apexes >= wanted / 2_000, "it hops: {did:?}");
    assert!(did.resets >= 1 && did.swaps >= 1 && did.set_points >= 1, "{did:?}");
}
