//! The thread between the ring and the recorder: it turns rows into messages
//! and passes them on.

use std::io;
use std::process::ChildStdin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use rtrb::Consumer;

use super::pipe::{self, Frames};
use super::schema::{End, Loop, Policy};
use super::tap::{Row, Shared};
use super::translate::Translator;

/// What goes over the pipe at once.
const BATCH: usize = 1 << 16;
/// A batch that does not fill goes on its way after this.
const LATEST: Duration = Duration::from_millis(100);
/// How often the recorder is asked to write out what it has.
const FLUSH: Duration = Duration::from_secs(1);
/// Between two looks into an empty ring.
const LOOK: Duration = Duration::from_millis(1);
/// A recorder that takes nothing for so long is given up.
const PATIENCE: Duration = Duration::from_secs(10);

/// What is recorded beside the ticks.
#[derive(Debug)]
pub(super) enum Note {
    Policy(Policy),
    Loop(Loop),
    End(End),
}

/// What there is to record, and where it goes.
#[derive(Debug)]
pub(super) struct Clerk {
    pub(super) ring: Consumer<Row>,
    pub(super) notes: Receiver<Note>,
    pub(super) shared: Arc<Shared>,
    /// Nothing comes any more.
    pub(super) finish: Arc<AtomicBool>,
    pub(super) pipe: Pipe,
    pub(super) translator: Translator,
}

impl Drop for Clerk {
    fn drop(&mut self) {
        self.shared.close();
    }
}

impl Clerk {
    /// Passes on all that comes, until it is told that nothing does; then the
    /// pipe is closed. An error when the recorder was lost on the way: what
    /// comes after that is taken from the ring all the same.
    pub(super) fn run(mut self) -> io::Result<()> {
        let mut frames = Frames::default();
        let (mut sent, mut flushed) = (Instant::now(), Instant::now());
        let mut end = None;
        loop {
            // Before the look at the ring: what was pushed before it is then seen.
            let last = self.finish.load(Ordering::Acquire);
            let mut idle = true;
            while let Ok(row) = self.ring.pop() {
                idle = false;
                self.translator.row(&row, &mut frames);
                if frames.len() >= BATCH {
                    break;
                }
            }
            while let Ok(note) = self.notes.try_recv() {
                match note {
                    Note::Policy(policy) => self.translator.policy(&policy, &mut frames),
                    Note::Loop(row) => self.translator.loop_row(&row, &mut frames),
                    Note::End(said) => end = Some(said),
                }
            }
            if last && idle {
                break;
            }
            if frames.len() > 0 && flushed.elapsed() >= FLUSH {
                flushed = Instant::now();
                frames.add_flush();
            }
            if frames.len() >= BATCH || sent.elapsed() >= LATEST {
                sent = Instant::now();
                self.pipe.send(&mut frames);
            }
            if idle {
                std::thread::sleep(LOOK);
            }
        }
        let time_ns = self.translator.end(&mut frames);
        if let Some(end) = end {
            frames.add(time_ns, &End { dropped: self.shared.dropped(), ..end });
        }
        self.pipe.send(&mut frames);
        self.pipe.close()
    }
}

/// The way to the recorder, while there is one.
#[derive(Debug)]
pub(super) struct Pipe {
    to: Option<ChildStdin>,
    lost: Option<io::Error>,
    /// What to say when it is lost.
    words: String,
}

impl Pipe {
    /// `words` are for the user when the recorder is lost.
    pub(super) fn new(to: ChildStdin, words: String) -> Self {
        Self { to: Some(to), lost: None, words }
    }

    /// Sends and clears; without a recorder it only clears.
    pub(super) fn send(&mut self, frames: &mut Frames) {
        if let Some(to) = &mut self.to
            && let Err(error) = pipe::write_patiently(to, frames.as_slice(), PATIENCE)
        {
            let reason = match error.kind() {
                io::ErrorKind::BrokenPipe => "it has ended".to_owned(),
                io::ErrorKind::TimedOut => format!("it took nothing for {} s", PATIENCE.as_secs()),
                _ => error.to_string(),
            };
            eprintln!("sim-host: the recorder is lost ({reason}); {}", self.words);
            self.to = None;
            self.lost = Some(error);
        }
        frames.clear();
    }

    fn close(&mut self) -> io::Result<()> {
        self.to = None;
        self.lost.take().map_or(Ok(()), Err)
    }
}
