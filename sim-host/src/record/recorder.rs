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

use super::child::{DONE, FAILED, READY, part};
use super::clerk::{Clerk, Note, Pipe};
use super::pipe::{self, Frames};
use super::schema::{Config, End, Loop, Policy};
use super::tap::{OnFull, RING, Shared, Tap};
use super::translate::Translator;

/// How long a recorder may take to begin.
const BEGIN: Duration = Duration::from_secs(10);
/// How long it may take to finish its file: a large one goes to a slow disk.
const FINISH: Duration = Duration::from_mins(1);

/// Why there is no recording, or not a whole one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be begun.
    #[error("cannot record to {}: {what}", path.display())]
    Begin {
        /// The file.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// The recorder broke off.
    #[error(
        "the recording broke off: {what}; what there is of it is in {}, which replay and plot read too",
        part.display()
    )]
    BrokeOff {
        /// Where its beginning is.
        part: PathBuf,
        /// Why.
        what: String,
    },
}

/// A recording that is finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Messages in the file.
    pub messages: u64,
    /// Ticks and events that there was no room for.
    pub dropped: u64,
}

/// A recording under way. Dropped before it is finished, it leaves a whole file
/// too, only without what the run came to.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    child: Child,
    answers: ChildStdout,
    clerk: Option<JoinHandle<io::Result<()>>>,
    notes: Sender<Note>,
    finish: Arc<AtomicBool>,
    shared: Arc<Shared>,
}

/// Where to say what is recorded beside the ticks; not for the loop, for it
/// allocates.
#[derive(Clone, Debug)]
pub struct Notes(Sender<Note>);

impl Notes {
    /// A policy acts from a tick on.
    pub fn policy(&self, policy: Policy) {
        let _ = self.0.send(Note::Policy(policy));
    }

    /// How a tick of the loop kept time.
    pub fn loop_row(&self, row: Loop) {
        let _ = self.0.send(Note::Loop(row));
    }
}

impl Recorder {
    /// Begins a recording at `path`, and the process that writes it.
    ///
    /// # Errors
    /// [`RecordError::Begin`].
    pub fn begin(
        path: &Path,
        config: &Config,
        on_full: OnFull,
    ) -> Result<(Self, Tap), RecordError> {
        let failed = |what: String| RecordError::Begin { path: path.to_owned(), what };
        let program = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        Self::begin_by(&program, path, config, on_full)
    }

    /// As [`Recorder::begin`], by a `sim-host` at a given place.
    ///
    /// # Errors
    /// [`RecordError::Begin`].
    pub fn begin_by(
        program: &Path,
        path: &Path,
        config: &Config,
        on_full: OnFull,
    ) -> Result<(Self, Tap), RecordError> {
        let failed = |what: String| RecordError::Begin { path: path.to_owned(), what };
        let broken = |error: io::Error| failed(error.to_string());
        if path.exists() && !path.is_file() {
            return Err(failed("it is there and is not a file".to_owned()));
        }
        let mut child = Command::new(program)
            .arg("recorder")
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(broken)?;
        let (Some(to), Some(mut answers)) = (child.stdin.take(), child.stdout.take()) else {
            unreachable!("both were asked for");
        };
        match answer(&mut answers, BEGIN).map_err(broken)?.as_str() {
            READY => (),
            said => {
                let _ = child.wait();
                return Err(failed(said.strip_prefix(FAILED).unwrap_or("it ended").to_owned()));
            }
        }
        let nonblocking = rustix::fs::fcntl_getfl(&to)
            .and_then(|flags| rustix::fs::fcntl_setfl(&to, flags | rustix::fs::OFlags::NONBLOCK));
        nonblocking.map_err(|error| broken(error.into()))?;

        let (tap, ring, shared) = Tap::new(RING, on_full);
        let (notes, inbox) = mpsc::channel();
        let finish = Arc::new(AtomicBool::new(false));
        let words =
            format!("the run goes on without it; its beginning is in {}", part(path).display());
        let mut pipe = Pipe::new(to, words);
        let mut frames = Frames::default();
        frames.add(config.started_unix_ns, config);
        pipe.send(&mut frames);
        let clerk = Clerk {
            ring,
            notes: inbox,
            shared: Arc::clone(&shared),
            finish: Arc::clone(&finish),
            pipe,
            translator: Translator::new(config.started_unix_ns, config.rate_hz),
        };
        let clerk = std::thread::Builder::new()
            .name("record".to_owned())
            .spawn(|| clerk.run())
            .map_err(broken)?;
        let path = path.to_owned();
        Ok((Self { path, child, answers, clerk: Some(clerk), notes, finish, shared }, tap))
    }

    /// Where to say more than ticks.
    #[must_use]
    pub fn notes(&self) -> Notes {
        Notes(self.notes.clone())
    }

    /// Finishes the file, with what the run came to; all ticks must have been
    /// pushed.
    ///
    /// # Errors
    /// [`RecordError::BrokeOff`].
    pub fn finish(mut self, end: End) -> Result<Recorded, RecordError> {
        let _ = self.notes.send(Note::End(end));
        self.close()
    }

    fn close(&mut self) -> Result<Recorded, RecordError> {
        let part = part(&self.path);
        let broke_off = |what| RecordError::BrokeOff { part, what };
        self.finish.store(true, Ordering::Release);
        let passed_on = match self.clerk.take().map(JoinHandle::join) {
            Some(Ok(outcome)) => outcome,
            Some(Err(_)) => Err(io::Error::other("the thread that feeds it panicked")),
            None => return Ok(Recorded { messages: 0, dropped: 0 }),
        };
        if let Err(error) = &passed_on
            && error.kind() == io::ErrorKind::TimedOut
        {
            // It is stopped: not waited for, it finishes the file when it goes on.
            return Err(broke_off("the recorder is stopped".to_owned()));
        }
        let said = answer(&mut self.answers, FINISH);
        match (passed_on, said) {
            (Ok(()), Ok(said)) => {
                let _ = self.child.wait();
                match said.strip_prefix(DONE).and_then(|messages| messages.parse().ok()) {
                    Some(messages) => Ok(Recorded { messages, dropped: self.shared.dropped() }),
                    None => Err(broke_off(reason(&said))),
                }
            }
            (Err(error), Ok(said)) if said.is_empty() => {
                let _ = self.child.wait();
                Err(broke_off(format!("the recorder was ended ({error})")))
            }
            (Err(_), Ok(said)) => {
                let _ = self.child.wait();
                Err(broke_off(reason(&said)))
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

fn reason(said: &str) -> String {
    said.strip_prefix(FAILED).unwrap_or("the recorder was ended").to_owned()
}

/// The next line that the recorder says; empty when it has ended without one.
fn answer(from: &mut ChildStdout, patience: Duration) -> io::Result<String> {
    let deadline = Instant::now() + patience;
    let mut line = Vec::new();
    let mut byte = [0];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            let what = format!("the recorder has said nothing for {} s", patience.as_secs());
            return Err(io::Error::new(io::ErrorKind::TimedOut, what));
        }
        if !pipe::wait(from, PollFlags::IN, left)? {
            continue;
        }
        match from.read(&mut byte)? {
            1 if byte != *b"\n" => line.extend(byte),
            _ => return Ok(String::from_utf8_lossy(&line).into_owned()),
        }
    }
}
