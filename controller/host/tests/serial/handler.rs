//! Requests, uploads and roll-backs.

use crate::rig::{DEVICE, HOP_TICKS, Rig, crc32_of, factory, is_safe, small_blob};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use leg_control::serial::endpoint::Endpoint;
use leg_control::serial::frame::{MAX_FRAME, Receiver, decode, encode};
use leg_control::serial::handler::RequestHandler;
use leg_control::serial::message::{
    Alarm, BlobError, DeviceCounts, Estimator, MAX_CHUNK, MAX_NAME, Mode, Reply, Request,
    RequestError, SessionParams, Slot, SlotError, ToController, ToHost, cut,
};
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::serial::slots::{FlashSlots, MappedFlash, SEAL_LEN};
use leg_control::wire::WIRE_VERSION;
use leg_host::flash::{LockedNode, MemoryFlash};

#[test]
fn an_uploaded_policy_runs_from_the_next_apex_on_and_after_a_power_up() {
    let (old, new) = (small_blob("old"), small_blob("new"));
    let mut rig = Rig::power_up(factory(&old));
    assert_eq!((rig.alarm, rig.name()), (None, "old"));
    rig.hop();
    rig.upload(&new).unwrap();
    assert_eq!(rig.name(), "old");
    assert_eq!(rig.begin(&new), Err(RequestError::SwapPending));
    assert_eq!(rig.order(&Request::RollBack), Err(RequestError::SwapPending));
    rig.ticks(HOP_TICKS);
    let running = rig.running().unwrap();
    assert_eq!((running.name, running.slot, running.crc32), ("new", Slot::B, crc32_of(&new)));
    let [a, b] = rig.slots();
    assert_eq!((a.sequence, a.running, a.content), (0, false, Ok(("old", crc32_of(&old)))));
    assert_eq!((b.sequence, b.running, b.content), (1, true, Ok(("new", crc32_of(&new)))));
    assert_eq!(rig.power_cycled().name(), "new");

    rig.order(&Request::RollBack).unwrap();
    assert_eq!(rig.name(), "new");
    rig.ticks(HOP_TICKS);
    assert_eq!(rig.name(), "old");
    assert_eq!(rig.power_cycled().name(), "old");
    let back = RequestError::NothingToRollBackTo(SlotError::RolledBack);
    assert_eq!(rig.order(&Request::RollBack), Err(back));
}

#[test]
fn an_upload_cut_at_any_chunk_leaves_the_running_policy_running() {
    let (old, new) = (small_blob("old"), small_blob("new"));
    let chunks = new.len().div_ceil(MAX_CHUNK);
    assert!(chunks > 4);
    for sent in 0..=chunks {
        let mut rig = Rig::power_up(factory(&old));
        rig.hop();
        rig.begin(&new).unwrap();
        for number in 0..sent {
            rig.chunk(&new, number).unwrap();
            assert!(!is_safe(&rig.tick()));
        }
        if sent < chunks {
            let received = (sent * MAX_CHUNK) as u32;
            let incomplete = RequestError::Incomplete { received, length: new.len() as u32 };
            assert_eq!(rig.order(&Request::Verify), Err(incomplete));
            assert_eq!(rig.order(&Request::Commit), Err(incomplete));
        }
        assert!(!is_safe(&rig.ticks(2 * HOP_TICKS)));
        assert_eq!(rig.name(), "old");
        assert_eq!(rig.slots()[1].content, Err(SlotError::Unfinished));
        let mut again = rig.power_cycled();
        assert_eq!((again.alarm, again.name()), (None, "old"));
        // And the next upload goes through.
        again.upload(&new).unwrap();
        assert_eq!(again.name(), "new");
    }
}

