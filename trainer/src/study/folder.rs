//! The folder of a study: its plan, and a folder for each seed.

use super::StudyError;
use super::plan::Plan;
use crate::evaluate::metric::Metric;
use crate::evaluate::report::Report;
use leg_process::atomic_file;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use toml::Table;

/// File name of the plan.
pub const PLAN: &str = "study.toml";
/// File names in a seed's folder; the report is written last.
pub const POLICY: &str = "policy.bin";
/// See [`POLICY`].
pub const LEARNING: &str = "learning.csv";
/// See [`POLICY`].
pub const REPORT: &str = "report.json";

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

/// The result of a seed, as `report.json` holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedReport {
    /// Seed of the training.
    pub seed: u64,
    /// [`Plan::fingerprint`] of the plan.
    pub fingerprint: String,
    /// Reason why there is no policy, such as a training that diverged.
    pub failure: Option<String>,
    /// Environment steps after which the best actor was found.
    #[serde(alias = "kept_steps")]
    pub best_steps: Option<u64>,
    /// Metrics by [`Metric::key`]; empty without a policy.
    #[serde(alias = "figures")]
    pub metrics: BTreeMap<String, Option<f64>>,
    /// Complete evaluation, in the form of `trainer eval --json`.
    pub evaluation: Option<serde_json::Value>,
}

impl SeedReport {
    fn new(plan: &Plan, run: &SeedRun) -> Self {
        let mut report = Self {
            seed: run.seed,
            fingerprint: plan.fingerprint(),
            failure: None,
            best_steps: None,
            metrics: BTreeMap::new(),
            evaluation: None,
        };
        match &run.outcome {
            Err(why) => report.failure = Some(why.clone()),
            Ok(trained) => {
                report.best_steps = Some(trained.best_steps);
                let metrics = Metric::all().into_iter();
                report.metrics = metrics.map(|f| (f.key(), f.of(&trained.report))).collect();
                let json = trained.report.to_json();
                report.evaluation = Some(serde_json::from_str(&json).expect("JSON, just written"));
            }
        }
        report
    }

    /// Returns the value of a metric; `None` where it has none.
    #[must_use]
    pub fn metric(&self, metric: Metric) -> Option<f64> {
        self.metrics.get(&metric.key()).copied().flatten()
    }
}

/// A seed that no other process trains into this study's folder: the seed's folder is locked
/// until this is dropped or the process ends.
#[derive(Debug)]
pub struct Claim {
    folder: PathBuf,
    _lock: File,
}

impl Claim {
    /// Writes a file of the seed.
    ///
    /// # Errors
    /// [`StudyError::File`] when it cannot be written.
    pub(super) fn write(&self, name: &str, content: &[u8]) -> Result<(), StudyError> {
        let file = self.folder.join(name);
        atomic_file::write(&file, content).map_err(StudyError::file(&file))
    }
}

/// A study's folder, checked to hold the study of its plan.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    plan: Plan,
}

impl Folder {
    /// Creates the folder of a plan, or opens an existing one.
    ///
    /// # Errors
    /// [`StudyError::OtherStudy`] when it holds another plan; [`StudyError::File`] when a file
    /// cannot be read or written.
    pub fn begin(path: &Path, plan: Plan) -> Result<Self, StudyError> {
        let file = path.join(PLAN);
        if let Some(text) = read(&file)? {
            let there: Table = text.parse().map_err(|e| StudyError::content(&file, &e))?;
            if let Some([key, there, here]) = plan.difference(&there) {
                return Err(StudyError::OtherStudy { folder: path.into(), key, there, here });
            }
        } else {
            fs::create_dir_all(path).map_err(StudyError::file(path))?;
            // Shards that begin at the same time write the same content.
            atomic_file::write(&file, plan.to_toml().as_bytes())
                .map_err(StudyError::file(&file))?;
        }
        Ok(Self { path: path.into(), plan })
    }

