//! What all figures share: the cache of computed steps, the authors' data, progress.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use indicatif::ProgressBar;
use leg_charts::DrawError;
use leg_process::atomic_file;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::reference::Reference;

/// Raise this if the code of a step changes its results.
const CACHE_VERSION: u32 = 1;
/// The progress bar counts milliseconds of work.
const UNITS_PER_S: f64 = 1e3;

/// How much is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Extent {
    /// Everything that the verdicts are based on.
    Full,
    /// About a minute: every figure, on coarser grids and from fewer seeds.
    Quick,
}

impl Extent {
    /// Returns the value for this extent.
    pub fn of<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// A figure could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FiguresError {
    /// A file of the cache cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A file of the authors' data is missing or damaged.
    #[error("{}: {cause}", path.display())]
    Reference {
        /// The file.
        path: PathBuf,
        /// The reason.
        cause: String,
    },
    /// A training diverged.
    #[error("training of {agent}, seed {seed}: {cause}")]
    Training {
        /// The agent's name.
        agent: &'static str,
        /// The seed.
        seed: u64,
        /// The reason.
        cause: String,
    },
    /// A chart cannot be laid out.
    #[error(transparent)]
    Draw(#[from] DrawError),
}

/// What figures are rendered with.
pub struct FigureContext {
    /// How much is computed.
    pub extent: Extent,
    /// The authors' data, if found.
    pub reference: Option<Reference>,
    cache: PathBuf,
    bar: ProgressBar,
    /// Work done, s.
    spent_s: Mutex<f64>,
    /// The policies that were used: name and origin.
    policies: Mutex<BTreeMap<String, String>>,
}

impl FigureContext {
    /// Opens a context that caches computed steps in a folder and reports progress on a
    /// bar.
    ///
    /// # Errors
    /// [`FiguresError::Write`] if the folder cannot be created.
    pub fn open(
        extent: Extent,
        reference: Option<Reference>,
        cache: &Path,
        bar: ProgressBar,
    ) -> Result<Self, FiguresError> {
        let cache = cache.to_owned();
        fs::create_dir_all(&cache)
            // A step that cannot be cached would be computed in vain.
            .and_then(|()| atomic_file::check(&cache.join("step.bin")))
            .map_err(|cause| FiguresError::Write { path: cache.clone(), cause })?;
        let (spent_s, policies) = (Mutex::default(), Mutex::default());
        Ok(Self { extent, reference, cache, bar, spent_s, policies })
    }

    /// Returns the result of a step: from the cache if it was computed before from the
    /// same `inputs`, else by computing it. `name` names its file; `cost_s`, the time that
    /// computing takes, advances the bar.
    ///
    /// # Errors
    /// [`FiguresError::Write`] if the result cannot be cached, and the errors of `compute`.
    pub fn cached<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        inputs: &impl Serialize,
        cost_s: f64,
        compute: impl FnOnce() -> Result<T, FiguresError>,
    ) -> Result<T, FiguresError> {
        let key = postcard::to_stdvec(&(CACHE_VERSION, name, inputs)).expect("writes to memory");
        let path = self.cache.join(format!("{name}-{:016x}.bin", fnv1a(&key)));
        // A file that cannot be read, cut short or of another build, is computed again.
        let found = fs::read(&path).ok().and_then(|bytes| postcard::from_bytes(&bytes).ok());
        let result = if let Some(result) = found {
            result
        } else {
            let result = compute()?;
            let bytes = postcard::to_stdvec(&result).expect("writes to memory");
            atomic_file::write(&path, &bytes)
                .map_err(|cause| FiguresError::Write { path, cause })?;
            result
        };
        self.set_spent(|spent_s| spent_s + cost_s);
        Ok(result)
    }

    /// Notes for the report that a policy was used, and its origin.
    pub fn note_policy(&self, name: &str, origin: String) {
        locked(&self.policies).insert(name.to_owned(), origin);
    }

    /// Returns every policy that was used: name and origin.
    #[must_use]
    pub fn policies(&self) -> Vec<(String, String)> {
        locked(&self.policies).clone().into_iter().collect()
    }

    /// Moves the bar to the end of a figure, at `until_s` of all work.
    pub fn finish_figure(&self, until_s: f64) {
        self.set_spent(|_| until_s);
    }

    fn set_spent(&self, update: impl FnOnce(f64) -> f64) {
        let mut spent_s = locked(&self.spent_s);
        *spent_s = update(*spent_s);
        self.bar.set_position(Self::units(*spent_s));
    }

    /// Converts an amount of work, s, to the bar's unit.
    #[must_use]
    pub fn units(cost_s: f64) -> u64 {
        (cost_s * UNITS_PER_S) as u64
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the FNV-1a hash, 64 bits: for file names, not for secrets.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn context(folder: &Path) -> FigureContext {
        FigureContext::open(Extent::Quick, None, folder, ProgressBar::hidden()).unwrap()
    }

    #[test]
    fn computes_a_step_once_for_the_same_inputs_and_again_if_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let computed = std::cell::Cell::new(0);
        let step = |seed: u64| {
            let compute = || {
                computed.set(computed.get() + 1);
                Ok(vec![seed as f64, f64::NAN])
            };
            context(folder.path()).cached("curve", &seed, 1.0, compute).unwrap()
        };
        assert_eq!(step(7)[0], 7.0);
        assert_eq!(step(7)[0], 7.0);
        assert_eq!(computed.get(), 1);
        assert_eq!(step(8)[0], 8.0);
        assert_eq!(computed.get(), 2);

        for entry in fs::read_dir(folder.path()).unwrap() {
            fs::write(entry.unwrap().path(), [9]).unwrap();
        }
        assert_eq!(step(7)[0], 7.0);
        assert_eq!(computed.get(), 3);
    }
}
