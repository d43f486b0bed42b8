//! A flashed controller for a test, and its client.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use harness::board::{BOARDS, Image};
use harness::emulator::Emulator;
use leg_control::serial::message::{Mode, Request, SessionParams, Status};
use leg_control::wire::{Command, Sample};
use leg_host::serial::client::{Client, IDENTIFY_TIMEOUT, Received};
use leg_host::serial::stream::{ByteStream, Endpoint};
use leg_process::Stop;
use tempfile::TempDir;

/// Ticks a second in all tests here.
pub(crate) const RATE_HZ: u32 = 1_000;
/// Gravity in all tests here, m/s2.
pub(crate) const GRAVITY_M_S2: f32 = 9.81;
/// The emulator answers within a millisecond; a test machine may be busy.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// Returns how many ticks a test plays: `usual`, or `LEG_HIL_TICKS` if that is more.
pub(crate) fn ticks(usual: u64) -> u64 {
    match std::env::var("LEG_HIL_TICKS") {
        Ok(ticks) => ticks.parse::<u64>().expect("LEG_HIL_TICKS is a number of ticks").max(usual),
        Err(_) => usual,
    }
}

/// Returns the image of the default board with more of its features; each is built once.
pub(crate) fn image(features: &str) -> Image {
    static BUILT: OnceLock<Mutex<Vec<(String, Image)>>> = OnceLock::new();
    let built = BUILT.get_or_init(Mutex::default);
    let mut built = built.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, image)) = built.iter().find(|(name, _)| name == features) {
        return image.clone();
    }
    let image = BOARDS[0].build_with(features).expect("the firmware builds");
    built.push((features.to_owned(), image.clone()));
    image
}

pub(crate) fn shipped() -> PathBuf {
    harness::checkout().join("controller/policies/robust.bin")
}

/// Returns whether to skip for want of an emulator.
pub(crate) fn skips() -> bool {
    !requirements::qemu()
}

/// An emulated board, and a client on its serial line.
pub(crate) struct Flashed {
    pub(crate) client: Client,
    pub(crate) emulator: Emulator,
    /// What a reset sets.
    pub(crate) params: SessionParams,
    seq: u32,
    _folder: TempDir,
}

impl Flashed {
    /// Starts the default board with this policy in slot A, over a good line.
    pub(crate) fn start(policy: Option<&Path>) -> Self {
        Self::start_image(&image(""), policy, |stream| stream)
    }

    /// As [`Self::start`], with any image, over the stream that `line` makes of the line.
    pub(crate) fn start_image(
        image: &Image,
        policy: Option<&Path>,
        line: impl FnOnce(Box<dyn ByteStream>) -> Box<dyn ByteStream>,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let emulator = Emulator::start(image, policy, folder.path()).expect("the emulator starts");
        let endpoint = Endpoint::Unix(emulator.uart().to_owned());
        let stream = line(endpoint.open().expect("the UART's socket"));
        let client = Client::new(stream, &Stop::default());
        let params = SessionParams {
            rate_hz: RATE_HZ,
            gravity_m_s2: GRAVITY_M_S2,
            ..SessionParams::default()
        };
        let mut flashed = Self { client, emulator, params, seq: 0, _folder: folder };
        flashed.client.identify(IDENTIFY_TIMEOUT).expect("an answer");
        flashed
    }

    /// Resets the controller and sets its mode.
    pub(crate) fn reset(&mut self, mode: Mode) {
        self.begin(7, mode);
    }

    /// As [`Self::reset`], with this session number.
    pub(crate) fn begin(&mut self, session: u32, mode: Mode) {
        let reset = Request::Reset { session, params: self.params };
        self.client.have_done(&reset).expect("a reset");
        self.client.have_done(&Request::SetMode(mode)).expect("a mode");
    }

    /// Sends a sample and returns its command: in lock-step, a tick.
    pub(crate) fn command(&mut self, sample: &Sample) -> Command {
        self.seq += 1;
        self.client.post_sample(self.seq, sample);
        self.await_command()
    }

    /// Waits for the command for the sample sent last.
    pub(crate) fn await_command(&mut self) -> Command {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            match self.client.listen(PATIENCE).expect("the line") {
                Received::Command { seq, command, .. } if seq == self.seq => return command,
                Received::Alarm(alarm) => panic!("{alarm:?}"),
                // Commands among them are repeated answers.
                Received::Nothing | Received::Reply | Received::Command { .. } => (),
            }
        }
        panic!("no command for number {} in {PATIENCE:?}", self.seq);
    }

    pub(crate) fn status(&mut self) -> Status {
        self.client.status().expect("a status")
    }

    /// Returns the status as soon as the sample with number `seq` was used.
    pub(crate) fn status_after(&mut self, seq: u64) -> Status {
        let begun = Instant::now();
        loop {
            let status = self.status();
            if status.run.last.is_some_and(|tick| tick.seq >= seq) {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "sample {seq} was not used: {status:?}");
        }
    }
}
