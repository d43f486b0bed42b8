//! The authors' published data (doi 10.5281/zenodo.4607469).

use std::path::{Path, PathBuf};

use super::FiguresError;
use super::agents::Episode;
use trainer::bridge::json;
use trainer::policy::PackedActor;

/// A folder with the authors' data.
#[derive(Clone, Debug)]
pub struct Reference(PathBuf);

impl Reference {
    /// Returns the data in a folder, or `None` if the folder does not exist.
    #[must_use]
    pub fn at(folder: &Path) -> Option<Self> {
        folder.is_dir().then(|| Self(folder.to_owned()))
    }

    /// Reads the learning curve of the agent `air` or `water_to_air`: one training each.
    ///
    /// # Errors
    /// [`FiguresError::Reference`] if the file is missing or damaged.
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

    /// Reads the actor `air`, `water` or `water_to_air`.
    ///
    /// # Errors
    /// [`FiguresError::Reference`] if the file is missing or damaged.
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
