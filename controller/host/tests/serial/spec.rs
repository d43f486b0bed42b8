//! The specification agrees with the code.

use leg_control::checksum::crc32;
use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::frame::{MAX_FRAME, decode, encode};
use leg_control::serial::message::{
    Activity, Alarm, BlobError, Crash, DeviceCounts, Estimator, Identity, LineCounts, MAX_CHUNK,
    MAX_NAME, MAX_ORIGIN, Mode, PolicyReport, RejectCounts, Reply, Request, RequestError,
    RunCounts, RunStatus, RunTick, SessionParams, Slot, SlotError, SlotReport, Status,
    ToController, ToHost,
};
use leg_control::serial::slots::{FlashSlots, SEAL_LEN};
use leg_control::serial::store::PolicyStore;
use leg_control::wire::{Command, Header, Sample, SensorReadings};
use leg_host::flash::MemoryFlash;
use serde::{Deserialize, Serialize};

const SPEC: &str = include_str!("../../../src/serial/PROTOCOL.md");
const HEADER: Header = Header {
    version: 0x1122,
    flags: 0x3344,
    run_id: 0x5566_7788,
    seq: 0x99aa_bbcc_ddee_ff01,
    t_ns: 0x1213_1415_1617_1819,
};
/// As long as a name gets; and another.
const NAME: &str = "a-name-of-forty-eight-bytes-as-long-as-it-may-be";
const OTHER: &str = "z-name-of-forty-eight-bytes-as-long-as-it-may-be";
const ORIGIN: &str = match str::from_utf8(&[b'o'; MAX_ORIGIN]) {
    Ok(text) => text,
    Err(_) => "",
};
const CHUNK: [u8; MAX_CHUNK] = {
    let mut bytes = [0; MAX_CHUNK];
    let mut i = 0;
    while i < MAX_CHUNK {
        bytes[i] = i as u8 + 1;
        i += 1;
    }
    bytes
};

fn requests() -> Vec<Request<'static>> {
    vec![
        Request::Identify,
        Request::Reset {
            session: 0xfedc_ba98,
            params: SessionParams {
                rate_hz: 1_000,
                gravity_m_s2: 1.625,
                stale_limit_ns: 0xf123_4567,
                estimator: Estimator::Readings,
            },
        },
        Request::SetMode(Mode::Live),
        Request::SetPoint(Some(-0.75)),
        Request::Status,
        Request::Slots,
        Request::Begin { length: 13_188, crc32: 0x8765_4321, origin: ORIGIN },
        Request::Chunk { offset: u32::MAX, bytes: &CHUNK },
        Request::Verify,
        Request::Commit,
        Request::RollBack,
        Request::Read { crc32: 0x7654_3210, offset: u32::MAX },
        Request::Report { offset: u32::MAX },
    ]
}

fn estimators() -> Vec<Estimator> {
    let (velocity_m_s, height_m, leg_length_m) = (0.125, 0.375, 0.0625);
    vec![
        Estimator::Readings,
        Estimator::State { velocity_m_s, height_m, leg_length_m },
        Estimator::Inertial { figures: [0.75; 12] },
    ]
}

fn modes() -> Vec<Mode> {
    vec![Mode::Idle, Mode::LockStep, Mode::Live]
}

fn replies() -> Vec<Reply<'static>> {
    let report = |slot| PolicyReport { slot, name: OTHER, crc32: 0xa1b2_c3d4, leg: 0xf5e6_d7c8 };
    let identity = Identity {
        wire_version: 0x1234,
        board: NAME,
        firmware: OTHER,
        session: Some(0xfeed_beef),
        mode: Mode::LockStep,
        rate_hz: 0xf000_0001,
        gravity_m_s2: 3.5,
        policy: Some(report(Slot::B)),
    };
    let line = LineCounts {
        frames: 0xf100_0000,
        crc_errors: 0xf200_0000,
        malformed: 0xf300_0000,
        oversize: 0xf400_0000,
        version: 0xf500_0000,
        unknown: 0xf600_0000,
        resyncs: 0xf700_0000,
    };
    let run = RunStatus {
        activity: Activity::Running,
        last: Some(RunTick { run_id: 0xe100_0000, seq: u64::MAX }),
        pending: Some(Slot::B),
        counts: RunCounts {
            ticks: u64::MAX - 1,
            missed: u64::MAX - 2,
            overwritten: 0xfa00_0000,
            overruns: 0xfb00_0000,
            repeated: 0xfc00_0000,
            swaps: 0xfd00_0000,
        },
        apexes: 0xe200_0000,
        rejected: RejectCounts {
            ticks: 0xe300_0000,
            missing: 0xe400_0000,
            stale: 0xe500_0000,
            safe_entered: 0xe600_0000,
        },
    };
    let device = DeviceCounts {
        unsent: 0xfe00_0000,
        lost_bytes: 0xff00_0000,
        stack_used: 0xff10_0000,
        stack_size: 0xff20_0000,
    };
    let slot = |name| SlotReport {
        sequence: u32::MAX - 1,
        running: true,
        content: Ok((name, 0xdead_beef)),
    };
    vec![
        Reply::Identity(identity),
        Reply::Done,
        Reply::Status(Status { run, line, device }),
        Reply::Slots([slot(NAME), slot(OTHER)]),
        Reply::Refused(RequestError::Rate { least: 50, most: 20_000 }),
        Reply::Bytes(&CHUNK),
    ]
}

