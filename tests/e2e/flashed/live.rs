//! Live mode: the board's own timer starts the ticks, and each uses the newest sample.

use std::time::{Duration, Instant};

use leg_control::serial::message::Mode;
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
use leg_host::serial::client::Received;

use crate::board::{Flashed, PATIENCE, shipped, skips};

/// Returns a sample of a leg at rest in mid-air: only number and time change.
fn sample(seq: u64) -> Sample {
    let header = Header {
        version: WIRE_VERSION,
        flags: flags::STATE_SENSED | flags::CONTACT_SENSED | flags::DENSITY_SENSED,
        run_id: 1,
        seq,
        t_ns: seq * 1_000_000,
    };
    Sample { header, y_m: 2.0, density_ratio: 1.0, ..Sample::default() }
}

#[test]
fn the_timer_ticks_without_samples_and_counts_the_missed_ones() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    flashed.reset(Mode::Live);
    let begun = Instant::now();
    let (mut seq, mut commands, mut safe) = (0, 0_u32, 0_u32);
    let mut receive = |flashed: &mut Flashed, for_ms: u64| {
        let until = Instant::now() + Duration::from_millis(for_ms);
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            if let Received::Command { command, .. } = flashed.client.listen(left).unwrap() {
                commands += 1;
                safe += u32::from(command.is_safe());
            }
        }
    };
    // One sample in about four ticks.
    for _ in 0..100 {
        seq += 4;
        flashed.client.post_sample(seq as u32, &sample(seq));
        receive(&mut flashed, 4);
    }
    // The last of them may still be on the line.
    let fed = flashed.status_after(seq);
    // Then none: the ticks continue, in the safe state. The emulator's clock may stand still
    // for a while on a busy machine, and catches up.
    let mut starved = fed;
    while starved.run.counts.ticks < fed.run.counts.ticks + 20 {
        assert!(begun.elapsed() < PATIENCE, "the ticks stopped: {starved:?}");
        receive(&mut flashed, 200);
        starved = flashed.status();
    }
    let seconds = begun.elapsed().as_secs_f64();
    println!("fed {fed:?}\nstarved {starved:?}\n{commands} commands in {seconds:.2} s");

    assert!(
        (starved.run.counts.ticks as f64) < 1_200.0 * seconds + 50.0,
        "{starved:?} in {seconds} s"
    );
    assert!(fed.run.counts.missed > 0 && fed.run.counts.ticks > fed.run.counts.missed, "{fed:?}");
    assert_eq!(
        starved.run.counts.missed - fed.run.counts.missed,
        starved.run.counts.ticks - fed.run.counts.ticks,
        "no sample came"
    );
    let last = flashed.command(&sample(seq + 1_000));
    assert_ne!(last.header.flags & flags::SAFE, 0, "without samples it stays in the safe state");
}
