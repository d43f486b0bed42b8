use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::stream::over_unix;
use super::upload::{Progress, roll_back, upload};
use super::*;
use crate::fixture::{blob_of, manifest};
use crate::flash::MemoryFlash;
use leg_control::actor::{Activation, Activations, Widths};
use leg_control::checksum::crc32;
use leg_control::policy::{Manifest, Policy, SHIPPED};
use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::message::{
    Alarm, Crash, Mode, Request, RequestError, SessionParams, Slot, SlotError, ToHost,
};
use leg_control::wire::{Header, Sample};
use leg_process::Stop;
use leg_process::policy_file::{AlignedBytes, PolicyFile};

const SHORT: Duration = Duration::from_millis(50);
const LONG: Duration = Duration::from_secs(10);

/// A board on a thread, at the other end of a stream.
struct BoardThread {
    on: Arc<AtomicBool>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl BoardThread {
    fn new(mut stream: Box<dyn ByteStream>, flash: MemoryFlash) -> Self {
        let on = Arc::new(AtomicBool::new(true));
        let goes_on = Arc::clone(&on);
        let serve = move || {
            VirtualBoard::power_up(flash).serve(&mut *stream, || goes_on.load(Ordering::Relaxed))
        };
        Self { on, thread: Some(std::thread::spawn(serve)) }
    }
}

impl Drop for BoardThread {
    fn drop(&mut self) {
        self.on.store(false, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap().unwrap();
    }
}

fn pair() -> (Box<dyn ByteStream>, Box<dyn ByteStream>) {
    let (here, there) = UnixStream::pair().unwrap();
    (over_unix(here).unwrap(), over_unix(there).unwrap())
}

fn shipped() -> MemoryFlash {
    MemoryFlash::new().loaded(Slot::A, SHIPPED)
}

fn board() -> (Client, BoardThread) {
    let (here, there) = pair();
    (Client::new(here, &Stop::default()), BoardThread::new(there, shipped()))
}

fn sample(seq: u64) -> Sample {
    let header = Header { version: 1, run_id: 1, seq, t_ns: seq * 1_000_000, flags: 0 };
    Sample { header, y_m: 2.0, ..Sample::default() }
}

fn alarm_frame(alarm: Alarm) -> Vec<u8> {
    let mut room = [0; MAX_FRAME];
    frame::encode(&ToHost::Alarm(alarm), &mut room).unwrap().to_vec()
}

/// A peer that crashes sends its alarm and closes the stream; the host may write before it reads.
#[test]
fn returns_the_last_alarm_before_it_reports_a_broken_stream() {
    let alarm = Alarm::Crash(Crash::Panic { line: 7 });
    for leaves_bytes_unread in [false, true] {
        let (here, mut there) = pair();
        let mut client = Client::new(here, &Stop::default());
        if leaves_bytes_unread {
            // The write after the close then fails by ECONNRESET in place of EPIPE.
            client.post_request(&Request::Identify);
        }
        there.write_all(&alarm_frame(alarm)).unwrap();
        drop(there);
        client.post_sample(1, &sample(1));
        client.post_request(&Request::Identify);
        assert_eq!(client.listen(LONG).unwrap(), Received::Alarm(alarm));
        assert!(client.listen(LONG).unwrap_err().is_unplugged());
    }
}

/// A stream that loses the first bytes in both directions, as a port may that was just opened.
struct LosesFirst<S>(S, [usize; 2]);

impl<S: ByteStream> ByteStream for LosesFirst<S> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.0.read(bytes, timeout)?;
        let lost = count.min(self.1[0]);
        self.1[0] -= lost;
        bytes.copy_within(lost..count, 0);
        Ok(count - lost)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let lost = bytes.len().min(self.1[1]);
        self.1[1] -= lost;
        self.0.write_all(&bytes[lost..])
    }
}

#[test]
fn repeats_the_first_request_until_it_is_answered() {
    let (here, there) = pair();
    let mut client = Client::new(Box::new(LosesFirst(here, [5, 12])), &Stop::default());
    let _board = BoardThread::new(there, shipped());
    let who = client.identify(LONG).unwrap();
    assert_eq!((who.board.as_str(), who.session, who.mode), ("virtual", None, Mode::Idle));
    assert_eq!(who.policy.unwrap().name, "robust");
    assert!(client.counts().request_retries >= 2, "{:?}", client.counts());
}

#[test]
fn distinguishes_silence_noise_and_another_protocol_version() {
    let (here, mut there) = pair();
    let mut client = Client::new(here, &Stop::default());
    let silent = client.identify(SHORT).unwrap_err();
    assert!(matches!(silent, ClientError::Silent { .. }), "{silent}");
    assert!(silent.to_string().contains("does another program use it?"), "{silent}");

    there.write_all(&[0, 3, 7, 9, 0, 1, 2, 3, 0]).unwrap();
    let noise = client.identify(SHORT).unwrap_err();
    assert!(matches!(noise, ClientError::Noise { bad: 2, .. }), "{noise}");

    there.write_all(&framed_as(9)).unwrap();
    let other = client.identify(SHORT).unwrap_err().to_string();
    assert!(
        other.contains(&format!("uses protocol version 9, this program {PROTOCOL_VERSION}")),
        "{other}"
    );

    drop(there);
    assert!(client.identify(LONG).unwrap_err().is_unplugged());
}

