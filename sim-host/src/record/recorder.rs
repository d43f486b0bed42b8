//! The run's end of a recording.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::feeder::{FINISH_TIMEOUT, Feeder, LostWriter, SideMessage, Writer};
use super::pipe::{self, FrameBuffer};
use super::schema::{Config, End, Law, Loop, Policy, SetPoint};
use super::tap::{OnFull, RING_CAPACITY, RecordTap, RingState};
use super::translate::Translator;
use super::writer_process::{FAILED, READY, part};
use leg_process::atomic_file;
use rustix::process::Pid;

/// Time that a writer process may take to start.
const START_TIMEOUT: Duration = Duration::from_secs(10);
/// Time between two checks whether a writer that was given up has ended.
const END_POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Why there is no recording, or only part of one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be created, or the writer process not started.
    #[error("cannot record to {}: {cause}", path.display())]
    Begin {
        /// The file.
        path: PathBuf,
        /// The cause.
        cause: String,
    },
    /// The writer process failed or was lost.
    #[error(
        "the recording broke off in {}: {cause}; replay and plot can read what that file contains",
        file.display()
    )]
    BrokeOff {
        /// The file with what was recorded.
        file: PathBuf,
        /// Whether it has its index, and so every reader can use it.
        is_complete: bool,
        /// The cause.
        cause: String,
    },
}

/// How a run is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordOptions {
    /// What the loop does when the ring is full.
    pub on_full: OnFull,
    /// Pictures for viewers per second of simulated time, at most one for each tick; 0 leaves
    /// everything out that is for viewers only.
    pub display_rate_hz: u32,
}

/// Counts of a finished recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordSummary {
    /// Messages in the file.
    pub messages: u64,
    /// Ticks and events dropped because the ring was full.
    pub dropped: u64,
}

/// A recording in progress. If it is dropped before [`Recorder::finish`], the
/// file is complete but has no [`End`].
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    writer: Child,
    feeder: Option<JoinHandle<Result<u64, LostWriter>>>,
    side: Sender<SideMessage>,
    finish: Arc<AtomicBool>,
    state: Arc<RingState>,
}

/// Records what does not come from the ring. It allocates, so the loop itself
/// must not use it.
#[derive(Clone, Debug)]
pub struct RecordSink(Sender<SideMessage>);

impl RecordSink {
    /// Creates a sink to the other end of this channel.
    pub(super) fn new(to: Sender<SideMessage>) -> Self {
        Self(to)
    }

    /// Records a policy that the controller received.
    pub fn policy(&self, policy: Policy) {
        let _ = self.0.send(SideMessage::Policy(policy));
    }

    /// Records a set-point that the controller received beside the samples.
    pub fn set_point(&self, set_point: SetPoint) {
        let _ = self.0.send(SideMessage::SetPoint(set_point));
    }

    /// Records how the control law runs.
    pub fn law(&self, law: Law) {
        let _ = self.0.send(SideMessage::Law(law));
    }

    /// Records the timing of a tick.
    pub fn timing(&self, timing: Loop) {
        let _ = self.0.send(SideMessage::Loop(timing));
    }
}

impl Recorder {
    /// Starts a recording to `path` and the process that writes it.
    ///
    /// # Errors
    /// [`RecordError::Begin`].
    pub fn begin(
        path: &Path,
        config: &Config,
        options: RecordOptions,
    ) -> Result<(Self, RecordTap), RecordError> {
        let program = leg_process::program::current().map_err(|error| RecordError::Begin {
            path: path.to_owned(),
            cause: error.to_string(),
        })?;
        Self::begin_with(&program, path, config, options)
    }