#[test]
fn an_upload_with_any_byte_flipped_leaves_the_running_policy_running() {
    let (old, new) = (small_blob("old"), small_blob("new"));
    let mut rig = Rig::power_up(factory(&old));
    rig.hop();
    for at in 0..new.len() {
        let mut spoilt = new.clone();
        spoilt[at] ^= 1 << (at % 8);
        // Announced as what it should have been.
        rig.order(&Request::Begin { length: new.len() as u32, crc32: crc32_of(&new), origin: "" })
            .unwrap();
        for number in 0..new.len().div_ceil(MAX_CHUNK) {
            rig.chunk(&spoilt, number).unwrap();
        }
        assert!(matches!(rig.order(&Request::Verify), Err(RequestError::Blob(_))), "byte {at}");
        assert!(matches!(rig.order(&Request::Commit), Err(RequestError::Blob(_))), "byte {at}");
        assert!(!is_safe(&rig.tick()));
        assert_eq!(rig.name(), "old");
        if at % 16 == 0 {
            assert_eq!(rig.power_cycled().name(), "old");
        }
    }
}

#[test]
fn a_hundred_uploads_and_swaps_while_hopping_miss_no_tick() {
    let blobs = ["even", "odd"].map(small_blob);
    let mut rig = Rig::power_up(factory(&small_blob("first")));
    rig.order(&Request::Reset {
        session: 1,
        params: SessionParams { rate_hz: 1_000, gravity_m_s2: 9.81, ..SessionParams::default() },
    })
    .unwrap();
    rig.hop();
    let mut ticks = HOP_TICKS / 4;
    for round in 0..100 {
        let blob = &blobs[round % 2];
        rig.begin(blob).unwrap();
        for number in 0..blob.len().div_ceil(MAX_CHUNK) {
            rig.chunk(blob, number).unwrap();
            assert!(!is_safe(&rig.tick()));
            ticks += 1;
        }
        rig.order(&Request::Commit).unwrap();
        while rig.node.with(|node| node.status(None).run.pending.is_some()) {
            assert!(!is_safe(&rig.tick()));
            ticks += 1;
        }
        assert_eq!(rig.name(), ["even", "odd"][round % 2]);
        assert_eq!(ticks % HOP_TICKS, 1, "swapped in at the tick of an apex");
    }
    let counts = rig.counts();
    assert_eq!(counts.swaps, 100);
    assert_eq!((counts.ticks, counts.missed), (ticks, 0));
    let [a, b] = rig.slots();
    assert_eq!((a.sequence.max(b.sequence), a.sequence.abs_diff(b.sequence)), (100, 1));
    assert_eq!(rig.power_cycled().name(), "odd");
}

#[test]
fn a_repeated_request_is_answered_again_and_executed_once() {
    let (old, new) = (small_blob("old"), small_blob("new"));
    let mut rig = Rig::power_up(factory(&old));
    let begin = Request::Begin { length: new.len() as u32, crc32: crc32_of(&new), origin: "" };
    assert_eq!(rig.ask_as(70, &begin), Reply::Done);
    let first = Request::Chunk { offset: 0, bytes: &new[..MAX_CHUNK] };
    assert_eq!(rig.ask_as(71, &first), Reply::Done);
    // Were it done again, the upload would begin anew.
    assert_eq!(rig.ask_as(71, &first), Reply::Done);
    let second = Request::Chunk { offset: MAX_CHUNK as u32, bytes: &new[MAX_CHUNK..2 * MAX_CHUNK] };
    assert_eq!(rig.ask_as(72, &second), Reply::Done);
    // Under a new number, too: it is there.
    assert_eq!(rig.ask_as(73, &first), Reply::Done);
    let too_far = Request::Chunk { offset: 4 * MAX_CHUNK as u32, bytes: &new[..4] };
    let refused = Reply::Refused(RequestError::Offset { expected: 2 * MAX_CHUNK as u32 });
    assert_eq!(rig.ask_as(74, &too_far), refused);
    assert_eq!(rig.ask_as(74, &too_far), refused);
    for number in 2..new.len().div_ceil(MAX_CHUNK) {
        rig.chunk(&new, number).unwrap();
    }
    assert_eq!(rig.ask_as(90, &Request::Commit), Reply::Done);
    assert_eq!(rig.ask_as(90, &Request::Commit), Reply::Done);
    assert_eq!(rig.ask_as(91, &Request::Commit), Reply::Refused(RequestError::NotBegun));
    assert_eq!(rig.counts().repeated, 3);
    // A question is answered afresh, and its number then is the last one.
    assert!(matches!(rig.ask_as(91, &Request::Identify), Reply::Identity(_)));
    assert_eq!(rig.ask_as(91, &Request::RollBack), Reply::Done);
    assert_eq!(rig.name(), "old");
}