fn blob_faults() -> Vec<BlobError> {
    vec![
        BlobError::TooShort,
        BlobError::TooLong,
        BlobError::Magic,
        BlobError::Version(0x0203),
        BlobError::Crc,
        BlobError::Malformed,
        BlobError::Misaligned,
        BlobError::Shape,
        BlobError::NonFinite,
        BlobError::OutOfRange,
        BlobError::TooFewTestVectors,
        BlobError::TestVector(11),
    ]
}

fn slot_faults() -> Vec<SlotError> {
    vec![
        SlotError::Empty,
        SlotError::Unfinished,
        SlotError::BadSeal,
        SlotError::RolledBack,
        SlotError::Blob(BlobError::TestVector(3)),
    ]
}

fn refusals() -> Vec<RequestError> {
    vec![
        RequestError::Rate { least: 50, most: 20_000 },
        RequestError::Gravity,
        RequestError::SetPoint { most_m_s: 50.0 },
        RequestError::NoPolicy,
        RequestError::TooLong { room: 16_352 },
        RequestError::SwapPending,
        RequestError::EraseWouldStall,
        RequestError::NotBegun,
        RequestError::Offset { expected: 192 },
        RequestError::Incomplete { received: 384, length: 13_188 },
        RequestError::WrongBlob { crc32: 0x0bad_f00d },
        RequestError::Blob(BlobError::Version(7)),
        RequestError::NothingToRollBackTo(SlotError::RolledBack),
        RequestError::Flash,
        RequestError::InSession,
        RequestError::Unsupported,
        RequestError::NotFound,
        RequestError::Busy,
        RequestError::StaleLimit { least_ns: 50_000, most_ns: 1_000_000_000 },
        RequestError::Noise,
        RequestError::NoEstimator,
    ]
}

fn alarms() -> Vec<Alarm> {
    vec![
        Alarm::NoPolicy { a: SlotError::Empty, b: SlotError::Blob(BlobError::Crc) },
        Alarm::Crash(Crash::HardFault { pc: 0x0800_1235 }),
    ]
}

fn crashes() -> Vec<Crash> {
    vec![Crash::Panic { line: 421 }, Crash::HardFault { pc: 0x0800_1235 }]
}

fn activities() -> Vec<Activity> {
    vec![Activity::Waiting, Activity::Safe, Activity::Running]
}

fn slots_of_a_board() -> Vec<Slot> {
    Slot::ALL.to_vec()
}

fn sample() -> Sample {
    Sample {
        header: HEADER,
        set_point_m_s: 0.5,
        vx_m_s: 1.5,
        y_m: 2.5,
        vy_m_s: -3.5,
        leg_length_m: 4.5,
        density_ratio: 5.5,
        sensors: SensorReadings {
            pitch_rad: 8.5,
            pitch_rate_rad_s: -9.5,
            leg_angle_rad: 10.5,
            impulse: [i32::MIN, i32::MAX],
            velocity_m_s: [11.5, -12.5],
            height_m: 13.5,
            pressure_pa: 14.5,
            velocity_age_ns: 0xa5a6_a7a8,
            height_age_ns: 0xb5b6_b7b8,
            pressure_age_ns: 0xc5c6_c7c8,
        },
    }
}

fn command() -> Command {
    Command {
        header: HEADER,
        leg_angle_rad: 1.25,
        elongation_m: -2.25,
        elongation_rate_m_s: 3.25,
        apex_vx_m_s: 4.25,
        apex_y_m: 5.25,
        density_ratio: 6.25,
        velocity_offset_m_s: 7.25,
        apexes: 0xf0f0_f0f0,
        rejected: 0xf1f1_f1f1,
        set_points_refused: 0xf2f2_f2f2,
    }
}

