//! Training and evaluation of several seeds in parallel.

use super::StudyError;
use super::folder::{Claim, EvaluatedPolicy, Folder, SeedRun};
use super::plan::Plan;
use crate::evaluate::report::Report;
use crate::run::recent::RecentEpisodes;
use crate::run::tensorboard::EventWriter;
use crate::train::Training;
use crate::trained::TrainedPolicy;
use leg_control::policy::Policy;
use leg_simd::Isa;
use rayon::ThreadPoolBuilder;
use std::collections::VecDeque;
use std::ffi::OsString;
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// What became of a seed.
#[derive(Debug)]
pub enum SeedEvent {
    /// It was trained here, and its result is to be saved under the claim.
    Trained(Box<SeedRun>, Claim),
    /// Another process has completed it.
    Elsewhere(u64),
    /// All seeds that are left are being trained by other processes; this is one of them.
    Waiting(u64),
    /// Its folder cannot be used.
    Failed(StudyError),
}

/// Seeds that run on threads of their own.
#[derive(Debug)]
pub struct Jobs {
    /// Receives what becomes of each seed; closes when all are complete, or after a stop.
    pub events: Receiver<SeedEvent>,
    /// Number of threads that could be started.
    pub threads: usize,
    shared: Arc<Shared>,
}

/// What the threads share.
#[derive(Debug)]
struct Shared {
    folder: Folder,
    /// Folder for TensorBoard events.
    board: Option<PathBuf>,
    /// Seeds that are not taken yet.
    left: Mutex<VecDeque<u64>>,
    stopped: AtomicBool,
    /// Progress of each thread.
    under_way: Vec<AtomicU64>,
}

/// Units in which the progress of one seed is counted.
const WHOLE: f64 = 1e6;
/// Time between two looks at seeds that other processes train.
const WAIT: Duration = Duration::from_millis(200);

impl Jobs {
    /// Starts up to `jobs` threads, each of which runs one seed at a time, with TensorBoard events
    /// in a folder of its own below `board`, if that is given.
    ///
    /// # Errors
    /// Returns the system's error when not even one can be started.
    pub fn start(
        folder: &Folder,
        seeds: Vec<u64>,
        jobs: NonZeroUsize,
        board: Option<&Path>,
    ) -> io::Result<Self> {
        let jobs = jobs.get().min(seeds.len());
        let (sender, events) = channel();
        let shared = Arc::new(Shared {
            folder: folder.clone(),
            board: board.map(Path::to_owned),
            left: Mutex::new(seeds.into()),
            stopped: AtomicBool::new(false),
            under_way: (0..jobs).map(|_| AtomicU64::new(0)).collect(),
        });
        let mut threads = 0;
        for job in 0..jobs {
            let (worker, sender) = (shared.clone(), sender.clone());
            let work = move || {
                // The evaluation uses the pool of its thread: this one keeps each job on its own.
                let pool = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
                let _pool = pool.expect("no thread is started");
                worker.work(job, &sender);
            };
            match thread::Builder::new().name(format!("job {job}")).spawn(work) {
                Err(error) if job == 0 => return Err(error),
                Err(_) => break,
                Ok(_) => threads += 1,
            }
        }
        Ok(Self { events, threads, shared })
    }

    /// Returns the progress of all running seeds, in seeds.
    #[must_use]
    pub fn share_under_way(&self) -> f64 {
        let under_way = self.shared.under_way.iter();
        under_way.map(|at| at.load(Ordering::Relaxed) as f64 / WHOLE).sum()
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        self.shared.stopped.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    /// Takes seeds until none is left. Ends early after a stop or a failure.
    fn work(&self, job: usize, events: &Sender<SeedEvent>) {
        let left = || self.left.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut refused, mut waits) = (0, false);
        while !self.is_stopped() {
            let Some(seed) = left().pop_front() else { return };
            let event = match self.take(job, seed) {
                Ok(Some(event)) => event,
                // Another process trains it, and may be killed: it is tried again.
                Ok(None) => {
                    let mut left = left();
                    left.push_back(seed);
                    refused += 1;
                    if refused < left.len() {
                        continue;
                    }
                    drop(left);
                    refused = 0;
                    if !waits && events.send(SeedEvent::Waiting(seed)).is_err() {
                        return;
                    }
                    waits = true;
                    thread::sleep(WAIT);
                    continue;
                }
                Err(error) => SeedEvent::Failed(error),
            };
            refused = 0;
            let ends = matches!(event, SeedEvent::Failed(_));
            // The receiver is gone after a stop.
            if events.send(event).is_err() || ends {
                return;
            }
        }
    }

    /// Trains a seed, unless another process does; `None` in this case, and after a stop.
    fn take(&self, job: usize, seed: u64) -> Result<Option<SeedEvent>, StudyError> {
        let Some(claim) = self.folder.claim(seed)? else { return Ok(None) };
        if self.folder.report(seed)?.is_some() {
            return Ok(Some(SeedEvent::Elsewhere(seed)));
        }
        let report = |share: f64| {
            self.under_way[job].store((share * WHOLE) as u64, Ordering::Relaxed);
        };
        let go_on = |share: f64| {
            report(share);
            !self.is_stopped()
        };
        let run = one(self.folder.plan(), seed, self.board.as_deref(), go_on)?;
        report(0.0);
        Ok(run.map(|run| SeedEvent::Trained(Box::new(run), claim)))
    }

    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Runs one seed from its first step to its evaluation. Calls `go_on` after every episode, with
/// the completed share of the training; returns `None` when that returns false.
fn one(
    plan: &Plan,
    seed: u64,
    board: Option<&Path>,
    go_on: impl Fn(f64) -> bool,
) -> Result<Option<SeedRun>, StudyError> {
    let mut training = Training::new(plan.config.clone(), seed, Isa::best());
    let title = OsString::from(format!("seed-{seed}"));
    let begin = |folder| EventWriter::begin(folder, &title, &training);
    let mut events = board.map(begin).transpose()?;
    let mut recent = RecentEpisodes::default();
    let mut log = csv::Writer::from_writer(Vec::new());
    let learnt = loop {
        match training.episode() {
            Ok(Some(record)) => {
                log.serialize(record).expect("a row in memory");
                if let Some(events) = &mut events {
                    let is_full = record.steps >= training.config().episode.max_steps;
                    recent.push(&record, is_full, training.share_of_stage());
                    events.record(&record, &training, &recent)?;
                }
            }
            Ok(None) => break Ok(()),
            Err(diverged) => break Err(diverged.to_string()),
        }
        if !go_on(training.share_done()) {
            return Ok(None);
        }
    };
    if let Some(events) = &mut events {
        events.end(&training, learnt.is_ok())?;
    }
    let learning_csv = log.into_inner().expect("rows in memory");
    let outcome = learnt.and_then(|()| finish(plan, &training));
    Ok(Some(SeedRun { seed, learning_csv, outcome }))
}

/// Evaluates a completed training. The controller may refuse the policy of a collapsed
/// training, which is a result, too.
fn finish(plan: &Plan, training: &Training) -> Result<EvaluatedPolicy, String> {
    let trained = TrainedPolicy::new(training);
    let blob = trained.blob().map_err(|e| e.to_string())?;
    let policy = Policy::parse(blob.as_slice()).map_err(|e| e.to_string())?;
    let report = Report::new(&policy, plan.eval_starts as usize, plan.eval_seed);
    let best_steps = policy.manifest().provenance.steps;
    Ok(EvaluatedPolicy { policy: blob.as_slice().to_vec(), best_steps, report })
}