#[test]
fn refuses_values_out_of_range_with_the_limit() {
    let mut rig = Rig::power_up(factory(&small_blob("old")));
    let reset = |rate_hz, gravity_m_s2| Request::Reset {
        session: 2,
        params: SessionParams { rate_hz, gravity_m_s2, ..SessionParams::default() },
    };
    assert_eq!(rig.order(&reset(49, 9.81)), Err(RequestError::Rate { least: 50, most: 20_000 }));
    assert_eq!(rig.order(&reset(1_000, f32::NAN)), Err(RequestError::Gravity));
    let with = |params| Request::Reset { session: 2, params };
    let late = SessionParams { stale_limit_ns: 1_000_000_001, ..SessionParams::default() };
    let refused = RequestError::StaleLimit { least_ns: 50_000, most_ns: 1_000_000_000 };
    assert_eq!(rig.order(&with(late)), Err(refused));
    let estimator = Estimator::State { velocity_m_s: 0.0, height_m: 0.1, leg_length_m: 0.1 };
    let exact = SessionParams { estimator, ..SessionParams::default() };
    assert_eq!(rig.order(&with(exact)), Err(RequestError::Noise));
    for bad in [f32::NAN, f32::INFINITY, -50.5] {
        let refused = Err(RequestError::SetPoint { most_m_s: 50.0 });
        assert_eq!(rig.order(&Request::SetPoint(Some(bad))), refused);
    }
    let room = 2048 - SEAL_LEN as u32;
    let begin = |length| Request::Begin { length, crc32: 0, origin: "" };
    assert_eq!(rig.order(&begin(room + 1)), Err(RequestError::TooLong { room }));
    assert_eq!(rig.order(&begin(u32::MAX)), Err(RequestError::TooLong { room }));
    for request in [Request::Verify, Request::Commit, Request::Chunk { offset: 0, bytes: &[1] }] {
        assert_eq!(rig.order(&request), Err(RequestError::NotBegun));
    }
    rig.order(&begin(room)).unwrap();
    let at_0: [&[u8]; 3] = [&[], &[1, 2, 3], &[0; MAX_CHUNK + 4]];
    for bytes in at_0 {
        let refused = Err(RequestError::Offset { expected: 0 });
        assert_eq!(rig.order(&Request::Chunk { offset: 0, bytes }), refused, "{}", bytes.len());
    }
    let empty = Err(RequestError::NothingToRollBackTo(SlotError::Unfinished));
    assert_eq!(rig.order(&Request::RollBack), empty);
    assert_eq!(rig.name(), "old");
}

#[test]
fn refuses_a_valid_policy_that_is_not_the_announced_one() {
    let (old, new) = (small_blob("old"), small_blob("new"));
    let mut rig = Rig::power_up(factory(&old));
    rig.order(&Request::Begin { length: new.len() as u32, crc32: 1, origin: "" }).unwrap();
    for number in 0..new.len().div_ceil(MAX_CHUNK) {
        rig.chunk(&new, number).unwrap();
    }
    let wrong = Err(RequestError::WrongBlob { crc32: crc32_of(&new) });
    assert_eq!((rig.order(&Request::Verify), rig.order(&Request::Commit)), (wrong, wrong));
}

