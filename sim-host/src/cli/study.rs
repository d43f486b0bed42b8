//! The options that the commands have in common which play many seeded runs.

use std::path::PathBuf;

use leg_process::policy_file::PolicyFile;

use super::{checked_policy, misuse};
use crate::robustness::Media;

const MOST_RUNS: u64 = 100_000;
const MOST_JOBS: usize = 1_024;

/// The options.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub(super) struct StudyArgs {
    /// Policy file [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Runs of each row of the result, each from another start.
    #[arg(long, value_name = "N", default_value_t = 20, allow_negative_numbers = true)]
    runs: u64,
    /// Threads [default: one per core]; the result is the same for any number.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    jobs: Option<usize>,
    /// Media in which the leg hops.
    #[arg(long, value_name = "MEDIA", value_delimiter = ',', default_value = "water,shore,land")]
    media: Vec<Media>,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
}

/// What to play, checked.
#[derive(Debug)]
pub(super) struct Study {
    pub(super) policy: PolicyFile,
    /// Runs of each row.
    pub(super) runs: u64,
    /// Media, each once.
    pub(super) media: Vec<Media>,
    /// The threads that play.
    pub(super) pool: rayon::ThreadPool,
}

impl StudyArgs {
    /// Checks the options and reads the policy.
    pub(super) fn study(&self) -> anyhow::Result<Study> {
        if !(1..=MOST_RUNS).contains(&self.runs) {
            let runs = self.runs;
            return Err(misuse(format!("--runs is {runs}; it must be from 1 to {MOST_RUNS}")));
        }
        if let Some(jobs) = self.jobs.filter(|jobs| !(1..=MOST_JOBS).contains(jobs)) {
            return Err(misuse(format!("--jobs is {jobs}; it must be from 1 to {MOST_JOBS}")));
        }
        let mut media: Vec<Media> = Vec::new();
        for &one in &self.media {
            if !media.contains(&one) {
                media.push(one);
            }
        }
        let threads = self.jobs.unwrap_or(0);
        Ok(Study {
            policy: checked_policy(self.policy.as_deref())?,
            runs: self.runs,
            media,
            pool: rayon::ThreadPoolBuilder::new().num_threads(threads).build()?,
        })
    }
}