/// Every message there is, every field with a figure of its own and as long as
/// it gets.
pub(super) fn examples() -> (Vec<ToController<'static>>, Vec<ToHost<'static>>) {
    let id = u32::MAX;
    let without_sensors = Sample { sensors: SensorReadings::default(), ..sample() };
    let mut to_controller = [sample(), without_sensors]
        .map(|sample| ToController::Sample { seq: 0xe1e2_e3e4, sample })
        .to_vec();
    let request = |request| ToController::Request { id, request };
    to_controller.extend(requests().into_iter().map(request));
    to_controller.extend(modes().into_iter().map(|mode| request(Request::SetMode(mode))));
    to_controller.extend(estimators().into_iter().map(|estimator| {
        let params = SessionParams { estimator, ..SessionParams::default() };
        request(Request::Reset { session: 1, params })
    }));
    to_controller.push(request(Request::SetPoint(None)));

    let mut to_host = vec![ToHost::Command { seq: 0xe5e6_e7e8, command: command() }];
    let reply = |reply| ToHost::Reply { id, reply };
    to_host.extend(replies().into_iter().map(reply));
    to_host.extend(refusals().into_iter().map(|refusal| reply(Reply::Refused(refusal))));
    let blob = |fault| reply(Reply::Refused(RequestError::Blob(fault)));
    to_host.extend(blob_faults().into_iter().map(blob));
    let slot = |fault| SlotReport { sequence: 5, running: false, content: Err(fault) };
    to_host.extend(slot_faults().into_iter().map(|f| reply(Reply::Slots([slot(f), slot(f)]))));
    for slot in slots_of_a_board() {
        let policy = PolicyReport { slot, name: NAME, crc32: 1, leg: 2 };
        let identity = Identity {
            wire_version: 1,
            board: "b",
            firmware: "f",
            session: None,
            mode: Mode::Idle,
            rate_hz: 50,
            gravity_m_s2: 9.81,
            policy: Some(policy),
        };
        to_host.push(reply(Reply::Identity(identity)));
        to_host.push(reply(Reply::Identity(Identity { policy: None, ..identity })));
    }
    for activity in activities() {
        let run = RunStatus {
            activity,
            last: None,
            pending: None,
            counts: RunCounts::default(),
            apexes: 0,
            rejected: RejectCounts::default(),
        };
        let (line, device) = (LineCounts::ZERO, DeviceCounts::default());
        to_host.push(reply(Reply::Status(Status { run, line, device })));
    }
    to_host.extend(alarms().into_iter().map(ToHost::Alarm));
    to_host.extend(crashes().into_iter().map(|crash| ToHost::Alarm(Alarm::Crash(crash))));
    (to_controller, to_host)
}

fn encoded(message: &impl Serialize) -> Vec<u8> {
    let mut buffer = [0; 256];
    postcard::to_slice(message, &mut buffer).unwrap().to_vec()
}

/// That the examples hold each variant once, in its order, and that there is
/// none behind them: its number, with zeros for whatever it holds, would decode.
fn all_variants<T: Serialize + for<'a> Deserialize<'a>>(examples: &[T]) {
    for (number, example) in examples.iter().enumerate() {
        assert_eq!(usize::from(encoded(example)[0]), number, "{}", core::any::type_name::<T>());
    }
    all_known::<T>(examples.len());
}

fn all_known<T: for<'a> Deserialize<'a>>(variants: usize) {
    let mut next = vec![0_u8; 512];
    next[0] = variants as u8;
    let known = postcard::take_from_bytes::<T>(&next).is_ok();
    let name = core::any::type_name::<T>();
    assert!(!known, "{name} has a variant {variants}: give an example of it here");
}

/// The same for an enum that borrows from its bytes.
macro_rules! all_borrowed_variants {
    ($type:ident, $examples:expr) => {{
        let examples = $examples;
        for (number, example) in examples.iter().enumerate() {
            assert_eq!(usize::from(encoded(example)[0]), number);
        }
        let mut next = vec![0_u8; 512];
        next[0] = examples.len() as u8;
        let known = postcard::take_from_bytes::<$type<'_>>(&next).is_ok();
        assert!(!known, "give an example of the new variant here");
    }};
}

