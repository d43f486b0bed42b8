//! Training and evaluation of several seeds in parallel.

use super::plan::Plan;
use crate::evaluate::report::Report;
use crate::simd::Isa;
use crate::train::Training;
use crate::trained::TrainedPolicy;
use leg_control::policy::Policy;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};

/// The result of one seed.
#[derive(Clone, Debug)]
pub struct SeedRun {
    /// The seed.
    pub seed: u64,
    /// Log with a row for every episode, CSV.
    pub learning_csv: Vec<u8>,
    /// Policy and evaluation, or the reason why there is none.
    pub outcome: Result<EvaluatedPolicy, String>,
}

/// A policy with its evaluation.
#[derive(Clone, Debug)]
pub struct EvaluatedPolicy {
    /// The policy file.
    pub policy: Vec<u8>,
    /// Environment steps after which the best actor was found.
    pub best_steps: u64,
    /// Evaluation of the policy.
    pub report: Report,
}

/// Seeds that run on threads of their own.
#[derive(Debug)]
pub struct Jobs {
    /// Receives each seed when it is complete; closes when all are, or after a stop.
    pub done: Receiver<SeedRun>,
    stopped: Arc<AtomicBool>,
    under_way: Arc<Vec<AtomicU64>>,
}

/// Units in which the progress of one seed is counted.
const WHOLE: f64 = 1e6;

impl Jobs {
    /// Starts `jobs` threads, each of which runs one seed at a time.
    ///
    /// # Panics
    /// If the system cannot create a thread.
    #[must_use]
    pub fn start(plan: &Plan, seeds: Vec<u64>, jobs: NonZeroUsize) -> Self {
        let jobs = jobs.get().min(seeds.len());
        let (sender, done) = channel();
        let stopped = Arc::new(AtomicBool::new(false));
        let under_way: Arc<Vec<AtomicU64>> =
            Arc::new((0..jobs).map(|_| AtomicU64::new(0)).collect());
        let plan = Arc::new(plan.clone());
        let (seeds, next) = (Arc::new(seeds), Arc::new(AtomicUsize::new(0)));
        for job in 0..jobs {
            let (plan, seeds, next) = (plan.clone(), seeds.clone(), next.clone());
            let (sender, stopped) = (sender.clone(), stopped.clone());
            let under_way = under_way.clone();
            // The evaluation uses the pool of the calling thread. A pool of one keeps each job
            // on its thread.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
            std::thread::spawn(move || {
                while let Some(&seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let at = &under_way[job];
                    let report = |share: f64| at.store((share * WHOLE) as u64, Ordering::Relaxed);
                    let go_on = |share: f64| {
                        report(share);
                        !stopped.load(Ordering::Relaxed)
                    };
                    let Some(run) = pool.install(|| one(&plan, seed, go_on)) else { break };
                    report(0.0);
                    // The receiver is gone after a stop.
                    if sender.send(run).is_err() {
                        break;
                    }
                }
            });
        }
        Self { done, stopped, under_way }
    }

    /// Returns the progress of all running seeds, in seeds.
    #[must_use]
    pub fn share_under_way(&self) -> f64 {
        self.under_way.iter().map(|at| at.load(Ordering::Relaxed) as f64 / WHOLE).sum()
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        self.stopped.store(true, Ordering::Relaxed);
    }
}

/// Runs one seed from its first step to its evaluation. Calls `go_on` after every episode, with
/// the completed share of the training; returns `None` when that returns false.
fn one(plan: &Plan, seed: u64, go_on: impl Fn(f64) -> bool) -> Option<SeedRun> {
    let mut training = Training::new(plan.config.clone(), seed, Isa::best());
    let mut log = csv::Writer::from_writer(Vec::new());
    let learnt = loop {
        match training.episode() {
            Ok(Some(record)) => log.serialize(record).expect("a row in memory"),
            Ok(None) => break Ok(()),
            Err(diverged) => break Err(diverged.to_string()),
        }
        if !go_on(training.share_done()) {
            return None;
        }
    };
    let learning_csv = log.into_inner().expect("rows in memory");
    let outcome = learnt.and_then(|()| finish(plan, &training));
    Some(SeedRun { seed, learning_csv, outcome })
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