    /// Like [`Recorder::begin`], with the path of the `sim-host` program.
    ///
    /// # Errors
    /// [`RecordError::Begin`].
    pub fn begin_with(
        program: &Path,
        path: &Path,
        config: &Config,
        options: RecordOptions,
    ) -> Result<(Self, RecordTap), RecordError> {
        let failed = |cause: String| RecordError::Begin { path: path.to_owned(), cause };
        let io_failed = |error: io::Error| failed(error.to_string());
        if path.exists() && !path.is_file() {
            return Err(failed("it exists and is not a file".to_owned()));
        }
        // Whether the finished file can take its place is found out before the run.
        atomic_file::check(path).map_err(io_failed)?;
        let mut writer = Command::new(program)
            .arg("recorder")
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(io_failed)?;
        let (Some(pipe), Some(mut reports)) = (writer.stdin.take(), writer.stdout.take()) else {
            unreachable!("both are piped");
        };
        let line = pipe::read_line(&mut reports, START_TIMEOUT).map_err(|_| {
            failed(format!("the recorder has not started for {} s", START_TIMEOUT.as_secs()))
        })?;
        match line.as_str() {
            READY => (),
            line => {
                let _ = writer.wait();
                return Err(failed(line.strip_prefix(FAILED).unwrap_or("it ended").to_owned()));
            }
        }
        let nonblocking = rustix::fs::fcntl_getfl(&pipe)
            .and_then(|flags| rustix::fs::fcntl_setfl(&pipe, flags | rustix::fs::OFlags::NONBLOCK));
        nonblocking.map_err(|error| io_failed(error.into()))?;

        let (tap, ring, state) = RecordTap::new(RING_CAPACITY, options.on_full);
        let (side, side_receiver) = mpsc::channel();
        let finish = Arc::new(AtomicBool::new(false));
        let mut writer_end = Writer::new(Pid::from_child(&writer), pipe, reports);
        let mut frames = FrameBuffer::default();
        let translator = Translator::new(config, options.display_rate_hz);
        translator.begin(config, &mut frames);
        writer_end.send(&mut frames);
        let feeder = Feeder {
            ring,
            side: side_receiver,
            state: Arc::clone(&state),
            finish: Arc::clone(&finish),
            writer: writer_end,
            translator,
        };
        let feeder = std::thread::Builder::new()
            .name("record".to_owned())
            .spawn(|| feeder.run())
            .map_err(io_failed)?;
        let path = path.to_owned();
        Ok((Self { path, writer, feeder: Some(feeder), side, finish, state }, tap))
    }

    /// Returns a sink for what does not come from the ring.
    #[must_use]
    pub fn sink(&self) -> RecordSink {
        RecordSink(self.side.clone())
    }

    /// Completes the file with the result of the run. All ticks must have been
    /// pushed.
    ///
    /// # Errors
    /// [`RecordError::BrokeOff`].
    pub fn finish(mut self, end: End) -> Result<RecordSummary, RecordError> {
        let _ = self.side.send(SideMessage::End(end));
        self.close()
    }

    fn close(&mut self) -> Result<RecordSummary, RecordError> {
        self.finish.store(true, Ordering::Release);
        let dropped = self.state.dropped();
        let Some(feeder) = self.feeder.take() else {
            return Ok(RecordSummary { messages: 0, dropped });
        };
        let lost = match feeder.join() {
            Ok(Ok(messages)) => {
                let _ = self.writer.wait();
                return Ok(RecordSummary { messages, dropped: self.state.dropped() });
            }
            Ok(Err(lost)) => lost,
            Err(_) => {
                let cause = "the thread that feeds the recorder panicked".to_owned();
                LostWriter { cause, is_continued: false }
            }
        };
        let is_complete = lost.is_continued && self.completes();
        let _ = self.writer.kill();
        let _ = self.writer.wait();
        let file = if is_complete { self.path.clone() } else { part(&self.path) };
        Err(RecordError::BrokeOff { file, is_complete, cause: lost.cause })
    }

    /// Waits until a writer that was given up ends; returns whether it has completed the file.
    fn completes(&mut self) -> bool {
        let since = Instant::now();
        while since.elapsed() < FINISH_TIMEOUT {
            match self.writer.try_wait() {
                Ok(None) => std::thread::sleep(END_POLL_INTERVAL),
                Ok(Some(status)) => return status.success(),
                Err(_) => return false,
            }
        }
        false
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.close();
    }
}
