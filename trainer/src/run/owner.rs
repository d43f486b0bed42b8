//! The training that rows of a log belong to.

use super::checkpoint::{self, Checkpoint};
use super::log;
use super::paths::{folder_of, log_candidates, place};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the checkpoint of another training than that of `out` that continues the log
/// `path`, where one is beside either of them.
pub(super) fn other_checkpoint(path: &Path, out: &Path) -> Option<PathBuf> {
    let own = place(&checkpoint::path(out));
    let folders = [folder_of(path), folder_of(out)];
    let entries = folders.into_iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten();
    let is_checkpoint = |path: &PathBuf| path.extension() == Some(OsStr::new(checkpoint::ENDING));
    entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|other| is_checkpoint(other) && place(other) != own)
        .find(|other| continues(&other.with_extension(""), path))
}

/// Whether the checkpoint beside the policy file `out` continues the log `path`.
fn continues(out: &Path, path: &Path) -> bool {
    let Ok(Some(checkpoint)) = Checkpoint::read(out) else { return false };
    let is_named =
        || log_candidates(out, &checkpoint.log_path).iter().any(|c| place(c) == place(path));
    match log::holds(path, checkpoint.log) {
        Some(holds) if checkpoint.log.length > 0 => holds,
        // Before the first row only the name tells.
        _ => is_named(),
    }
}
