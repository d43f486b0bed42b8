//! The serial line: a good one loses nothing, and from a bad one nothing false is accepted.

use std::time::Duration;

use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::serial::message::Mode;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;
use leg_host::memory::Inline;
use leg_host::serial::Noisy;
use leg_host::{Link, LinkError};
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::lock_step::{self, Options};

use crate::board::{Flashed, GRAVITY_M_S2, RATE_HZ, image, shipped, skips, ticks};

/// A leg's link to the flashed controller.
struct OverTheLine<'f>(&'f mut Flashed, Option<Command>);

impl Link for OverTheLine<'_> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        self.1 = Some(self.0.command(sample));
        Ok(())
    }

    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.1.take())
    }
}

fn water(ticks: u64) -> Scenario {
    let settings = Settings {
        density_ratio: Some(0.5),
        set_point_m_s: Some(0.3),
        duration_s: Some(ticks as f64 / f64::from(RATE_HZ)),
        ..Settings::default()
    };
    Scenario::from_settings(&settings).expect("a scenario")
}

/// Returns the hash of the run with a controller in this process.
fn hash_here(scenario: &Scenario) -> u64 {
    let config = Config::at_rate(RATE_HZ).unwrap().with_gravity(GRAVITY_M_S2).unwrap();
    let mut controller = WireController::new(Policy::parse(SHIPPED).unwrap(), config);
    let mut link = Inline::new(|sample| controller.tick(Some(sample)));
    lock_step::run(scenario, &mut link, Options::default(), |_| ()).unwrap().state_hash
}

#[test]
fn no_message_is_lost_on_a_good_line() {
    if skips() {
        return;
    }
    let scenario = water(ticks(10_000).min(10_000));
    let mut flashed = Flashed::start(Some(&shipped()));
    flashed.reset(Mode::LockStep);
    let before = flashed.client.counts().commands;
    let mut link = OverTheLine(&mut flashed, None);
    let outcome = lock_step::run(&scenario, &mut link, Options::default(), |_| ()).unwrap();
    assert_eq!(outcome.state_hash, hash_here(&scenario));

    let there = flashed.status();
    let here = *flashed.client.counts();
    println!("{} ticks; there {there:?}; here {here:?}", outcome.ticks);
    // The run, and the sample that ends it.
    assert_eq!(here.commands - before, outcome.ticks + 1);
    assert_eq!(there.run.counts.ticks, outcome.ticks + 1);
    assert_eq!((there.device.lost_bytes, there.device.unsent), (0, 0));
    let bad = there.line.crc_errors + there.line.oversize + there.line.version + there.line.unknown;
    // The first byte on the line may be a stray one.
    assert!(bad == 0 && there.line.malformed <= 1, "{:?}", there.line);
    assert!(
        there.device.stack_used > 0 && there.device.stack_used < there.device.stack_size,
        "{there:?}"
    );
}

#[test]
fn noise_on_the_line_changes_neither_the_run_nor_the_number_of_ticks() {
    if skips() {
        return;
    }
    let scenario = water(ticks(1_000).min(10_000));
    let mut flashed = Flashed::start_image(&image(""), Some(&shipped()), |line| {
        Box::new(Noisy::new(line, 0.01, 3))
    });
    flashed.reset(Mode::LockStep);
    let mut link = OverTheLine(&mut flashed, None);
    let outcome = lock_step::run(&scenario, &mut link, Options::default(), |_| ()).unwrap();
    assert_eq!(outcome.state_hash, hash_here(&scenario), "a false command was accepted");

    let there = flashed.status();
    let (here, line) = (*flashed.client.counts(), *flashed.client.line_counts());
    println!("{} ticks; there {there:?}; here {here:?}, {line:?}", outcome.ticks);
    // Each tick once, however often its sample was sent.
    assert_eq!(there.run.counts.ticks, outcome.ticks + 1);
    assert!(there.run.counts.repeated > 0 && here.sample_retries > 0);
    assert!(there.line.crc_errors > 0 && line.crc_errors > 0);
    assert!(there.line.resyncs > 0 && line.resyncs > 0);
    // Each sample sent arrived as a good or a bad frame, or was split by a zero, or joined to
    // its neighbour by the loss of one.
    let sent = outcome.ticks + 1 + here.sample_retries;
    let l = there.line;
    let arrived = u64::from(l.frames + l.crc_errors + l.malformed + l.oversize + l.version);
    assert!(arrived >= sent && arrived < sent + sent / 2, "sent {sent}, arrived {arrived}");
}
