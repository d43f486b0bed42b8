//! The thread between the ring and the writer process.

use leg_process::stderr;
use std::io;
use std::process::{ChildStdin, ChildStdout};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use rtrb::Consumer;
use rustix::process::{Pid, Signal, kill_process};

use super::pipe::{self, FrameBuffer};
use super::schema::{End, Law, Loop, Policy, SetPoint};
use super::tap::{RingEntry, RingState};
use super::translate::Translator;
use super::writer_process::{DONE, FAILED};

/// Bytes after which the buffered frames are sent.
const BATCH_LEN: usize = 1 << 16;
/// Time after which a batch is sent although it is not full.
const BATCH_INTERVAL: Duration = Duration::from_millis(100);
/// Time between two requests to flush the file.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two polls of an empty ring.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Time after which a writer that reads nothing is given up.
const WRITE_TIMEOUT: Duration = Duration::from_secs(10);
/// Time that the writer may take to complete its file: a large one on a slow disk.
pub(super) const FINISH_TIMEOUT: Duration = Duration::from_mins(1);

/// A message that does not come from the ring.
#[derive(Debug)]
pub(super) enum SideMessage {
    Policy(Policy),
    SetPoint(SetPoint),
    Law(Law),
    Loop(Loop),
    End(End),
}

/// Converts the entries of the ring to messages and sends them to the writer.
#[derive(Debug)]
pub(super) struct Feeder {
    pub(super) ring: Consumer<RingEntry>,
    pub(super) side: Receiver<SideMessage>,
    pub(super) state: Arc<RingState>,
    /// Set when nothing more will be pushed.
    pub(super) finish: Arc<AtomicBool>,
    pub(super) writer: Writer,
    pub(super) translator: Translator,
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.state.close();
    }
}

impl Feeder {
    /// Runs until `finish` is set and the ring is empty, then waits until the writer has
    /// completed the file. Returns the number of messages in it.
    ///
    /// If the writer is lost, the ring is emptied all the same, so that a loop in lock-step
    /// does not wait for ever.
    ///
    /// # Errors
    /// How the writer was lost.
    pub(super) fn run(mut self) -> Result<u64, LostWriter> {
        let mut frames = FrameBuffer::default();
        let (mut sent, mut flushed) = (Instant::now(), Instant::now());
        let mut end = None;
        loop {
            // Loaded before the ring is read: entries pushed before it was set are then seen.
            let last = self.finish.load(Ordering::Acquire);
            let mut idle = true;
            while let Ok(entry) = self.ring.pop() {
                idle = false;
                self.translator.add(&entry, &mut frames);
                if frames.len() >= BATCH_LEN {
                    break;
                }
            }
            while let Ok(message) = self.side.try_recv() {
                self.translator.side(&message, &mut frames);
                if let SideMessage::End(message) = message {
                    end = Some(message);
                }
            }
            if last && idle {
                break;
            }
            if frames.len() > 0 && flushed.elapsed() >= FLUSH_INTERVAL {
                flushed = Instant::now();
                frames.add_flush();
            }
            if frames.len() >= BATCH_LEN || sent.elapsed() >= BATCH_INTERVAL {
                sent = Instant::now();
                self.writer.send(&mut frames);
            }
            if idle {
                std::thread::sleep(POLL_INTERVAL);
            }
        }
        let end = end.map(|end| End { dropped: end.dropped + self.state.dropped(), ..end });
        self.translator.end(end.as_ref(), &mut frames);
        self.writer.send(&mut frames);
        self.writer.close()
    }
}

/// How the writer was lost.
#[derive(Clone, Debug)]
pub(super) struct LostWriter {
    pub(super) cause: String,
    /// It was silent, and was continued in case that it was stopped: it completes the file by
    /// itself.
    pub(super) is_continued: bool,
}

impl LostWriter {
    fn ended(line: &str) -> Self {
        let cause = line.strip_prefix(FAILED).unwrap_or("the recorder was ended").to_owned();
        Self { cause, is_continued: false }
    }

    fn silent(what: &str, time: Duration) -> Self {
        let cause = format!("the recorder has {what} for {} s; is it stopped?", time.as_secs());
        Self { cause, is_continued: true }
    }
}

/// The run's end of the writer process.
#[derive(Debug)]
pub(super) struct Writer {
    /// `None` once the writer is lost.
    pipe: Option<ChildStdin>,
    reports: ChildStdout,
    /// The process, which is not waited for before this value is dropped.
    pid: Pid,
    lost: Option<LostWriter>,
}

impl Writer {
    /// Takes the non-blocking pipe to the writer `pid` and the one with its reports.
    pub(super) fn new(pid: Pid, pipe: ChildStdin, reports: ChildStdout) -> Self {
        Self { pipe: Some(pipe), reports, pid, lost: None }
    }

    /// Gives up a writer that has done nothing for `time`. The pipe has ended; where the writer
    /// was stopped it now continues, completes its file and ends.
    fn give_up(&self, what: &str, time: Duration) -> LostWriter {
        let _ = kill_process(self.pid, Signal::CONT);
        LostWriter::silent(what, time)
    }

    /// Sends the frames and clears the buffer; without a writer it only clears.
    pub(super) fn send(&mut self, frames: &mut FrameBuffer) {
        if let Some(pipe) = &mut self.pipe
            && let Err(error) = pipe::write_all(pipe, frames.as_slice(), WRITE_TIMEOUT)
        {
            self.pipe = None;
            let lost = match error.kind() {
                io::ErrorKind::TimedOut => self.give_up("read nothing", WRITE_TIMEOUT),
                // It reports the cause before it ends.
                _ => match pipe::read_line(&mut self.reports, WRITE_TIMEOUT) {
                    Ok(line) => LostWriter::ended(&line),
                    Err(_) => LostWriter { cause: error.to_string(), is_continued: false },
                },
            };
            stderr::print_line(format_args!(
                "sim-host: warning: the run continues without its recording: {}",
                lost.cause
            ));
            self.lost = Some(lost);
        }
        frames.clear();
    }

    fn close(&mut self) -> Result<u64, LostWriter> {
        // The end of the pipe makes the writer complete the file.
        drop(self.pipe.take());
        if let Some(lost) = self.lost.take() {
            return Err(lost);
        }
        let line = pipe::read_line(&mut self.reports, FINISH_TIMEOUT)
            .map_err(|_| self.give_up("reported nothing", FINISH_TIMEOUT))?;
        let messages = line.strip_prefix(DONE).and_then(|messages| messages.parse().ok());
        messages.ok_or_else(|| LostWriter::ended(&line))
    }
}