    /// Opens the folder of an existing study.
    ///
    /// # Errors
    /// [`StudyError`] when there is none, or a file cannot be read.
    pub fn open(path: &Path) -> Result<Self, StudyError> {
        let file = path.join(PLAN);
        let missing = || StudyError::content(&file, &"is not there: no study was begun here");
        let text = read(&file)?.ok_or_else(missing)?;
        let plan: Plan = toml::from_str(&text).map_err(|e| StudyError::content(&file, &e))?;
        Ok(Self { path: path.into(), plan })
    }

    /// Returns the plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the path of a seed's folder.
    #[must_use]
    pub fn seed(&self, seed: u64) -> PathBuf {
        self.path.join("seeds").join(format!("{seed:04}"))
    }

    /// Returns a seed's result; `None` while it is not complete.
    ///
    /// # Errors
    /// [`StudyError`] when it belongs to another study or seed, or a file cannot be read.
    pub fn report(&self, seed: u64) -> Result<Option<SeedReport>, StudyError> {
        let file = self.seed(seed).join(REPORT);
        let Some(text) = read(&file)? else { return Ok(None) };
        let report: SeedReport =
            serde_json::from_str(&text).map_err(|e| StudyError::content(&file, &e))?;
        let foreign = |what: &str, there: &dyn Display, here: &dyn Display| {
            Err(StudyError::content(&file, &format!("{what} is {there}, not this study's {here}")))
        };
        let fingerprint = self.plan.fingerprint();
        if report.seed != seed {
            return foreign("seed", &report.seed, &seed);
        }
        if report.fingerprint != fingerprint {
            return foreign("fingerprint", &report.fingerprint, &fingerprint);
        }
        Ok(Some(report))
    }

    /// Returns the results by ascending seed, and the seeds that are missing.
    ///
    /// # Errors
    /// As [`Self::report`].
    pub fn reports(&self) -> Result<(Vec<SeedReport>, Vec<u64>), StudyError> {
        let (mut reports, mut missing) = (Vec::new(), Vec::new());
        for seed in self.plan.seeds.iter() {
            match self.report(seed)? {
                Some(report) => reports.push(report),
                None => missing.push(seed),
            }
        }
        Ok((reports, missing))
    }

    /// Writes the files of a claimed seed.
    ///
    /// # Errors
    /// [`StudyError::File`] when a file cannot be written.
    pub fn save(&self, run: &SeedRun, claim: &Claim) -> Result<SeedReport, StudyError> {
        let report = SeedReport::new(&self.plan, run);
        claim.write(LEARNING, &run.learning_csv)?;
        if let Ok(trained) = &run.outcome {
            claim.write(POLICY, &trained.policy)?;
        }
        let json = serde_json::to_string_pretty(&report).expect("numbers have a JSON form");
        claim.write(REPORT, format!("{json}\n").as_bytes())?;
        Ok(report)
    }

    /// Creates a seed's folder and locks it; `None` while another process holds the lock.
    ///
    /// Only the holder writes into the folder, so temporary files there are those of a
    /// process that was killed, and are removed. On a file system without locks, or whose
    /// locks do not reach other machines, a seed may be trained twice, with the same result.
    ///
    /// # Errors
    /// [`StudyError::File`] when the seed's files could not be written.
    pub fn claim(&self, seed: u64) -> Result<Option<Claim>, StudyError> {
        let folder = self.seed(seed);
        let failed = || StudyError::file(&folder);
        fs::create_dir_all(&folder).map_err(failed())?;
        let lock = File::open(&folder).map_err(failed())?;
        match lock.try_lock() {
            Ok(()) => atomic_file::remove_abandoned(&folder).map_err(failed())?,
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(_)) => {}
        }
        // Before the training, not after it.
        let report = folder.join(REPORT);
        atomic_file::check(&report).map_err(StudyError::file(&report))?;
        Ok(Some(Claim { folder, _lock: lock }))
    }
}

/// Reads a file; `None` where it does not exist.
fn read(file: &Path) -> Result<Option<String>, StudyError> {
    match fs::read_to_string(file) {
        Ok(text) => Ok(Some(text)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StudyError::file(file)(e)),
    }
}
