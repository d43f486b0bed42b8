//! A run of any leg and any controller recorded by an observer, which receives their messages
//! and changes nothing.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::Duration;

use leg_control::wire::{Command, Sample};
use leg_host::TimeMode;
use leg_host::cli::target::process_status;
use leg_host::discovery::DomainError;
use leg_host::shm::{ConnectError, Observer, Participants, Registration};
use leg_process::Stop;

use super::scene::Scene;
use crate::record::schema::OBSERVED_END;
use crate::record::{
    ChangePoller, ObservedRun, OnFull, RecordError, RecordOptions, RecordTap, Recorder, TickCopy,
    config, now_unix_ns,
};

/// Time between two polls: of the messages, and of a domain for its session.
const POLL_INTERVAL: Duration = Duration::from_micros(500);
/// Polls from one check whether the session goes on to the next.
const CHECK_EVERY: u32 = 100;

/// Why a run was not recorded, or not to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObserveError {
    /// The domain cannot be joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The messages cannot be received.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The recording failed.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The file is there.
    #[error("{} exists already", .0.display())]
    Exists(PathBuf),
    /// No sample came.
    #[error("nothing is recorded: no leg has sent a sample in domain `{0}`")]
    Nothing(String),
    /// The configuration cannot be written.
    #[error("the configuration cannot be recorded: {0}")]
    Config(#[from] toml::ser::Error),
    /// The system refused.
    #[error(transparent)]
    System(#[from] std::io::Error),
}

/// What is recorded, and how.
#[derive(Clone, Debug)]
pub struct ObserveOptions {
    /// The domain.
    pub domain: String,
    /// The file, which must not exist.
    pub file: PathBuf,
    /// Pictures for viewers per second of simulated time.
    pub display_rate_hz: u32,
    /// What to assume of a controller that has no status.
    pub assumed: Assumed,
}

/// The configuration of a controller that has no status.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumed {
    /// Ticks per second.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
}

/// What an observer has recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Observation {
    /// Ticks in the recording.
    pub ticks: u64,
    /// Ticks that it lacks: the samples did not reach the observer, or in real time the leg did
    /// not send them.
    pub missed: u64,
    /// Whether the controller has a status, which has its configuration, law and policy.
    pub has_status: bool,
    /// What ended the run.
    pub ending: String,
}