#[test]
fn without_a_policy_the_alarm_names_the_cause_and_an_upload_runs_at_once() {
    let blob = small_blob("only");
    let mut spoilt = blob.clone();
    spoilt[100] ^= 1;
    let empty = MemoryFlash::with_slot_len(2048);
    let mut rig = Rig::power_up(empty.clone().loaded(Slot::B, &spoilt));
    let (a, b) = (SlotError::Empty, SlotError::Blob(BlobError::Crc));
    assert_eq!((rig.alarm, rig.running()), (Some(Alarm::NoPolicy { a, b }), None));
    rig.order(&Request::SetMode(Mode::LockStep)).unwrap();
    assert!(is_safe(&rig.tick()));
    assert_eq!(rig.order(&Request::RollBack), Err(RequestError::NoPolicy));
    rig.upload(&blob).unwrap();
    assert_eq!(rig.name(), "only");
    assert!(!is_safe(&rig.ticks(HOP_TICKS)));
}

#[test]
fn of_two_policies_at_power_up_a_runs_and_a_roll_back_runs_b() {
    let [a, b] = ["a", "b"].map(small_blob);
    let mut rig = Rig::power_up(factory(&a).loaded(Slot::B, &b));
    assert_eq!(rig.name(), "a");
    rig.order(&Request::RollBack).unwrap();
    assert_eq!((rig.name(), rig.power_cycled().name()), ("b", "b"));
    assert_eq!(rig.slots()[0].content, Err(SlotError::RolledBack));
}

#[test]
fn flash_full_of_zeros_counts_as_erased() {
    let mut image = vec![0; 2048];
    let blob = small_blob("zeros");
    image[..blob.len()].copy_from_slice(&blob);
    let flash = MemoryFlash::with_slot_len(2048).loaded(Slot::B, &vec![0; 2048]);
    let mut rig = Rig::power_up(flash.loaded(Slot::A, &image));
    assert_eq!(rig.name(), "zeros");
    assert_eq!(rig.slots()[1].content, Err(SlotError::Empty));
    rig.upload(&small_blob("ones")).unwrap();
    assert_eq!(rig.power_cycled().name(), "ones");
}

/// Flash that stops the processor while it erases.
#[derive(Clone)]
struct Stalling(MemoryFlash);

impl ErrorType for Stalling {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Stalling {
    const READ_SIZE: usize = MemoryFlash::READ_SIZE;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.0.read(offset, bytes)
    }
    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Stalling {
    const WRITE_SIZE: usize = MemoryFlash::WRITE_SIZE;
    const ERASE_SIZE: usize = MemoryFlash::ERASE_SIZE;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0.erase(from, to)
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0.write(offset, bytes)
    }
}

impl MappedFlash for Stalling {
    const ERASE_STALLS: bool = true;
    fn mapped(&self) -> &'static [u8] {
        self.0.mapped()
    }
}

#[test]
fn refuses_an_erase_that_stalls_in_live_mode() {
    let blob = small_blob("old");
    let mut rig = Rig::power_up(Stalling(factory(&blob)));
    rig.order(&Request::SetMode(Mode::Live)).unwrap();
    assert_eq!(rig.begin(&blob), Err(RequestError::EraseWouldStall));
    rig.order(&Request::SetMode(Mode::Idle)).unwrap();
    assert_eq!(rig.begin(&blob), Ok(()));
}

#[test]
fn a_reset_sets_the_session_that_a_reconnecting_host_can_read() {
    let mut rig = Rig::power_up(factory(&small_blob("old")));
    let Reply::Identity(before) = rig.ask(&Request::Identify) else { panic!() };
    assert_eq!((before.session, before.mode, before.board), (None, Mode::Idle, "rig"));
    let reset = Request::Reset {
        session: 77,
        params: SessionParams { rate_hz: 500, gravity_m_s2: 1.62, ..SessionParams::default() },
    };
    rig.order(&reset).unwrap();
    rig.order(&Request::SetMode(Mode::LockStep)).unwrap();
    let running = rig.running();
    let Reply::Identity(after) = rig.ask(&Request::Identify) else { panic!() };
    assert_eq!((after.session, after.mode), (Some(77), Mode::LockStep));
    assert_eq!((after.rate_hz, after.gravity_m_s2), (500, 1.62));
    assert_eq!((after.wire_version, after.policy), (WIRE_VERSION, running));
}

