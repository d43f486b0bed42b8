//! The thread between the ring and the writer process.

use std::io;
use std::process::ChildStdin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use rtrb::Consumer;

use super::pipe::{self, FrameBuffer};
use super::schema::{End, Loop, Policy};
use super::tap::{RingEntry, RingState};
use super::translate::Translator;

/// Bytes after which the buffered frames are sent.
const BATCH_LEN: usize = 1 << 16;
/// Time after which a batch is sent although it is not full.
const BATCH_INTERVAL: Duration = Duration::from_millis(100);
/// Time between two requests to flush the file.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two polls of an empty ring.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Time after which a writer that takes nothing is given up.
const WRITE_TIMEOUT: Duration = Duration::from_secs(10);

/// A message that does not come from the ring.
#[derive(Debug)]
pub(super) enum SideMessage {
    Policy(Policy),
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
    pub(super) pipe: PipeWriter,
    pub(super) translator: Translator,
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.state.close();
    }
}

impl Feeder {
    /// Runs until `finish` is set and the ring is empty, then closes the pipe.
    /// If the writer is lost, the ring is emptied all the same, so that a loop
    /// in lock-step does not wait for ever.
    ///
    /// # Errors
    /// The error by which the writer was lost.
    pub(super) fn run(mut self) -> io::Result<()> {
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
                match message {
                    SideMessage::Policy(policy) => self.translator.policy(&policy, &mut frames),
                    SideMessage::Loop(timing) => self.translator.timing(&timing, &mut frames),
                    SideMessage::End(message) => end = Some(message),
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
                self.pipe.send(&mut frames);
            }
            if idle {
                std::thread::sleep(POLL_INTERVAL);
            }
        }
        let time_ns = self.translator.end(&mut frames);
        if let Some(end) = end {
            frames.add(time_ns, &End { dropped: self.state.dropped(), ..end });
        }
        self.pipe.send(&mut frames);
        self.pipe.close()
    }
}

/// The pipe to the writer process, until that is lost.
#[derive(Debug)]
pub(super) struct PipeWriter {
    pipe: Option<ChildStdin>,
    error: Option<io::Error>,
    consequence: String,
}

impl PipeWriter {
    /// Takes a non-blocking pipe. `consequence` completes the message that is
    /// printed if the writer is lost.
    pub(super) fn new(pipe: ChildStdin, consequence: String) -> Self {
        Self { pipe: Some(pipe), error: None, consequence }
    }

    /// Sends the frames and clears the buffer; without a writer it only clears.
    pub(super) fn send(&mut self, frames: &mut FrameBuffer) {
        if let Some(pipe) = &mut self.pipe
            && let Err(error) = pipe::write_all(pipe, frames.as_slice(), WRITE_TIMEOUT)
        {
            let reason = match error.kind() {
                io::ErrorKind::BrokenPipe => "it has ended".to_owned(),
                io::ErrorKind::TimedOut => {
                    format!("it read nothing for {} s", WRITE_TIMEOUT.as_secs())
                }
                _ => error.to_string(),
            };
            eprintln!("sim-host: the recorder is lost ({reason}); {}", self.consequence);
            self.pipe = None;
            self.error = Some(error);
        }
        frames.clear();
    }

    fn close(&mut self) -> io::Result<()> {
        self.pipe = None;
        self.error.take().map_or(Ok(()), Err)
    }
}
