//! The run's end of a recording.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::PollFlags;

use super::feeder::{Feeder, PipeWriter, SideMessage};
use super::pipe::{self, FrameBuffer};
use super::schema::{Config, End, Loop, Policy};
use super::tap::{OnFull, RING_CAPACITY, RecordTap, RingState};
use super::translate::Translator;
use super::writer_process::{DONE, FAILED, READY, part};

/// Time that a writer process may take to start.
const START_TIMEOUT: Duration = Duration::from_secs(10);
/// Time that it may take to finish its file: a large one on a slow disk.
const FINISH_TIMEOUT: Duration = Duration::from_mins(1);

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
        "the recording broke off: {cause}; its beginning is in {}, which replay and plot can read",
        part.display()
    )]
    BrokeOff {
        /// The incomplete file.
        part: PathBuf,
        /// The cause.
        cause: String,
    },
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
    reports: ChildStdout,
    feeder: Option<JoinHandle<io::Result<()>>>,
    side: Sender<SideMessage>,
    finish: Arc<AtomicBool>,
    state: Arc<RingState>,
}

/// Records what does not come from the ring. It allocates, so the loop itself
/// must not use it.
#[derive(Clone, Debug)]
pub struct RecordSink(Sender<SideMessage>);

impl RecordSink {
    /// Records a policy that the controller received.
    pub fn policy(&self, policy: Policy) {
        let _ = self.0.send(SideMessage::Policy(policy));
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
        on_full: OnFull,
    ) -> Result<(Self, RecordTap), RecordError> {
        let program = leg_process::program::current().map_err(|error| RecordError::Begin {
            path: path.to_owned(),
            cause: error.to_string(),
        })?;
        Self::begin_with(&program, path, config, on_full)
    }

    /// Like [`Recorder::begin`], with the path of the `sim-host` program.
    ///
    /// # Errors
    /// [`RecordError::Begin`].
    pub fn begin_with(
        program: &Path,
        path: &Path,
        config: &Config,
        on_full: OnFull,
    ) -> Result<(Self, RecordTap), RecordError> {
        let failed = |cause: String| RecordError::Begin { path: path.to_owned(), cause };
        let io_failed = |error: io::Error| failed(error.to_string());
        if path.exists() && !path.is_file() {
            return Err(failed("it exists and is not a file".to_owned()));
        }
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
        match next_line(&mut reports, START_TIMEOUT).map_err(io_failed)?.as_str() {
            READY => (),
            line => {
                let _ = writer.wait();
                return Err(failed(line.strip_prefix(FAILED).unwrap_or("it ended").to_owned()));
            }
        }
        let nonblocking = rustix::fs::fcntl_getfl(&pipe)
            .and_then(|flags| rustix::fs::fcntl_setfl(&pipe, flags | rustix::fs::OFlags::NONBLOCK));
        nonblocking.map_err(|error| io_failed(error.into()))?;

        let (tap, ring, state) = RecordTap::new(RING_CAPACITY, on_full);
        let (side, side_receiver) = mpsc::channel();
        let finish = Arc::new(AtomicBool::new(false));
        let consequence =
            format!("the run continues without it; the beginning is in {}", part(path).display());
        let mut pipe = PipeWriter::new(pipe, consequence);
        let mut frames = FrameBuffer::default();
        frames.add(config.started_unix_ns, config);
        pipe.send(&mut frames);
        let feeder = Feeder {
            ring,
            side: side_receiver,
            state: Arc::clone(&state),
            finish: Arc::clone(&finish),
            pipe,
            translator: Translator::new(config.started_unix_ns, config.rate_hz),
        };
        let feeder = std::thread::Builder::new()
            .name("record".to_owned())
            .spawn(|| feeder.run())
            .map_err(io_failed)?;
        let path = path.to_owned();
        Ok((Self { path, writer, reports, feeder: Some(feeder), side, finish, state }, tap))
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
        let part = part(&self.path);
        let broke_off = |cause| RecordError::BrokeOff { part, cause };
        self.finish.store(true, Ordering::Release);
        let fed = match self.feeder.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(io::Error::other("the thread that feeds it panicked")),
            None => return Ok(RecordSummary { messages: 0, dropped: 0 }),
        };
        if let Err(error) = &fed
            && error.kind() == io::ErrorKind::TimedOut
        {
            // The writer is stopped. When it continues, it completes the file by itself.
            return Err(broke_off("the recorder is stopped".to_owned()));
        }
        let line = next_line(&mut self.reports, FINISH_TIMEOUT);
        match (fed, line) {
            (Ok(()), Ok(line)) => {
                let _ = self.writer.wait();
                match line.strip_prefix(DONE).and_then(|messages| messages.parse().ok()) {
                    Some(messages) => Ok(RecordSummary { messages, dropped: self.state.dropped() }),
                    None => Err(broke_off(reason(&line))),
                }
            }
            (Err(error), Ok(line)) if line.is_empty() => {
                let _ = self.writer.wait();
                Err(broke_off(format!("the recorder was ended ({error})")))
            }
            (Err(_), Ok(line)) => {
                let _ = self.writer.wait();
                Err(broke_off(reason(&line)))
            }
            (_, Err(error)) => Err(broke_off(error.to_string())),
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.close();
    }
}

fn reason(line: &str) -> String {
    line.strip_prefix(FAILED).unwrap_or("the recorder was ended").to_owned()
}

/// Reads the writer's next line; empty if it ended without one.
fn next_line(reports: &mut ChildStdout, timeout: Duration) -> io::Result<String> {
    let deadline = Instant::now() + timeout;
    let mut line = Vec::new();
    let mut byte = [0];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            let message = format!("the recorder has not responded for {} s", timeout.as_secs());
            return Err(io::Error::new(io::ErrorKind::TimedOut, message));
        }
        if !pipe::wait(reports, PollFlags::IN, left)? {
            continue;
        }
        match reports.read(&mut byte)? {
            1 if byte != *b"\n" => line.extend(byte),
            _ => return Ok(String::from_utf8_lossy(&line).into_owned()),
        }
    }
}
