//! Reads a recording as a sequence of answers: a command and the samples up to
//! the one that it answers.

use std::collections::VecDeque;
use std::path::Path;

use leg_control::wire::{self, Header};

use crate::record::read::{ReadError, Reader};
use crate::record::schema::{AnyMessage, Config, Policy};

/// What a recording contains beside its ticks.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The scenario and the program.
    pub config: Config,
    /// Every policy.
    pub policies: Vec<Policy>,
    /// Run id and number of the first tick.
    pub first: (u32, u64),
    /// Number of samples.
    pub ticks: u64,
}

impl Summary {
    /// Reads a recording to its end.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a recording, or has no configuration or tick.
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

/// A command that arrived, and the samples that the controller may have used.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The sample that the command answers.
    pub sample: wire::Sample,
    /// Earlier samples without a command; none in lock-step.
    pub unanswered: Vec<wire::Sample>,
    /// The command.
    pub command: wire::Command,
    /// Why this answer and all after it cannot be compared.
    pub gap: Option<String>,
}

/// Reads the answers of a recording.
pub struct Source {
    reader: Reader,
    samples: VecDeque<wire::Sample>,
    /// Run id and number of the last sample.
    last: Option<(u32, u64)>,
    gap: Option<String>,
}

impl Source {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a recording.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Ok(Self { reader: Reader::open(path)?, samples: VecDeque::new(), last: None, gap: None })
    }

    /// Returns the next answer, `None` after the last.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn next_answer(&mut self) -> Result<Option<Answer>, ReadError> {
        while let Some(message) = self.reader.next_message()? {
            match message {
                AnyMessage::Sample(sample) => self.push(&(&sample).into()),
                AnyMessage::Command(command) if command.is_new => {
                    return Ok(Some(self.answer((&command).into())));
                }
                _ => (),
            }
        }
        Ok(None)
    }

    /// Reads the rest of the file and returns a description of what was wrong
    /// with it.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn warning(&mut self) -> Result<Option<String>, ReadError> {
        while self.reader.next_message()?.is_some() {}
        Ok(self.reader.warning())
    }

    fn push(&mut self, sample: &wire::Sample) {
        let Header { run_id, seq, .. } = sample.header;
        let last = self.last.replace((run_id, seq));
        if last.is_some_and(|last| last.0 != run_id) {
            // The leg was put back to its start, so earlier samples no longer matter.
            self.samples.clear();
        } else if let Some((_, last)) = last
            && seq != last + 1
            && self.gap.is_none()
        {
            self.gap = Some(format!(
                "ticks {} to {} are not in the recording, because its buffer was full; the \
                 controller's state after them is unknown",
                last + 1,
                seq - 1
            ));
        }
        self.samples.push_back(*sample);
    }

    fn answer(&mut self, command: wire::Command) -> Answer {
        let answered = command.header.seq;
        let mut unanswered = Vec::new();
        let mut found = None;
        while let Some(sample) = self.samples.pop_front_if(|s| s.header.seq <= answered) {
            if sample.header.seq == answered {
                found = Some(sample);
            } else {
                unanswered.push(sample);
            }
        }
        let mut gap = self.gap.clone();
        if found.is_none() && gap.is_none() {
            gap = Some(format!("the sample of tick {answered} is not in the recording"));
        }
        Answer { sample: found.unwrap_or_default(), unanswered, command, gap }
    }
}
