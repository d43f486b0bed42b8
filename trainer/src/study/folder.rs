//! Where a study is kept: its plan, and a folder for each seed.

use super::StudyError;
use super::plan::Plan;
use super::run::SeedRun;
use crate::evaluate::metric::Metric;
use leg_process::atomic_file;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use toml::Table;

/// The plan's file.
pub const PLAN: &str = "study.toml";
/// A seed's files; the report is written last.
pub const POLICY: &str = "policy.bin";
/// See [`POLICY`].
pub const LEARNING: &str = "learning.csv";
/// See [`POLICY`].
pub const REPORT: &str = "report.json";
/// What files under way are called, before they have their names.
const TEMPORARY: &str = ".tmp";

/// A seed's result, as `report.json` holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedReport {
    /// The seed.
    pub seed: u64,
    /// [`Plan::fingerprint`] of the plan it was made by.
    pub fingerprint: String,
    /// Why there is no policy, where there is none: the training diverged.
    pub failure: Option<String>,
    /// Steps after which the actor that is kept was.
    pub best_steps: Option<u64>,
    /// By [`Metric::key`]; empty without a policy.
    pub metrics: BTreeMap<String, Option<f64>>,
    /// All of the evaluation, as `trainer eval --json` prints it.
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

    /// A metric's value; `None` where it has none.
    #[must_use]
    pub fn metric(&self, metric: Metric) -> Option<f64> {
        self.metrics.get(&metric.key()).copied().flatten()
    }
}

/// A study's folder, known to hold the study of this plan.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    plan: Plan,
}

impl Folder {
    /// Begins the folder of a plan, or takes up the one that is there.
    ///
    /// # Errors
    /// [`StudyError::Another`] when it is that of another plan; what the system refuses.
    pub fn begin(path: &Path, plan: Plan) -> Result<Self, StudyError> {
        let file = path.join(PLAN);
        if let Some(text) = read(&file)? {
            let there: Table = text.parse().map_err(|e| StudyError::content(&file, &e))?;
            if let Some([key, there, here]) = plan.difference(&there) {
                return Err(StudyError::Another { folder: path.into(), key, there, here });
            }
        } else {
            fs::create_dir_all(path).map_err(StudyError::file(path))?;
            // Shards that begin at the same time write the same.
            atomic_file::write(&file, plan.to_toml().as_bytes())
                .map_err(StudyError::file(&file))?;
        }
        Ok(Self { path: path.into(), plan })
    }

    /// Opens the folder of a study that was begun.
    ///
    /// # Errors
    /// When there is none; what the system refuses.
    pub fn open(path: &Path) -> Result<Self, StudyError> {
        let file = path.join(PLAN);
        let missing = || StudyError::content(&file, &"is not there: no study was begun here");
        let text = read(&file)?.ok_or_else(missing)?;
        let plan: Plan = toml::from_str(&text).map_err(|e| StudyError::content(&file, &e))?;
        Ok(Self { path: path.into(), plan })
    }

    /// Its plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of a seed.
    #[must_use]
    pub fn seed(&self, seed: u64) -> PathBuf {
        self.path.join("seeds").join(format!("{seed:04}"))
    }

    /// A seed's result; `None` while it is not done.
    ///
    /// # Errors
    /// When it is not that of this study's seed; what the system refuses.
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

    /// The results that are there, by ascending seed, and the seeds that are missing.
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

    /// Writes what a seed came to.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn keep(&self, run: &SeedRun) -> Result<SeedReport, StudyError> {
        let report = SeedReport::new(&self.plan, run);
        self.begin_seed(run.seed)?;
        self.write(run.seed, LEARNING, &run.learning_csv)?;
        if let Ok(trained) = &run.outcome {
            self.write(run.seed, POLICY, &trained.policy)?;
        }
        let json = serde_json::to_string_pretty(&report).expect("numbers have a JSON form");
        self.write(run.seed, REPORT, format!("{json}\n").as_bytes())?;
        Ok(report)
    }

    /// Makes a seed's folder, and clears it of what a killed process left.
    pub(super) fn begin_seed(&self, seed: u64) -> Result<(), StudyError> {
        let folder = self.seed(seed);
        fs::create_dir_all(&folder).map_err(StudyError::file(&folder))?;
        for entry in fs::read_dir(&folder).map_err(StudyError::file(&folder))? {
            let entry = entry.map_err(StudyError::file(&folder))?;
            if entry.file_name().to_string_lossy().starts_with(TEMPORARY) {
                // Gone already is as good.
                _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }

    pub(super) fn write(&self, seed: u64, name: &str, content: &[u8]) -> Result<(), StudyError> {
        let file = self.seed(seed).join(name);
        atomic_file::write(&file, content).map_err(StudyError::file(&file))
    }
}

/// A file's text; `None` where there is none.
fn read(file: &Path) -> Result<Option<String>, StudyError> {
    match fs::read_to_string(file) {
        Ok(text) => Ok(Some(text)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StudyError::file(file)(e)),
    }
}