#[test]
fn cuts_long_names_between_characters() {
    assert_eq!(cut("short"), "short");
    let long = "\u{1f9bf}".repeat(20);
    assert_eq!(cut(&long).len(), MAX_NAME);
    assert_eq!(cut(&format!("x{long}")).len(), MAX_NAME - 3);
}

/// A node with empty slots, and its end of a byte stream.
fn endpoint() -> (Endpoint, RequestHandler<FlashSlots<MemoryFlash>>, Option<Alarm>, LockedNode) {
    let node = LockedNode::new(ControlNode::new());
    let store = FlashSlots::new(MemoryFlash::with_slot_len(2048));
    let (handler, alarm) = RequestHandler::power_up(DEVICE, store, &node);
    (Endpoint::new(), handler, alarm, node)
}

#[test]
fn an_endpoint_answers_the_bytes_of_a_request_with_a_frame() {
    let (mut endpoint, mut handler, alarm, node) = endpoint();
    let mut frame = [0; MAX_FRAME];
    let mut receiver = Receiver::new();
    let alarm = endpoint.alarm(alarm.unwrap()).unwrap().to_vec();
    let payload = alarm.iter().find_map(|&b| receiver.push(b).map(|r| r.unwrap().to_vec()));
    let empty = Alarm::NoPolicy { a: SlotError::Empty, b: SlotError::Empty };
    assert_eq!(decode(&payload.unwrap()), Ok(ToHost::Alarm(empty)));

    let sample = ToController::Sample { seq: 4, sample: super::rig::hopping(0) };
    let mut bytes = b"noise".to_vec();
    bytes.extend(encode(&sample, &mut frame).unwrap());
    bytes.extend(encode(&0x7f_u8, &mut frame).unwrap());
    let asked = ToController::Request { id: 6, request: Request::Status };
    bytes.extend(encode(&asked, &mut frame).unwrap());
    let device = || DeviceCounts { lost_bytes: 3, ..DeviceCounts::default() };
    let mut sent = Vec::new();
    for &byte in &bytes {
        sent.extend(endpoint.push(byte, &mut handler, &node, device).map(<[u8]>::to_vec));
    }
    assert_eq!(sent.len(), 2);
    let mut payload_of = |frame: &[u8]| -> Vec<u8> {
        frame.iter().find_map(|&b| receiver.push(b).map(|r| r.unwrap().to_vec())).unwrap()
    };
    let command = payload_of(&sent[0]);
    let Ok(ToHost::Command { seq: 4, command }) = decode(&command) else { panic!() };
    assert!(is_safe(&command));
    let reply = payload_of(&sent[1]);
    let Ok(ToHost::Reply { id: 6, reply: Reply::Status(found) }) = decode(&reply) else { panic!() };
    assert_eq!((found.line.frames, found.line.unknown, found.line.resyncs), (3, 1, 1));
    assert_eq!((found.line.malformed + found.line.crc_errors, found.device.lost_bytes), (1, 3));
}

#[test]
fn a_board_refuses_the_requests_that_only_a_process_implements() {
    let mut rig = Rig::power_up(factory(&small_blob("old")));
    let unsupported = Reply::Refused(RequestError::Unsupported);
    assert_eq!(rig.ask(&Request::Report { offset: 0 }), unsupported);
    let read = Request::Read { crc32: crc32_of(&small_blob("old")), offset: 0 };
    assert_eq!(rig.ask(&read), Reply::Refused(RequestError::NotFound));
}
