//! The authors' published data (doi 10.5281/zenodo.4607469), where it is at hand.

use std::path::{Path, PathBuf};

use super::FiguresError;
use trainer::bridge::json;
use trainer::policy::PackedActor;

/// A folder with the authors' data.
#[derive(Clone, Debug)]
pub struct Reference(PathBuf);

/// An episode of the authors' trainings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Episode {
    /// Sum of its rewards.
    pub reward: f64,
    /// Its steps, at most 5.
    pub steps: u32,
}

impl Reference {
    /// A folder, if it is there.
    #[must_use]
    pub fn at(folder: &Path) -> Option<Self> {
        folder.is_dir().then(|| Self(folder.to_owned()))
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.0
    }

    /// The learning curve of `air` or `water_to_air`: one run each.
    ///
    /// # Errors
    /// [`FiguresError::Reference`] when it is not what it should be.
    pub fn learning(&self, agent: &str) -> Result<Vec<Episode>, FiguresError> {
        let path = self.0.join(format!("learning_{agent}.csv"));
        let wrong = |cause: &dyn ToString| FiguresError::Reference {
            path: path.clone(),
            cause: cause.to_string(),
        };
        let mut rows = csv::Reader::from_path(&path).map_err(|e| wrong(&e))?;
        rows.deserialize::<(u64, f64, u32)>()
            .map(|row| row.map(|(_, reward, steps)| Episode { reward, steps }))
            .collect::<Result<_, _>>()
            .map_err(|e| wrong(&e))
    }

    /// The actor `air`, `water` or `water_to_air`.
    ///
    /// # Errors
    /// [`FiguresError::Reference`] when it is not what it should be.
    pub fn actor(&self, agent: &str) -> Result<PackedActor, FiguresError> {
        let path = self.0.join(format!("actor_{agent}.json"));
        let wrong = |cause: &dyn ToString| FiguresError::Reference {
            path: path.clone(),
            cause: cause.to_string(),
        };
        let text = std::fs::read_to_string(&path).map_err(|e| wrong(&e))?;
        json::from_json(&text).map_err(|e| wrong(&e))
    }
}