/// A node counts a frame of another version and answers nothing, so that a host learns about an
/// earlier one only by its own words.
#[test]
fn names_a_board_of_an_earlier_protocol_version() {
    for version in 1..PROTOCOL_VERSION {
        let (here, mut there) = pair();
        let board = std::thread::spawn(move || {
            let (mut receiver, mut bytes) = (frame::Receiver::new(), [0; 64]);
            loop {
                let count = there.read(&mut bytes, SHORT).unwrap();
                for &byte in &bytes[..count] {
                    if receiver.push(byte) == Some(Err(frame::FrameError::Version(version))) {
                        return there.write_all(&framed_as(version)).map(|()| there).unwrap();
                    }
                }
            }
        });
        let refused = Client::new(here, &Stop::default()).identify(SHORT).unwrap_err().to_string();
        let expected = format!("uses protocol version {version}, this program {PROTOCOL_VERSION}");
        assert!(refused.contains(&expected), "{refused}");
        drop(board.join().unwrap());
    }
}

/// Returns the frame of a body that is only a version.
fn framed_as(version: u8) -> Vec<u8> {
    let body = [version];
    let mut frame = vec![0, 6];
    frame.extend(body);
    frame.extend(crc32(&body).to_le_bytes());
    assert!(!frame[1..].contains(&0), "one group of COBS");
    frame.push(0);
    frame
}

#[test]
fn samples_and_requests_are_answered_independently() {
    let (mut client, _board) = board();
    client
        .have_done(&Request::Reset {
            session: 7,
            params: SessionParams { rate_hz: 500, gravity_m_s2: 1.62, ..SessionParams::default() },
        })
        .unwrap();
    client.have_done(&Request::SetMode(Mode::LockStep)).unwrap();
    let who = client.identify(LONG).unwrap();
    assert_eq!((who.session, who.rate_hz, who.gravity_m_s2), (Some(7), 500, 1.62));
    let start = u32::MAX - 100; // The numbers wrap around.
    for tick in 0..200 {
        client.post_request(&Request::Slots);
        client.post_sample(start.wrapping_add(tick), &sample(u64::from(tick)));
        let (mut command, mut reply) = (None, false);
        let begun = Instant::now();
        while (command.is_none() || !reply) && begun.elapsed() < LONG {
            match client.listen(LONG).unwrap() {
                Received::Command { seq, command: received, again: false } => {
                    command = Some((seq, received));
                }
                Received::Reply => reply = true,
                _ => (),
            }
        }
        let (seq, command) = command.expect("a command");
        assert_eq!((seq, command.header.seq), (start.wrapping_add(tick), u64::from(tick)));
    }
    assert_eq!(client.status().unwrap().run.counts.ticks, 200);
    let counts = client.counts();
    let sent = counts.commands + counts.sample_retries + counts.replies + counts.request_retries;
    assert_eq!(counts.frames_out, sent);
}

#[test]
fn a_refusal_names_the_limit_and_leaves_the_controller_usable() {
    let (mut client, _board) = board();
    let refused = client.have_done(&Request::SetPoint(Some(99.0))).unwrap_err();
    assert!(matches!(refused, ClientError::Refused(RequestError::SetPoint { .. })), "{refused}");
    assert!(refused.to_string().contains("from -50 to 50 m/s"), "{refused}");
    let refused = roll_back(&mut client, SHORT).unwrap_err().to_string();
    assert!(refused.contains("nothing to go back to: empty"), "{refused}");
    assert!(client.identify(LONG).is_ok());
}

#[test]
fn a_board_without_a_policy_sends_an_alarm_and_accepts_an_upload() {
    let (here, there) = pair();
    let mut client = Client::new(here, &Stop::default());
    let _board = BoardThread::new(there, MemoryFlash::new());
    let Received::Alarm(alarm) = client.listen(LONG).unwrap() else { panic!("no alarm") };
    assert_eq!(alarm, Alarm::NoPolicy { a: SlotError::Empty, b: SlotError::Empty });
    let text = alarm.to_string();
    assert!(text.contains("slot A: empty") && text.contains("uploaded"), "{text}");
    assert_eq!(client.identify(LONG).unwrap().policy, None);

    let blob = PolicyFile::load(None).unwrap();
    let policy = blob.policy().unwrap();
    let done = upload(&mut client, &policy, blob.as_slice(), "a file", LONG, |_| ()).unwrap();
    assert!(done.slot == Slot::A && done.swapped_after.is_some(), "{done:?}");
    assert_eq!(client.identify(LONG).unwrap().policy.unwrap().crc32, policy.crc32());
}

