//! What figures are made with: parts kept on disk, agents, the authors' data.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use indicatif::ProgressBar;
use leg_process::atomic_file;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::picture::DrawError;
use super::reference::Reference;

/// Raised when the code that makes parts changes what they come to.
const PARTS_VERSION: u32 = 1;
/// The bar counts in milliseconds of work.
const UNITS_PER_S: f64 = 1e3;

/// How much is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Extent {
    /// What the claims are judged by.
    Full,
    /// A minute's worth: every figure, coarser and from fewer seeds.
    Quick,
}

impl Extent {
    /// The one or the other.
    pub fn of<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// Why a figure could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FiguresError {
    /// A part cannot be kept.
    #[error("cannot write {}: {cause}; name another folder with --out", path.display())]
    Write {
        /// Its file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The authors' data is there, but is not what it should be.
    #[error("{}: {cause}", path.display())]
    Reference {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        cause: String,
    },
    /// A training went to infinity.
    #[error("{agent}, seed {seed}: {cause}")]
    Training {
        /// Which agent.
        agent: &'static str,
        /// Its seed.
        seed: u64,
        /// What happened.
        cause: String,
    },
    /// The picture cannot be laid out.
    #[error("the picture cannot be laid out: {0}")]
    Draw(#[from] DrawError),
}

/// Where figures are made.
pub struct Workshop {
    /// How much is computed.
    pub extent: Extent,
    /// The authors' data, where it is at hand.
    pub reference: Option<Reference>,
    parts: PathBuf,
    bar: ProgressBar,
    /// Work done, s.
    spent: Mutex<f64>,
    /// Which policies were used, by what they are called.
    policies: Mutex<BTreeMap<String, String>>,
}

impl Workshop {
    /// A workshop that keeps its parts in a folder and counts its work on a bar.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(
        extent: Extent,
        reference: Option<Reference>,
        parts: &Path,
        bar: ProgressBar,
    ) -> Result<Self, FiguresError> {
        let parts = parts.to_owned();
        fs::create_dir_all(&parts)
            .map_err(|cause| FiguresError::Write { path: parts.clone(), cause })?;
        let (spent, policies) = (Mutex::default(), Mutex::default());
        Ok(Self { extent, reference, parts, bar, spent, policies })
    }

    /// A part of a figure: made once, then read from disk for as long as it is
    /// made from the same `inputs`. `name` is that of its file; `cost_s`, what
    /// making it takes, moves the bar.
    ///
    /// # Errors
    /// [`FiguresError::Write`].
    pub fn part<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        inputs: &impl Serialize,
        cost_s: f64,
        make: impl FnOnce() -> Result<T, FiguresError>,
    ) -> Result<T, FiguresError> {
        let inputs = postcard::to_stdvec(&(PARTS_VERSION, name, inputs)).expect("a form in memory");
        let path = self.parts.join(format!("{name}-{:016x}.part", fnv1a(&inputs)));
        // What cannot be read, being cut or of another build, is made anew.
        let kept = fs::read(&path).ok().and_then(|bytes| postcard::from_bytes(&bytes).ok());
        let part = if let Some(part) = kept {
            part
        } else {
            let part = make()?;
            let bytes = postcard::to_stdvec(&part).expect("a form in memory");
            atomic_file::write(&path, &bytes)
                .map_err(|cause| FiguresError::Write { path, cause })?;
            part
        };
        self.advance(cost_s);
        Ok(part)
    }

    /// Says that a policy was used, and where it comes from.
    pub fn used(&self, name: &str, from: String) {
        locked(&self.policies).insert(name.to_owned(), from);
    }

    /// Every policy that was used, with where it comes from.
    #[must_use]
    pub fn policies(&self) -> Vec<(String, String)> {
        locked(&self.policies).clone().into_iter().collect()
    }

    /// Says that this much of the work is behind us, s.
    fn advance(&self, cost_s: f64) {
        let mut spent = locked(&self.spent);
        *spent += cost_s;
        self.bar.set_position((*spent * UNITS_PER_S) as u64);
    }

    /// Says that all of a figure is behind us, when those before it took
    /// `until_s` with it.
    pub fn reached(&self, until_s: f64) {
        let mut spent = locked(&self.spent);
        *spent = until_s;
        self.bar.set_position((*spent * UNITS_PER_S) as u64);
    }

    /// Length of the bar for this much work, s.
    #[must_use]
    pub fn units(cost_s: f64) -> u64 {
        (cost_s * UNITS_PER_S) as u64
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// FNV-1a, 64 bits: names, not secrets.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shop(folder: &Path) -> Workshop {
        Workshop::open(Extent::Quick, None, folder, ProgressBar::hidden()).unwrap()
    }

    #[test]
    fn a_part_is_made_once_for_the_same_inputs_and_anew_for_others() {
        let folder = tempfile::tempdir().unwrap();
        let made = std::cell::Cell::new(0);
        let part = |seed: u64| {
            let make = || {
                made.set(made.get() + 1);
                Ok(vec![seed as f64, f64::NAN])
            };
            shop(folder.path()).part("curve", &seed, 1.0, make).unwrap()
        };
        assert_eq!(part(7)[0], 7.0);
        assert_eq!(part(7)[0], 7.0);
        assert_eq!(made.get(), 1);
        assert_eq!(part(8)[0], 8.0);
        assert_eq!(made.get(), 2);

        // Cut short by a full disk, or by hand.
        for entry in fs::read_dir(folder.path()).unwrap() {
            fs::write(entry.unwrap().path(), [9]).unwrap();
        }
        assert_eq!(part(7)[0], 7.0);
        assert_eq!(made.get(), 3);
    }
}
