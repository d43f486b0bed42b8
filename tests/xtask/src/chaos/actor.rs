//! A process on the scene, and what it says.

use std::fmt;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use rustix::process::{Pid, Signal, kill_process};

use super::plan::How;

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Leg,
    Controller,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leg => "leg",
            Self::Controller => "controller",
        })
    }
}

/// A line on stderr.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) at: Instant,
    pub(super) text: String,
}

/// What it says of its peer.
#[derive(Clone, Debug)]
pub(super) enum Word {
    Lost(Line),
    /// `None` at first.
    Heard(Option<Line>),
}

impl Word {
    fn of(line: &Line) -> Option<Self> {
        let (silent, parted) = ("nothing from the ", "is over: safe until the next begins");
        if line.text.contains(silent) || line.text.contains(parted) {
            Some(Self::Lost(line.clone()))
        } else if line.text.contains("is heard again, after") {
            Some(Self::Heard(Some(line.clone())))
        } else {
            None
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        matches!(self, Self::Lost(_))
    }
}

impl fmt::Display for Word {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(line) | Self::Heard(Some(line)) => f.write_str(&line.text),
            Self::Heard(None) => f.write_str("none"),
        }
    }
}

type Lines = Arc<Mutex<Vec<Line>>>;

/// A process that does not outlive its value.
pub(super) struct Actor {
    part: Part,
    child: Child,
    lines: Lines,
}

impl Actor {
    pub(super) fn start(mut command: Command, part: Part) -> Result<Self> {
        let lines = Lines::default();
        let child = spawn(&mut command, &lines)?;
        Ok(Self { part, child, lines })
    }

    pub(super) fn part(&self) -> Part {
        self.part
    }

    fn lines(&self) -> MutexGuard<'_, Vec<Line>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether its last word on the peer is that it is lost, with that word;
    /// an error when it has said the same twice.
    pub(super) fn last_word(&self) -> Result<Word> {
        let mut word = Word::Heard(None);
        for line in self.lines().iter() {
            word = match (&word, Word::of(line)) {
                (_, None) => continue,
                (Word::Lost(_), Some(Word::Lost(_)))
                | (Word::Heard(Some(_)), Some(Word::Heard(_))) => {
                    bail!("the {} said twice: {}", self.part, line.text)
                }
                (_, Some(next)) => next,
            };
        }
        Ok(word)
    }

    /// Waits until its last word is as wanted; that word.
    pub(super) fn wait_until(
        &self,
        wanted: impl Fn(&Word) -> bool,
        patience: Duration,
    ) -> Result<Word> {
        let begun = Instant::now();
        loop {
            let word = self.last_word()?;
            if wanted(&word) {
                return Ok(word);
            }
            ensure!(begun.elapsed() < patience, "the {}'s last word is: {word}", self.part);
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Times that it said that its peer is lost.
    pub(super) fn losses(&self) -> usize {
        self.lines().iter().filter(|line| matches!(Word::of(line), Some(Word::Lost(_)))).count()
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        kill_process(pid.context("no process")?, signal).context("cannot signal it")
    }

    /// Does it; a process that ends has ended on return.
    pub(super) fn strike(&mut self, how: How) -> Result<()> {
        match how {
            How::Stop => return self.signal(Signal::STOP),
            How::Kill => self.signal(Signal::KILL)?,
            // Ignored, as under `nohup`, it would be ignored by those started here too.
            How::HangUp if hang_up_is_ignored() => self.signal(Signal::TERM)?,
            How::HangUp => self.signal(Signal::HUP)?,
        }
        ensure!(self.wait(Duration::from_secs(10))?, "the {} does not end", self.part);
        Ok(())
    }

    /// Lets a stopped one go on; when.
    pub(super) fn go_on(&self) -> Result<Instant> {
        let now = Instant::now();
        self.signal(Signal::CONT)?;
        Ok(now)
    }

    /// Starts it again; when.
    pub(super) fn restart(&mut self, mut command: Command) -> Result<Instant> {
        let now = Instant::now();
        self.child = spawn(&mut command, &self.lines)?;
        Ok(now)
    }

    /// It is the process that it was.
    pub(super) fn assert_same(&mut self) -> Result<()> {
        if let Some(status) = self.child.try_wait()? {
            bail!("the {} has ended ({status})", self.part);
        }
        Ok(())
    }

    fn wait(&mut self, patience: Duration) -> Result<bool> {
        let begun = Instant::now();
        while self.child.try_wait()?.is_none() {
            if begun.elapsed() > patience {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        Ok(true)
    }

    /// Tells it to end; whether it has.
    pub(super) fn end(mut self, patience: Duration) -> Result<bool> {
        self.signal(Signal::TERM)?;
        self.wait(patience)
    }

    /// Its last messages.
    pub(super) fn tail(&self) -> String {
        let lines = self.lines();
        let texts: Vec<_> = lines.iter().rev().take(12).rev().map(|l| l.text.as_str()).collect();
        format!("the {} said last:\n  {}", self.part, texts.join("\n  "))
    }
}

impl Drop for Actor {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Whether this process ignores SIGHUP.
pub(super) fn hang_up_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & 1 == 1)
}

fn spawn(command: &mut Command, lines: &Lines) -> Result<Child> {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {command:?}"))?;
    let stderr = child.stderr.take().context("no stderr")?;
    let lines = Arc::clone(lines);
    // It ends with the process, whose stderr then is closed.
    std::thread::spawn(move || listen(stderr, &lines));
    Ok(child)
}

fn listen(stderr: impl Read, lines: &Lines) {
    for text in BufReader::new(stderr).lines().map_while(std::io::Result::ok) {
        let line = Line { at: Instant::now(), text };
        lines.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }
}

/// The whole number that stands right before `unit`.
pub(super) fn number_before(text: &str, unit: &str) -> Option<u64> {
    text.split(unit).next()?.rsplit(' ').next()?.parse().ok()
}
