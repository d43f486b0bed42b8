//! The receiver against anything that a line can bring.

use crate::spec::examples;
use leg_control::checksum::crc32;
use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::frame::{
    FrameError, MAX_FRAME, MAX_PAYLOAD, Receiver, TooLongError, UnknownMessageError, decode, encode,
};
use leg_control::serial::message::{LineCounts, Request, ToController, ToHost};
use leg_control::wire::{Header, Sample};
use proptest::prelude::*;

fn frame_of(message: &impl serde::Serialize) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).unwrap().to_vec()
}

fn sample_frame() -> Vec<u8> {
    let header = Header { version: 1, flags: 3, run_id: 2, seq: 70_000, t_ns: 70_000_000_000 };
    let sample = Sample { header, vx_m_s: 1.25, y_m: 2.0, vy_m_s: -0.5, ..Sample::default() };
    frame_of(&ToController::Sample { seq: 9, sample })
}

/// Payloads of the good frames in these bytes.
fn payloads(receiver: &mut Receiver, bytes: &[u8]) -> Vec<Vec<u8>> {
    bytes.iter().filter_map(|&byte| receiver.push(byte)?.ok().map(<[u8]>::to_vec)).collect()
}

/// What every run of bytes between two zeros is counted as.
fn counted(counts: &LineCounts) -> u32 {
    counts.frames + counts.crc_errors + counts.malformed + counts.oversize + counts.version
}

/// A frame of any body, valid but for what the body is.
fn raw_frame(version: u8, payload: &[u8]) -> Vec<u8> {
    let mut body = vec![version];
    body.extend(payload);
    body.extend(crc32(&body).to_le_bytes());
    let mut frame = vec![0];
    for group in body.split(|&byte| byte == 0) {
        frame.push(group.len() as u8 + 1);
        frame.extend(group);
    }
    frame.push(0);
    frame
}

/// What postcard itself makes of these bytes, all of them.
fn all_of<'p, T: serde::Deserialize<'p>>(payload: &'p [u8]) -> Option<T> {
    postcard::take_from_bytes(payload).ok().and_then(|(m, rest)| rest.is_empty().then_some(m))
}

/// To compare by: a NaN is not itself.
fn text(message: &impl core::fmt::Debug) -> String {
    format!("{message:?}")
}

/// Noise as a line has it: any bytes, with zeros, short and long codes in plenty.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![4 => any::<u8>(), 1 => Just(0), 1 => 1_u8..6, 1 => Just(0xff)];
    prop::collection::vec(byte, 0..600)
}