/// Records the next run of a domain, or the rest of the one that goes on, until its leg ends it,
/// its session is over, or a signal arrives.
///
/// # Errors
/// [`ObserveError`].
pub fn record(options: &ObserveOptions) -> Result<Observation, ObserveError> {
    let ObserveOptions { domain, file, .. } = options;
    Participants::of(domain)?;
    if file.exists() {
        return Err(ObserveError::Exists(file.clone()));
    }
    let stop = Stop::on_signals()?;
    let nothing = || ObserveError::Nothing(domain.clone());
    // Not before the others, who would otherwise find a domain that is never empty.
    while !Participants::of(domain)?.any() {
        if stop.is_raised() {
            return Err(nothing());
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    let registration = Registration::of(domain)?;
    loop {
        if stop.is_raised() || !Participants::of(domain)?.any() {
            return Err(nothing());
        }
        // Its services may not exist yet, or no longer.
        if Observer::can_join(&registration)
            && let Ok(observer) = Observer::join_as_recorder(&registration)
            && let Some(observation) = Run::new(options).follow(&observer, &stop)?
        {
            return Ok(observation);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// A recording in progress.
struct Run {
    options: ObserveOptions,
    /// Begins the recording, which takes a while in which messages come.
    begins: Option<JoinHandle<Result<Begun, ObserveError>>>,
    begun: Option<Begun>,
    scene: Scene,
    messages: Pairs,
    ticks: u64,
    last: Option<(u32, u64)>,
    missed: u64,
    command: Command,
}

/// A recording that has begun.
struct Begun {
    tap: RecordTap,
    /// Before the recorder, since its drop polls a last time.
    changes: Option<ChangePoller>,
    recorder: Recorder,
    has_status: bool,
}

impl Begun {
    /// Begins the recording of the run `run_id`, with what the status of the controller says.
    fn new(options: &ObserveOptions, run_id: u32) -> Result<Self, ObserveError> {
        let ObserveOptions { domain, file, display_rate_hz, assumed } = options;
        let status = process_status(domain).ok();
        let run = ObservedRun {
            rate_hz: status.as_ref().map_or(assumed.rate_hz, |status| status.rate_hz),
            gravity_m_s2: status.as_ref().map_or(assumed.gravity_m_s2, |now| now.gravity_m_s2),
            time_mode: status.as_ref().map_or(TimeMode::LockStep, |status| status.time_mode),
            density_ratio: 0.0,
        };
        let record = RecordOptions { on_full: OnFull::Wait, display_rate_hz: *display_rate_hz };
        let (recorder, tap) = Recorder::begin(file, &run.config(now_unix_ns())?, record)?;
        let Some(status) = status else {
            return Ok(Self { tap, changes: None, recorder, has_status: false });
        };
        if let (Some(estimator), Some(limit_ns)) = (status.estimator, status.stale_limit_ns) {
            recorder.sink().law(config::of_law(estimator, limit_ns, false));
        }
        let changes = Some(ChangePoller::begin(domain, run_id, recorder.sink()));
        Ok(Self { tap, changes, recorder, has_status: true })
    }
}

impl Run {
    fn new(options: &ObserveOptions) -> Self {
        Self {
            options: options.clone(),
            begins: None,
            begun: None,
            scene: Scene::new(&options.domain),
            messages: Pairs::default(),
            ticks: 0,
            last: None,
            missed: 0,
            command: Command::default(),
        }
    }

    /// Records until the run ends; `None` if there was no sample, as in a session of which only
    /// the folder is left.
    fn follow(
        mut self,
        observer: &Observer,
        stop: &Stop,
    ) -> Result<Option<Observation>, ObserveError> {
        let mut polls = 0;
        loop {
            let is_stopped = stop.is_raised();
            polls += 1;
            let is_over = polls % CHECK_EVERY == 0
                && (observer.is_over() || !Participants::of(&self.options.domain)?.any());
            let has_ended = self.receive(observer)?;
            let is_last = has_ended || is_over || is_stopped;
            if self.has_begun(is_last)? {
                while let Some((sample, command)) = self.messages.next(is_last) {
                    self.push(&sample, command);
                }
            }
            let ending = match () {
                () if has_ended => OBSERVED_END,
                () if is_over => "its session was over",
                () if is_stopped => "stopped",
                () => {
                    std::thread::sleep(POLL_INTERVAL);
                    continue;
                }
            };
            return self.finish(ending);
        }
    }

    /// Receives all messages that are there; returns whether the last is the end of the run.
    fn receive(&mut self, observer: &Observer) -> Result<bool, ObserveError> {
        // Commands first: the sample that a command answers was sent before it.
        let receive_commands = |messages: &mut Pairs| {
            while let Some(command) = observer.command() {
                messages.commands.push_back(command);
            }
        };
        receive_commands(&mut self.messages);
        while let Some(sample) = observer.sample() {
            if sample.ends_the_run() {
                // Those between the two loops, too.
                receive_commands(&mut self.messages);
                return Ok(true);
            }
            if self.begins.is_none() && self.begun.is_none() {
                let (options, run_id) = (self.options.clone(), sample.header.run_id);
                let begin = move || Begun::new(&options, run_id);
                let thread = std::thread::Builder::new().name("begin".to_owned());
                self.begins = Some(thread.spawn(begin)?);
            }
            self.messages.samples.push_back(sample);
        }
        Ok(false)
    }

    /// Returns whether the recording has begun, if need be after a wait.
    fn has_begun(&mut self, is_awaited: bool) -> Result<bool, ObserveError> {
        if let Some(begins) = self.begins.take_if(|begins| is_awaited || begins.is_finished()) {
            let begun = begins.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            self.begun = Some(begun);
        }
        Ok(self.begun.is_some())
    }

    fn push(&mut self, sample: &Sample, command: Option<Command>) {
        let (run_id, seq) = (sample.header.run_id, sample.header.seq);
        // A leg that connects to another controller sends its last sample again.
        if self.last == Some((run_id, seq)) {
            return;
        }
        let expected = match self.last {
            Some((run, last)) if run == run_id => last + 1,
            _ => 0,
        };
        self.missed += seq.saturating_sub(expected);
        self.last = Some((run_id, seq));
        self.ticks += 1;
        self.scene.take_sample(sample);
        if let Some(command) = command {
            self.scene.take_command(&command);
            self.command = command;
        }
        let density_ratio = self.scene.density_ratio().unwrap_or_default();
        let place = self.scene.leg();
        let is_new = command.is_some();
        let tick = TickCopy::observed(sample, &self.command, is_new, place, density_ratio);
        if let Some(begun) = &mut self.begun {
            begun.tap.push_observed(&tick);
        }
    }

    /// Completes the file; `None` if there is none.
    fn finish(self, ending: &str) -> Result<Option<Observation>, ObserveError> {
        let Some(Begun { changes, recorder, has_status, .. }) = self.begun else { return Ok(None) };
        drop(changes);
        let end = config::of_observed_end(ending, self.ticks, self.missed);
        let missed = self.missed + recorder.finish(end)?.dropped;
        Ok(Some(Observation { ticks: self.ticks, missed, has_status, ending: ending.to_owned() }))
    }
}

/// Samples and commands in the order in which they were sent.
#[derive(Debug, Default)]
struct Pairs {
    samples: VecDeque<Sample>,
    commands: VecDeque<Command>,
}

impl Pairs {
    /// Returns the next sample, with the command that answers it if there is one; `None` as long
    /// as that may still come, and not if these are the last.
    fn next(&mut self, is_last: bool) -> Option<(Sample, Option<Command>)> {
        let sample = *self.samples.front()?;
        let ahead = |command: &Command| {
            let sign = command.header.run_id.wrapping_sub(sample.header.run_id).cast_signed();
            (sign, command.header.seq)
        };
        let this = (0, sample.header.seq);
        // The samples of these did not arrive.
        while self.commands.pop_front_if(|command| ahead(command) < this).is_some() {}
        let answer = self.commands.pop_front_if(|command| ahead(command) == this);
        if answer.is_none() && self.commands.is_empty() && !is_last {
            return None;
        }
        self.samples.pop_front();
        Some((sample, answer))
    }
}

#[cfg(test)]
mod tests {
    use leg_control::wire::Header;

    use super::*;

    #[test]
    fn each_sample_gets_its_answer_whatever_is_missing() {
        let header = |(run_id, seq)| Header { run_id, seq, ..Header::default() };
        let mut pairs = Pairs::default();
        let sent = [(1, 0), (1, 1), (1, 3), (1, 4), (2, 0), (2, 1)];
        pairs.samples.extend(sent.map(|at| Sample { header: header(at), ..Sample::default() }));
        // Sample 2 was lost, 1 and 4 have no answer, and that to the last has not come yet.
        let answers = [(1, 0), (1, 2), (1, 3), (2, 0)];
        let command = |at| Command { header: header(at), ..Command::default() };
        pairs.commands.extend(answers.map(command));
        let mut all = Vec::new();
        while let Some((sample, command)) = pairs.next(false) {
            let Header { run_id, seq, .. } = sample.header;
            let answered = command.map(|command| (command.header.run_id, command.header.seq));
            all.push(((run_id, seq), answered.is_some()));
            assert!(answered.is_none_or(|answered| answered == (run_id, seq)));
        }
        assert_eq!(
            all,
            [((1, 0), true), ((1, 1), false), ((1, 3), true), ((1, 4), false), ((2, 0), true)]
        );
        assert_eq!(pairs.next(true).map(|(sample, _)| sample.header.seq), Some(1));
    }
}
