//! Failures on the board: no policy, a bad one, a panic, a fault.

use std::time::{Duration, Instant};

use leg_control::policy::SHIPPED;
use leg_control::serial::message::{Alarm, BlobError, Crash, Mode, SlotError};
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
use leg_host::serial::client::Received;

use crate::board::{Flashed, image, shipped, skips};

fn sample(seq: u64) -> Sample {
    let header = Header {
        version: WIRE_VERSION,
        flags: flags::STATE_SENSED | flags::CONTACT_SENSED,
        run_id: 3,
        seq,
        t_ns: seq * 1_000_000,
    };
    let t_s = seq as f32 * 1e-3;
    Sample { header, y_m: 2.0 - 4.9 * t_s * t_s, vy_m_s: -9.81 * t_s, ..Sample::default() }
}

#[test]
fn without_a_valid_policy_every_command_is_safe_and_the_slots_report_the_cause() {
    if skips() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let damaged = folder.path().join("damaged.bin");
    let mut bytes = SHIPPED.to_vec();
    bytes[9_000] ^= 4;
    std::fs::write(&damaged, bytes).unwrap();
    for (policy, fault) in
        [(None, SlotError::Empty), (Some(&damaged), SlotError::Blob(BlobError::Crc))]
    {
        let mut flashed = Flashed::start(policy.map(std::path::PathBuf::as_path));
        assert_eq!(flashed.client.identify(Duration::from_secs(5)).unwrap().policy, None);
        let [a, b] = flashed.client.slots().unwrap();
        assert_eq!((a.content, b.content), (Err(fault), Err(SlotError::Empty)));
        flashed.reset(Mode::LockStep);
        for seq in 0..20 {
            let command = flashed.command(&sample(seq));
            assert_eq!(command.header.seq, seq);
            assert_ne!(command.header.flags & flags::SAFE, 0);
            assert_eq!(command.leg_angle_rad, core::f32::consts::FRAC_PI_2);
            assert_eq!((command.elongation_m, command.elongation_rate_m_s), (0.0, 0.0));
        }
    }
}

/// Runs the image whose session number selects a crash. Returns the alarm and the exit status.
/// The board answers the last sample with the safe command first.
fn crash_of(session: u32) -> (Crash, i32) {
    let mut flashed = Flashed::start_image(&image("provoke"), Some(&shipped()), |line| line);
    flashed.begin(session, Mode::LockStep);
    let begun = Instant::now();
    let (mut seq, mut last) = (0, None);
    let crash = 'crash: loop {
        seq += 1;
        // Once the board has ended the sample is lost, but the alarm can still be read.
        flashed.client.post_sample(seq as u32, &sample(seq));
        while last.is_none_or(|(answered, _)| u64::from(answered) != seq) {
            assert!(begun.elapsed() < Duration::from_secs(30), "no crash in {seq} ticks");
            match flashed.client.listen(Duration::from_millis(100)) {
                Ok(Received::Alarm(Alarm::Crash(crash))) => break 'crash crash,
                Ok(Received::Command { seq, command, .. }) => last = Some((seq, command)),
                Ok(_) => (),
                Err(error) => panic!("the line ended before the alarm: {error}"),
            }
        }
    };
    let (seq, command) = last.expect("a command");
    assert_ne!(command.header.flags & flags::SAFE, 0, "{command:?}");
    assert_eq!((seq, command.header.seq, command.header.run_id), (300, 300, 3));
    assert_eq!(command.header.t_ns, sample(300).header.t_ns);
    let status = loop {
        assert!(begun.elapsed() < Duration::from_secs(20), "the emulator has not ended");
        if let Some(status) = flashed.emulator.ended().unwrap() {
            break status.code().expect("an exit status");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    (crash, status)
}

#[test]
fn a_panic_a_fault_and_a_full_stack_send_alarms_and_have_different_exit_statuses() {
    if skips() {
        return;
    }
    let (crash, status) = crash_of(1);
    assert!(matches!(crash, Crash::Panic { line } if line > 0), "{crash:?}");
    assert_eq!(status, 101);
    let (crash, status) = crash_of(2);
    assert!(matches!(crash, Crash::HardFault { pc } if pc > 0), "{crash:?}");
    assert_eq!(status, 102);
    // The address would be on the stack, which has overflowed.
    let (crash, status) = crash_of(3);
    assert_eq!((crash, status), (Crash::HardFault { pc: 0 }, 102));
}

/// `cargo xtask image` checks this for every image; the other image shows that it would find a
/// panic.
#[test]
fn the_image_cannot_panic() {
    if skips() {
        return;
    }
    assert_eq!(image("").ways_to_panic().unwrap(), [""; 0]);
    let ways = image("provoke").ways_to_panic().unwrap();
    assert!(ways.iter().any(|name| name.contains("panic_fmt")), "{ways:?}");
}