#[test]
fn there_is_an_example_of_every_variant() {
    all_variants(&modes());
    all_variants(&estimators());
    all_variants(&blob_faults());
    all_variants(&slot_faults());
    all_variants(&refusals());
    all_variants(&alarms());
    all_variants(&crashes());
    all_variants(&activities());
    all_variants(&slots_of_a_board());
    all_borrowed_variants!(Request, requests());
    all_borrowed_variants!(Reply, replies());
    let (to_controller, to_host) = examples();
    all_borrowed_variants!(ToController, &to_controller[1..3]);
    all_borrowed_variants!(ToHost, [to_host[0], to_host[1], *to_host.last().unwrap()]);
    assert_eq!((NAME.len(), OTHER.len()), (MAX_NAME, MAX_NAME));
}

/// The seal of a slot with all its words written.
fn seal() -> Vec<u8> {
    let mut store = FlashSlots::new(MemoryFlash::with_slot_len(128));
    store.begin(Slot::A, 9, "").unwrap();
    store.write(Slot::A, 4, &[1, 2, 3, 4, 5]).unwrap();
    store.commit(Slot::A, 9, 0x1234_5678).unwrap();
    store.revoke(Slot::A).unwrap();
    let slot = store.bytes(Slot::A);
    slot[slot.len() - SEAL_LEN..].to_vec()
}

/// The frame that the specification spells out.
fn worked_example() -> Vec<u8> {
    let message = ToController::Request { id: 7, request: Request::SetPoint(Some(0.5)) };
    encode(&message, &mut [0; MAX_FRAME]).unwrap().to_vec()
}

fn fingerprint() -> u32 {
    let mut bytes = vec![PROTOCOL_VERSION];
    let (to_controller, to_host) = examples();
    bytes.extend(to_controller.iter().flat_map(encoded));
    bytes.extend(to_host.iter().flat_map(encoded));
    bytes.extend(worked_example());
    bytes.extend(seal());
    crc32(&bytes)
}

/// Version and fingerprint of each row of the table of versions.
fn versions() -> Vec<(u32, String)> {
    let table = SPEC.split("## Versions").nth(1).unwrap();
    let cells = |line: &str| line.split('|').map(|c| c.trim().to_owned()).collect::<Vec<_>>();
    let rows = table.lines().filter(|line| line.starts_with('|')).skip(2).map(cells);
    rows.map(|cells| (cells[1].parse().unwrap(), cells[2].trim_matches('`').to_owned())).collect()
}

#[test]
fn the_specification_has_this_version_and_these_bytes() {
    let versions = versions();
    let numbers: Vec<u32> = versions.iter().map(|(number, _)| *number).collect();
    let expected: Vec<u32> = (1..=u32::from(PROTOCOL_VERSION)).collect();
    assert_eq!(numbers, expected, "PROTOCOL.md: one row for each version, oldest first");
    let stated = format!("Version {PROTOCOL_VERSION}.");
    assert!(SPEC.contains(&stated), "PROTOCOL.md does not contain \"{stated}\"");
    let found = format!("{:08x}", fingerprint());
    assert_eq!(
        versions.last().unwrap().1,
        found,
        "the bytes on the line have changed: raise PROTOCOL_VERSION, add a row with this \
         fingerprint to PROTOCOL.md, and bring its text up to date"
    );
}

#[test]
fn the_worked_example_equals_the_bytes_sent() {
    let hex =
        |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
    let frame = hex(&worked_example());
    assert!(SPEC.contains(&format!("\n{frame}\n")), "PROTOCOL.md lacks the line\n{frame}");
    let seal = hex(&seal());
    let seal = seal.as_bytes().chunks(48).map(|line| str::from_utf8(line).unwrap().trim());
    for line in seal {
        assert!(SPEC.contains(line), "PROTOCOL.md lacks the line of a seal\n{line}");
    }
    assert!(decode::<ToController<'_>>(&[1, 7, 3, 1, 0, 0, 0, 0x3f]).is_ok());
}

#[test]
fn every_name_of_the_messages_is_in_the_specification() {
    let (to_controller, to_host) = examples();
    let text = format!("{to_controller:?} {to_host:?}");
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    let values = ["Some", "None", "Ok", "Err", "true", "false", "inf", "NaN"];
    let names = words.filter(|word| word.starts_with(char::is_alphabetic)).filter(|word| {
        !values.contains(word) && ![NAME, OTHER, ORIGIN].iter().any(|text| text.contains(word))
    });
    for name in names {
        assert!(SPEC.contains(name), "PROTOCOL.md does not describe {name}");
    }
}