proptest! {
    #[test]
    fn whatever_comes_every_run_between_zeros_is_counted_once(bytes in noise()) {
        let mut receiver = Receiver::new();
        let mut ends = 0;
        for &byte in &bytes {
            ends += u32::from(receiver.push(byte).is_some());
        }
        let last_zero = bytes.iter().rposition(|&byte| byte == 0).unwrap_or(0);
        let runs = bytes[..last_zero].split(|&byte| byte == 0).filter(|run| !run.is_empty());
        prop_assert_eq!(counted(receiver.counts()), runs.count() as u32);
        prop_assert_eq!(ends, counted(receiver.counts()));
    }

    #[test]
    fn after_any_noise_a_good_frame_is_received_with_its_own_last_byte(bytes in noise()) {
        let mut receiver = Receiver::new();
        payloads(&mut receiver, &bytes);
        let frame = sample_frame();
        let (last, start) = frame.split_last().unwrap();
        prop_assert!(payloads(&mut receiver, start).is_empty());
        let payload = receiver.push(*last).unwrap().unwrap();
        prop_assert!(decode::<ToController<'_>>(payload).is_ok());
    }

    #[test]
    fn noise_within_a_frame_costs_that_frame_and_no_other(
        bytes in prop::collection::vec(1_u8.., 1..40), at in 2_usize..40,
    ) {
        let frame = sample_frame();
        let mut spoilt = frame.clone();
        spoilt.splice(at..at, bytes);
        let mut receiver = Receiver::new();
        prop_assert!(payloads(&mut receiver, &spoilt).is_empty());
        prop_assert_eq!(payloads(&mut receiver, &frame).len(), 1);
        prop_assert_eq!((receiver.counts().frames, receiver.counts().resyncs), (1, 1));
    }

    #[test]
    fn any_payload_comes_through(payload in prop::collection::vec(any::<u8>(), 0..=MAX_PAYLOAD)) {
        let frame = raw_frame(PROTOCOL_VERSION, &payload);
        prop_assert_eq!(payloads(&mut Receiver::new(), &frame), vec![payload]);
    }

    #[test]
    fn any_payload_is_read_as_postcard_reads_it(
        start in prop::array::uniform4(0_u8..12),
        rest in prop::collection::vec(prop_oneof![any::<u8>(), 0_u8..4], 0..90),
    ) {
        let payload = [&start[..], &rest].concat();
        let found = decode::<ToController<'_>>(&payload).ok();
        prop_assert_eq!(text(&found), text(&all_of::<ToController<'_>>(&payload)));
        let found = decode::<ToHost<'_>>(&payload).ok();
        prop_assert_eq!(text(&found), text(&all_of::<ToHost<'_>>(&payload)));
    }
}

#[test]
fn a_changed_byte_never_decodes_to_another_message() {
    let frame = sample_frame();
    for at in 0..frame.len() {
        for value in 0..=u8::MAX {
            let mut spoilt = frame.clone();
            spoilt[at] = value;
            let mut receiver = Receiver::new();
            let got = payloads(&mut receiver, &spoilt);
            // The first zero may go: nothing came before it. And a changed
            // last byte leaves the frame open, for the next border to end.
            let may_pass = value == frame[at];
            if at == 0 || may_pass {
                continue;
            }
            assert!(got.is_empty(), "byte {at} set to {value}");
            assert_eq!(receiver.counts().frames, 0);
        }
    }
}

#[test]
fn drops_a_frame_that_is_cut_off_and_accepts_the_next_one() {
    let frame = sample_frame();
    for len in 0..frame.len() - 1 {
        let mut receiver = Receiver::new();
        let mut bytes = frame[..len].to_vec();
        bytes.extend(&frame);
        assert_eq!(payloads(&mut receiver, &bytes).len(), 1, "cut to {len}");
        assert_eq!(counted(receiver.counts()), if len > 1 { 2 } else { 1 });
    }
}

#[test]
fn accepts_the_longest_frame_and_counts_a_longer_one_as_oversize() {
    let mut receiver = Receiver::new();
    let frame = raw_frame(PROTOCOL_VERSION, &[7; MAX_PAYLOAD]);
    assert_eq!(frame.len(), MAX_FRAME);
    assert_eq!(payloads(&mut receiver, &frame).len(), 1);
    let frame = raw_frame(PROTOCOL_VERSION, &[7; MAX_PAYLOAD + 1]);
    let last = frame.iter().filter_map(|&byte| receiver.push(byte).map(|r| r.map(|_| ()))).last();
    assert_eq!(last, Some(Err(FrameError::Oversize)));
    assert_eq!(receiver.counts().oversize, 1);
}

#[test]
fn a_stream_without_borders_counts_as_one_oversize_frame() {
    for byte in [0xff, 1, 0x55] {
        let mut receiver = Receiver::new();
        for _ in 0..1_000_000 {
            assert!(receiver.push(byte).is_none());
        }
        assert_eq!(payloads(&mut receiver, &sample_frame()).len(), 1);
        let expected = LineCounts { frames: 1, oversize: 1, resyncs: 1, ..LineCounts::ZERO };
        assert_eq!(*receiver.counts(), expected);
    }
}

#[test]
fn distinguishes_another_version_from_damage() {
    let mut receiver = Receiver::new();
    let frame = raw_frame(PROTOCOL_VERSION + 1, &[1, 2, 3]);
    let got = frame.iter().find_map(|&byte| receiver.push(byte).map(|r| r.map(|_| ())));
    assert_eq!(got, Some(Err(FrameError::Version(PROTOCOL_VERSION + 1))));
    let expected = LineCounts { version: 1, ..LineCounts::ZERO };
    assert_eq!(*receiver.counts(), expected);
}

/// That what goes over the line is what postcard itself makes of it, and reads.
#[test]
fn a_payload_is_the_message_encoded_by_postcard() {
    let (to_controller, to_host) = examples();
    let mut buffer = [0; 256];
    for message in to_controller {
        let payload = payloads(&mut Receiver::new(), &frame_of(&message)).remove(0);
        assert_eq!(postcard::to_slice(&message, &mut buffer).unwrap(), payload);
        assert_eq!(postcard::from_bytes(&payload), Ok(message));
    }
    for message in to_host {
        let payload = payloads(&mut Receiver::new(), &frame_of(&message)).remove(0);
        assert_eq!(postcard::to_slice(&message, &mut buffer).unwrap(), payload);
        assert_eq!(postcard::from_bytes(&payload), Ok(message));
    }
}

#[test]
fn every_message_fits_a_frame_and_decodes_to_itself() {
    let (to_controller, to_host) = examples();
    for message in to_controller {
        let payload = payloads(&mut Receiver::new(), &frame_of(&message)).remove(0);
        assert_eq!(decode(&payload), Ok(message));
    }
    for message in to_host {
        let payload = payloads(&mut Receiver::new(), &frame_of(&message)).remove(0);
        assert_eq!(decode(&payload), Ok(message));
    }
}

#[test]
fn a_message_with_trailing_bytes_is_unknown() {
    let message = ToController::Request { id: 1, request: Request::Identify };
    let mut payload = payloads(&mut Receiver::new(), &frame_of(&message)).remove(0);
    assert_eq!(decode(&payload), Ok(message));
    payload.push(0);
    assert_eq!(decode::<ToController<'_>>(&payload), Err(UnknownMessageError));
}

#[test]
fn refuses_a_message_that_is_too_long() {
    assert_eq!(encode(&[1.0_f32; 32], &mut [0; MAX_FRAME]).map(<[u8]>::len), Ok(128 + 8));
    let too_long = "x".repeat(MAX_PAYLOAD);
    assert_eq!(encode(&too_long, &mut [0; MAX_FRAME]), Err(TooLongError));
}
