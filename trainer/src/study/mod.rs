//! A study: one training over many seeds, each evaluated, and what they come to.
//!
//! Seeds have nothing to do with each other: they run side by side, on one machine
//! or in [shards](shard) on many, and what a seed leaves does not depend on where
//! it ran. A [folder] holds it:
//!
//! ```text
//! study.toml              the plan: configuration, seeds, evaluation, trainer version
//! seeds/0007/policy.bin   the policy (none where the training failed)
//! seeds/0007/learning.csv a row for every episode
//! seeds/0007/report.json  the evaluation; written last: with it, the seed is done
//! summary.csv, seeds.csv, summary.svg    once all seeds are there
//! ```
//!
//! The [summary] is made of the files of the seeds alone, so that it is the same to
//! the last bit however often the study was interrupted and however it was split.

pub mod folder;
pub mod merge;
pub mod picture;
pub mod plan;
pub mod run;
pub mod shard;
pub mod summary;
pub mod table;

use std::path::{Path, PathBuf};

/// Why a study cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The system does not let a file be read or written.
    #[error("{}: {error}; is it the right place, and is there room?", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// The system's reason.
        error: std::io::Error,
    },
    /// A file does not hold what it should.
    #[error("{}: {why}; if it is damaged, remove it", path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A folder is that of another study.
    #[error(
        "{}: holds another study: {key} is {there} there, but {here} here; \
         use another folder, or what that study was made with",
        folder.display()
    )]
    Another {
        /// The folder.
        folder: PathBuf,
        /// Where the two plans first differ.
        key: String,
        /// What the folder's plan says.
        there: String,
        /// What was asked for.
        here: String,
    },
    /// Folders that together lack seeds.
    #[error("missing of the study's {all} seeds: {}; run their shards again", list(seeds))]
    Missing {
        /// How many there should be.
        all: u64,
        /// Those that are in no folder, ascending.
        seeds: Vec<u64>,
    },
    /// Two folders have the same seed with different results.
    #[error(
        "seed {seed} is in {} and in {}, and they differ ({name}); \
         one was not made by this trainer, or is damaged: remove it",
        first.display(),
        second.display()
    )]
    Contradiction {
        /// The seed.
        seed: u64,
        /// The file that differs.
        name: &'static str,
        /// A folder of the seed.
        first: PathBuf,
        /// Another one.
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

/// Numbers as text, the long tail left off.
#[must_use]
pub fn list(numbers: &[u64]) -> String {
    const SHOWN: usize = 12;
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(ToString::to_string).collect();
    let rest = numbers.len().saturating_sub(SHOWN);
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("{}{more}", shown.join(", "))
}
