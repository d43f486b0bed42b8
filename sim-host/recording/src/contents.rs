//! The contents of a recording, whatever other programs have made of the file.
//!
//! `sim-host` writes the messages of a tick one after the other, in the order of ticks. Other
//! programs may sort, merge, filter or double messages. A first pass over the file finds that
//! out; then the messages are read as they are or, if necessary, sorted by their time.

use std::path::{Path, PathBuf};

use super::read::{ReadError, Reader, TimedMessage};
use super::schema::{AnyMessage, Channel, Config, Law, PROFILE, Policy, RECOVERED, SetPoint};

/// Most messages that are sorted in memory: 4 GB.
const MAX_SORTED: u64 = 20_000_000;

/// What a recording contains beside its ticks.
#[derive(Clone, Debug)]
pub struct Contents {
    path: PathBuf,
    profile: String,
    /// Every configuration that differs from the others.
    configs: Vec<Config>,
    /// Every policy that differs from the others.
    pub policies: Vec<Policy>,
    /// Every set-point of a request that differs from the others.
    pub set_points: Vec<SetPoint>,
    /// How the control law ran, where the file tells; every one that differs from the others.
    pub laws: Vec<Law>,
    /// Whether the file has estimates of the controller.
    pub has_estimates: bool,
    /// Log time, ns, run id and number of the first tick.
    first: Option<(u64, u32, u64)>,
    /// Number of samples.
    pub ticks: u64,
    /// Number of commands that were new at their tick.
    pub commands: u64,
    /// Ticks and events that were dropped because the buffer was full; `None` where that is
    /// unknown, because the recorder was killed.
    pub dropped: Option<u64>,
    has_end: bool,
    messages: u64,
    is_in_order: bool,
    flaw: Option<String>,
}

impl Contents {
    /// Reads a recording to its end.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a recording.
    pub fn of(path: &Path) -> Result<Self, ReadError> {
        let mut reader = Reader::open(path)?;
        let mut contents = Self {
            path: path.to_owned(),
            profile: reader.profile().to_owned(),
            configs: Vec::new(),
            policies: Vec::new(),
            set_points: Vec::new(),
            laws: Vec::new(),
            has_estimates: false,
            first: None,
            ticks: 0,
            commands: 0,
            dropped: None,
            has_end: false,
            messages: 0,
            is_in_order: true,
            flaw: None,
        };
        let mut last = (0, 0);
        while let Some(TimedMessage { log_time_ns, message, .. }) = reader.next_message()? {
            contents.messages += 1;
            if let Some(rank) = rank_in_tick(&message) {
                contents.is_in_order &= last < (log_time_ns, rank);
                last = (log_time_ns, rank);
            }
            contents.add(log_time_ns, message);
        }
        contents.flaw = reader.warning();
        if contents.messages == 0 && contents.profile != PROFILE {
            return Err(ReadError::NotOurs { path: contents.path, profile: contents.profile });
        }
        Ok(contents)
    }

    fn add(&mut self, log_time_ns: u64, message: AnyMessage) {
        match message {
            AnyMessage::Config(config) if !self.configs.contains(&config) => {
                self.configs.push(config);
            }
            AnyMessage::Policy(policy) if !self.policies.contains(&policy) => {
                self.policies.push(policy);
            }
            AnyMessage::SetPoint(set_point) if !self.set_points.contains(&set_point) => {
                self.set_points.push(set_point);
            }
            AnyMessage::Law(law) if !self.laws.contains(&law) => self.laws.push(law),
            AnyMessage::Sample(sample) => {
                let this = (log_time_ns, sample.run_id, sample.seq);
                self.first = Some(self.first.map_or(this, |first| first.min(this)));
                self.ticks += 1;
            }
            AnyMessage::Command(command) if command.is_new => self.commands += 1,
            AnyMessage::Estimate(_) => self.has_estimates = true,
            AnyMessage::End(end) => {
                self.has_end = true;
                // What a killed recorder dropped is unknown.
                self.dropped = (end.ending != RECOVERED).then_some(end.dropped);
            }
            _ => (),
        }
    }

    /// Returns the configuration.
    ///
    /// # Errors
    /// [`ReadError`] if the file has none, or those of several recordings.
    pub fn config(&self) -> Result<&Config, ReadError> {
        match self.configs.as_slice() {
            [config] => Ok(config),
            [] => Err(self.missing("configuration", Channel::Config)),
            more => Err(self.merged(format!("it has {} configurations", more.len()))),
        }
    }

    /// Returns run id and number of the earliest tick.
    ///
    /// # Errors
    /// [`ReadError`] if the file has no sample.
    pub fn first(&self) -> Result<(u32, u64), ReadError> {
        let first = self.first.map(|(_, run_id, seq)| (run_id, seq));
        first.ok_or_else(|| self.missing("sample", Channel::Sample))
    }

    /// Returns the error that the file lacks a part.
    #[must_use]
    pub fn missing(&self, what: &'static str, topic: Channel) -> ReadError {
        let (path, is_cut) = (self.path.clone(), self.flaw.is_some());
        ReadError::Missing { path, what, topic, is_cut }
    }

    /// Returns the error that the file holds more than one run.
    #[must_use]
    pub fn merged(&self, how: String) -> ReadError {
        ReadError::Merged { path: self.path.clone(), how }
    }

    /// Returns whether the file is whole: neither cut off nor damaged.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.flaw.is_none()
    }

    /// Returns whether the file has the message that ends a run.
    #[must_use]
    pub fn has_end(&self) -> bool {
        self.has_end
    }

    /// Returns what was wrong with the file, for the user.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.flaw.clone()
    }

    /// Reads the messages: the samples, commands, states and estimates in the order of
    /// their ticks, none twice.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails, or the messages must be sorted and are too many.
    pub fn messages(&self) -> Result<Messages, ReadError> {
        let mut reader = Reader::open(&self.path)?;
        if self.is_in_order {
            return Ok(Messages::AsWritten(Box::new(reader)));
        }
        if self.messages > MAX_SORTED {
            let (path, messages) = (self.path.clone(), self.messages);
            return Err(ReadError::TooManyToSort { path, messages, limit: MAX_SORTED });
        }
        let mut all = Vec::new();
        while let Some(message) = reader.next_message()? {
            all.push(message);
        }
        let key = |timed: &TimedMessage| {
            (timed.log_time_ns, rank_in_tick(&timed.message).unwrap_or(u8::MAX), timed.hash)
        };
        all.sort_by_key(key);
        all.dedup_by_key(|timed| key(timed));
        Ok(Messages::Sorted(all.into_iter()))
    }
}

/// Returns the place of a message among those of its tick; `None` if it needs none.
fn rank_in_tick(message: &AnyMessage) -> Option<u8> {
    match message {
        AnyMessage::Sample(_) => Some(0),
        AnyMessage::Command(_) => Some(1),
        AnyMessage::State(_) => Some(2),
        AnyMessage::Estimate(_) => Some(3),
        _ => None,
    }
}

/// The messages of a recording.
pub enum Messages {
    /// As they are in the file.
    AsWritten(Box<Reader>),
    /// Sorted by time.
    Sorted(std::vec::IntoIter<TimedMessage>),
}

impl Messages {
    /// Returns the next message, `None` after the last.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn next_message(&mut self) -> Result<Option<AnyMessage>, ReadError> {
        let next = match self {
            Self::AsWritten(reader) => reader.next_message()?,
            Self::Sorted(all) => all.next(),
        };
        Ok(next.map(|timed| timed.message))
    }
}
