//! Live: the board's own timer is the tick, the newest sample counts.

use std::time::{Duration, Instant};

use leg_control::serial::message::Mode;
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
use leg_host::serial::client::Received;

use crate::board::{Flashed, shipped, skips};

/// A leg at rest in mid-air: nothing but the stamps changes.
fn sample(seq: u64) -> Sample {
    let header = Header {
        version: WIRE_VERSION,
        flags: flags::CONTACT_SENSED | flags::DENSITY_SENSED,
        run_id: 1,
        seq,
        t_ns: seq * 1_000_000,
    };
    Sample { header, y_m: 2.0, density_ratio: 1.0, ..Sample::default() }
}

#[test]
fn the_timer_ticks_whether_samples_come_or_not_and_counts_what_it_missed() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    flashed.reset(Mode::Live);
    let begun = Instant::now();
    let (mut seq, mut commands, mut safe) = (0, 0_u32, 0_u32);
    let mut hear = |flashed: &mut Flashed, for_ms: u64| {
        let until = Instant::now() + Duration::from_millis(for_ms);
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            if let Received::Command { command, .. } = flashed.client.listen(left).unwrap() {
                commands += 1;
                safe += u32::from(command.is_safe());
            }
        }
    };
    // One sample in some four ticks.
    for _ in 0..100 {
        seq += 4;
        flashed.client.post_sample(seq as u32, &sample(seq));
        hear(&mut flashed, 4);
    }
    let fed = flashed.status();
    // Then none: it goes on ticking, in the safe state.
    hear(&mut flashed, 200);
    let starved = flashed.status();
    let seconds = begun.elapsed().as_secs_f64();
    println!("fed {fed:?}\nstarved {starved:?}\n{commands} commands in {seconds:.2} s");

    // The emulator's clock may stand still for a while on a busy machine, and
    // catches up: between a tenth and all of the ticks.
    assert!(starved.run.counts.ticks as f64 > 100.0 * seconds, "{starved:?} in {seconds} s");
    assert!(
        (starved.run.counts.ticks as f64) < 1_200.0 * seconds + 50.0,
        "{starved:?} in {seconds} s"
    );
    assert!(fed.run.counts.missed > 0 && fed.run.counts.ticks > fed.run.counts.missed, "{fed:?}");
    assert!(starved.run.counts.ticks - fed.run.counts.ticks >= 20, "it stood still");
    assert_eq!(
        starved.run.counts.missed - fed.run.counts.missed,
        starved.run.counts.ticks - fed.run.counts.ticks,
        "no sample came"
    );
    let last = flashed.command(&sample(seq + 1_000));
    assert_ne!(last.header.flags & flags::SAFE, 0, "starved, it waits in the safe state");
}
