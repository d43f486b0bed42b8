//! Merging the folders of shards.

use super::StudyError;
use super::folder::{Folder, LEARNING, POLICY, REPORT, SeedReport};
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The result of a merge.
#[derive(Debug)]
pub struct Merged {
    /// Folder with all seeds.
    pub folder: Folder,
    /// Seeds that were in more than one folder, with the same results.
    pub duplicates: Vec<u64>,
}

/// Merges `folders`, at least one, into `out`, which may be one of them. Writes nothing unless
/// all of the study's seeds are there.
///
/// # Errors
/// [`StudyError`] for folders of different studies, missing seeds, results that differ between
/// folders, and files that cannot be read or written.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Merged, StudyError> {
    let opened: Vec<Folder> = folders.iter().map(|f| Folder::open(f)).collect::<Result<_, _>>()?;
    let Some(plan) = opened.first().map(|folder| folder.plan().clone()) else {
        return Err(StudyError::content(out, &"nothing to join"));
    };
    let mut sources: BTreeMap<u64, &Folder> = BTreeMap::new();
    let mut duplicates = Vec::new();
    for (folder, path) in opened.iter().zip(folders) {
        // Fails unless the folder holds the same plan.
        Folder::begin(path, plan.clone())?;
        for report in folder.reports()?.0 {
            let seed = report.seed;
            match sources.get(&seed) {
                None => _ = sources.insert(seed, folder),
                Some(first) if same_place(first.path(), path) => {}
                Some(first) => {
                    agree(seed, first, folder)?;
                    duplicates.push(seed);
                }
            }
        }
    }
    let missing: Vec<u64> = plan.seeds.iter().filter(|s| !sources.contains_key(s)).collect();
    if !missing.is_empty() {
        return Err(StudyError::Missing { all: plan.seeds.count(), seeds: missing });
    }
    let folder = Folder::begin(out, plan)?;
    for (&seed, source) in &sources {
        if same_place(source.path(), out) {
            continue;
        }
        let busy = || StudyError::Busy { seed, folder: out.to_owned() };
        let claim = folder.claim(seed)?.ok_or_else(busy)?;
        // The report is written last, as in a training.
        for name in [LEARNING, POLICY, REPORT] {
            if let Some(content) = content(&source.seed(seed).join(name))? {
                claim.write(name, &content)?;
            }
        }
    }
    duplicates.sort_unstable();
    duplicates.dedup();
    Ok(Merged { folder, duplicates })
}

fn same_place(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Checks that two folders have the same results of a seed: reports of the same content, as
/// an older trainer names some keys otherwise, and the other files byte for byte.
fn agree(seed: u64, first: &Folder, second: &Folder) -> Result<(), StudyError> {
    let result = |folder: &Folder| {
        let report = folder.report(seed)?;
        Ok::<_, StudyError>(report.map(|report| SeedReport { evaluation: None, ..report }))
    };
    let differs = |name| {
        let [first, second] = [first, second].map(|folder| folder.path().to_owned());
        Err(StudyError::Contradiction { seed, name, first, second })
    };
    if result(first)? != result(second)? {
        return differs(REPORT);
    }
    for name in [POLICY, LEARNING] {
        let of = |folder: &Folder| content(&folder.seed(seed).join(name));
        if of(first)? != of(second)? {
            return differs(name);
        }
    }
    Ok(())
}

fn content(file: &Path) -> Result<Option<Vec<u8>>, StudyError> {
    match fs::read(file) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StudyError::file(file)(e)),
    }
}
