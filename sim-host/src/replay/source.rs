//! A recording as a sequence of answers: a command, and the samples up to the
//! one that it answers.

use std::collections::VecDeque;
use std::path::Path;

use leg_control::wire::{self, Header};

use crate::record::read::{ReadError, Reader};
use crate::record::schema::{AnyMessage, Command, Config, Policy};

/// What a recording says beside its ticks.
#[derive(Clone, Debug)]
pub struct Summary {
    /// What was played.
    pub config: Config,
    /// Every policy.
    pub policies: Vec<Policy>,
    /// Its first run and the number of its first tick.
    pub first: (u32, u64),
    /// Samples in it.
    pub ticks: u64,
}

impl Summary {
    /// Reads through a recording.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn of(path: &Path) -> Result<Self, ReadError> {
        let mut reader = Reader::open(path)?;
        let (mut config, mut policies) = (None, Vec::new());
        let (mut first, mut ticks) = (None, 0);
        while let Some(message) = reader.next_message()? {
            match message {
                AnyMessage::Config(found) => config = Some(found),
                AnyMessage::Policy(policy) => policies.push(policy),
                AnyMessage::Sample(sample) => {
                    first.get_or_insert((sample.run_id, sample.seq));
                    ticks += 1;
                }
                _ => (),
            }
        }
        let empty = |what| ReadError::Empty { path: path.to_owned(), what };
        let config = config.ok_or_else(|| empty("configuration"))?;
        let first = first.ok_or_else(|| empty("tick"))?;
        Ok(Self { config, policies, first, ticks })
    }
}

/// A command that came, and what the controller may have gone by.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The sample that it answers.
    pub sample: wire::Sample,
    /// Those before it for which no command came; none in lock-step.
    pub unanswered: Vec<wire::Sample>,
    /// The command.
    pub command: Command,
    /// Why nothing can be said of this answer and all after it.
    pub gap: Option<String>,
}

/// Reads the answers of a recording.
pub struct Source {
    reader: Reader,
    samples: VecDeque<wire::Sample>,
    /// Run and number.
    last: Option<(u32, u64)>,
    gap: Option<String>,
}

impl Source {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Ok(Self { reader: Reader::open(path)?, samples: VecDeque::new(), last: None, gap: None })
    }

    /// The next answer, `None` after the last.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn next_answer(&mut self) -> Result<Option<Answer>, ReadError> {
        while let Some(message) = self.reader.next_message()? {
            match message {
                AnyMessage::Sample(sample) => self.sample(&(&sample).into()),
                AnyMessage::Command(command) if command.is_new => {
                    return Ok(Some(self.answer(command)));
                }
                _ => (),
            }
        }
        Ok(None)
    }

    /// What was wrong with the file; once all is read.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn warning(&mut self) -> Result<Option<String>, ReadError> {
        while self.reader.next_message()?.is_some() {}
        Ok(self.reader.warning())
    }

    fn sample(&mut self, sample: &wire::Sample) {
        let Header { run_id, seq, .. } = sample.header;
        let last = self.last.replace((run_id, seq));
        if last.is_some_and(|last| last.0 != run_id) {
            // The leg was put back to its start: what it sensed before is over.
            self.samples.clear();
        } else if let Some((_, last)) = last
            && seq != last + 1
            && self.gap.is_none()
        {
            self.gap = Some(format!(
                "ticks {} to {} are not in the recording: the recorder had no room for them; \
                 what the controller knew after them cannot be told",
                last + 1,
                seq - 1
            ));
        }
        self.samples.push_back(*sample);
    }

    fn answer(&mut self, command: Command) -> Answer {
        let mut unanswered = Vec::new();
        let mut found = None;
        while let Some(sample) = self.samples.pop_front_if(|s| s.header.seq <= command.seq) {
            if sample.header.seq == command.seq {
                found = Some(sample);
            } else {
                unanswered.push(sample);
            }
        }
        let mut gap = self.gap.clone();
        if found.is_none() && gap.is_none() {
            gap = Some(format!("the sample of tick {} is not in the recording", command.seq));
        }
        Answer { sample: found.unwrap_or_default(), unanswered, command, gap }
    }
}