#[test]
fn refuses_a_policy_larger_than_a_slot_with_both_sizes() {
    let (mut client, _board) = board();
    // The default network of SB3's PPO.
    let widths = Widths::from_slice(&[3, 64, 64, 2]).unwrap();
    let hidden = Activation::Tanh;
    let activations = Activations { hidden, ..Activations::default() };
    let blob = blob_of(&Manifest { widths, activations, ..manifest() }).unwrap();
    let blob = AlignedBytes::from(blob.as_slice());
    let policy = Policy::parse(blob.as_slice()).unwrap();
    let error = upload(&mut client, &policy, blob.as_slice(), "a file", LONG, |_| ());
    let text = error.unwrap_err().to_string();
    let len = blob.as_slice().len();
    assert!(text.starts_with(&format!("the policy has {len} bytes, and a slot")), "{text}");
    assert!(text.contains("has room for 16352; train a smaller actor"), "{text}");
    assert_eq!(
        client.identify(LONG).unwrap().policy.unwrap().crc32,
        Policy::parse(SHIPPED).unwrap().crc32()
    );
}

#[test]
fn uploads_through_noise_in_both_directions() {
    let (here, there) = pair();
    let mut client = Client::new(Box::new(Noisy::new(here, 0.002, 1)), &Stop::default());
    let _board = BoardThread::new(there, shipped());
    let blob = PolicyFile::load(None).unwrap();
    let policy = blob.policy().unwrap();
    let mut progress = Vec::new();
    let done = upload(&mut client, &policy, blob.as_slice(), "a file", LONG, |p| progress.push(p))
        .unwrap();
    assert_eq!(done.slot, Slot::B);
    let len = SHIPPED.len();
    assert_eq!(progress.last(), Some(&Progress::Committed));
    assert!(progress.contains(&Progress::Sent(len, len)));
    assert!(client.counts().request_retries > 5, "{:?}", client.counts());
    let slots = client.slots().unwrap();
    assert_eq!(slots[1].content, Ok(("robust", policy.crc32())));
    assert!(slots[1].running && !slots[0].running);
    let (slot, after) = roll_back(&mut client, LONG).unwrap();
    assert!(slot == Slot::A && after.is_some());
}

#[test]
fn noise_damages_the_given_share_of_the_bytes_and_the_same_for_a_seed() {
    let damage = |seed| {
        let (here, mut there) = pair();
        let mut noisy = Noisy::new(here, 0.01, seed);
        noisy.write_all(&[0; 10_000]).unwrap();
        let mut bytes = vec![0; 10_000];
        let mut count = 0;
        while count < bytes.len() {
            count += there.read(&mut bytes[count..], LONG).unwrap();
        }
        assert_eq!(bytes.iter().filter(|byte| **byte != 0).count() as u64, noisy.damaged());
        bytes
    };
    let one = damage(1);
    let hits = one.iter().filter(|byte| **byte != 0).count();
    assert!((60..140).contains(&hits), "{hits}");
    assert_eq!(one, damage(1));
    assert_ne!(one, damage(2));
}

#[test]
fn reads_over_tcp_and_names_what_cannot_be_opened() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut here = Endpoint::Tcp(address.clone()).open().unwrap();
    let mut there = stream::over_tcp(listener.accept().unwrap().0).unwrap();
    let mut bytes = [0; 8];
    assert_eq!(there.read(&mut bytes, Duration::ZERO).unwrap(), 0, "nothing yet");
    here.write_all(b"hello").unwrap();
    assert_eq!(there.read(&mut bytes, LONG).unwrap(), 5);
    drop((here, listener));
    let ended = there.read(&mut bytes, LONG).unwrap_err();
    assert_eq!(ended.kind(), io::ErrorKind::UnexpectedEof);

    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("socket");
    let dead = dir.path().join("dead");
    drop(UnixListener::bind(&dead).unwrap());
    for (endpoint, what) in [
        (Endpoint::Tcp(address), "no process listens there"),
        (Endpoint::Unix(path.clone()), "no process listens there"),
        (Endpoint::Unix(dead), "no process listens there"),
        (Endpoint::Serial { path, baud: 9_600 }, "is the board plugged in?"),
        (Endpoint::Serial { path: "/dev/null".into(), baud: 9_600 }, "is it a serial port?"),
    ] {
        let error = endpoint.open().map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(&endpoint.to_string()) && error.contains(what), "{error}");
    }
}

#[test]
fn writing_to_a_peer_that_reads_nothing_times_out() {
    let (mut here, _there) = pair();
    let begun = Instant::now();
    let error = loop {
        if let Err(error) = here.write_all(&[1; 4096]) {
            break error;
        }
    };
    assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    assert!(begun.elapsed() < LONG);
}
