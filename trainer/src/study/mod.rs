//! Studies: one configuration trained with many seeds, each evaluated, and a summary.
//!
//! Seeds are independent: they run in parallel, on one machine or in [shards](shard) on many,
//! and the result of a seed does not depend on where it ran. A [folder] holds the study:
//!
//! ```text
//! study.toml              the plan: configuration, seeds, evaluation, trainer version
//! seeds/0007/policy.bin   the policy (none where the training failed)
//! seeds/0007/learning.csv a row for every episode
//! seeds/0007/report.json  the evaluation; written last, it marks the seed as complete
//! summary.csv, seeds.csv, summary.svg    once all seeds are complete
//! ```
//!
//! Several processes may work on one folder, on one machine or many: each takes the seeds that
//! no other has [claimed](folder::Claim).
//!
//! The [summary] depends on the files of the seeds alone, so it is the same to the last bit,
//! however often the study was interrupted and however it was split.

pub mod folder;
pub mod merge;
pub mod picture;
pub mod plan;
pub mod run;
pub mod shard;
pub mod summary;
pub mod table;

use crate::run::error::RunError;
use leg_process::remedy;
use std::path::{Path, PathBuf};

/// The reason why a study cannot continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// A file cannot be read or written.
    #[error(
        "{}: {error}; {}",
        path.display(),
        remedy::of_write(error).unwrap_or("check the path and the free space")
    )]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        error: std::io::Error,
    },
    /// TensorBoard events cannot be written.
    #[error(transparent)]
    Events(#[from] RunError),
    /// A file has unexpected content.
    #[error("{}: {why}; remove it if it is damaged", path.display())]
    Content {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The folder holds another study.
    #[error(
        "{}: holds another study: {key} is {there} there, but {here} here; \
         use another folder, or the options of that study",
        folder.display()
    )]
    OtherStudy {
        /// Path of the folder.
        folder: PathBuf,
        /// First key in which the two plans differ.
        key: String,
        /// Value in the folder's plan.
        there: String,
        /// Value in the new plan.
        here: String,
    },
    /// Another process trains a seed.
    #[error("{}: another process trains seed {seed}; wait for it", folder.display())]
    Busy {
        /// The seed.
        seed: u64,
        /// Folder of the study.
        folder: PathBuf,
    },
    /// The folders together lack seeds.
    #[error(
        "of the study's {all} seeds these are missing: {}; run their shards again",
        list(seeds)
    )]
    Missing {
        /// Number of seeds of the study.
        all: u64,
        /// Seeds that are in no folder, ascending.
        seeds: Vec<u64>,
    },
    /// Two folders have different results of the same seed.
    #[error(
        "seed {seed} is in {} and in {}, and they differ ({name}); \
         one is damaged or of another trainer: remove it",
        first.display(),
        second.display()
    )]
    Contradiction {
        /// The seed.
        seed: u64,
        /// Name of the file that differs.
        name: &'static str,
        /// First folder with the seed.
        first: PathBuf,
        /// Second folder with the seed.
        second: PathBuf,
    },
}

impl StudyError {
    fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<'_> {
        move |error| Self::File { path: path.to_owned(), error }
    }

    fn content(path: &Path, why: &impl ToString) -> Self {
        Self::Content { path: path.to_owned(), why: why.to_string() }
    }
}

/// Formats numbers as a list, shortened after the first twelve.
#[must_use]
pub fn list(numbers: &[u64]) -> String {
    const SHOWN: usize = 12;
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(ToString::to_string).collect();
    let rest = numbers.len().saturating_sub(SHOWN);
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("{}{more}", shown.join(", "))
}
