//! Reads a recording as a sequence of answers: a command and the samples up to
//! the one that it answers.

use std::collections::VecDeque;

use leg_control::wire::{self, Header};

use crate::record::contents::{Contents, Messages};
use crate::record::read::ReadError;
use crate::record::schema::AnyMessage;

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
pub struct Source<'a> {
    contents: &'a Contents,
    messages: Messages,
    samples: VecDeque<wire::Sample>,
    /// Run id and number of the last sample.
    last: Option<(u32, u64)>,
    gap: Option<String>,
}

impl<'a> Source<'a> {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] if its messages cannot be read.
    pub fn open(contents: &'a Contents) -> Result<Self, ReadError> {
        let messages = contents.messages()?;
        Ok(Self { contents, messages, samples: VecDeque::new(), last: None, gap: None })
    }

    /// Returns the next answer, `None` after the last.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails, or the samples are those of several runs.
    pub fn next_answer(&mut self) -> Result<Option<Answer>, ReadError> {
        while let Some(message) = self.messages.next_message()? {
            match message {
                AnyMessage::Sample(sample) => self.push(&(&sample).into())?,
                AnyMessage::Command(command) if command.is_new => {
                    return Ok(Some(self.answer((&command).into())));
                }
                _ => (),
            }
        }
        Ok(None)
    }

    fn push(&mut self, sample: &wire::Sample) -> Result<(), ReadError> {
        let Header { run_id, seq, .. } = sample.header;
        let merged = |how| Err(self.contents.merged(how));
        let expected = match self.last.replace((run_id, seq)) {
            // A leg that is put back to its start begins the next run, and earlier samples no
            // longer matter.
            Some((last, _)) if run_id == last.wrapping_add(1) => {
                self.samples.clear();
                0
            }
            Some((last, _)) if run_id != last => {
                return merged(format!("tick {seq} has run id {run_id}, the one before {last}"));
            }
            Some((_, last)) if seq <= last => {
                return merged(format!("tick {seq} comes after tick {last}"));
            }
            Some((_, last)) => last.saturating_add(1),
            None => 0,
        };
        if seq > expected && self.gap.is_none() {
            let cause = match self.contents.dropped {
                Some(0) => "because another program has removed them",
                Some(_) => "because its buffer was full",
                None => "because its buffer was full or another program has removed them",
            };
            self.gap = Some(format!(
                "ticks {expected} to {} are not in the recording, {cause}; the controller's state \
                 after them is unknown",
                seq - 1
            ));
        }
        self.samples.push_back(*sample);
        Ok(())
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
