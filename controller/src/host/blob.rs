//! A policy file in memory, where its weights can be read in place.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::policy::{ParseError, Policy};

/// A blob has at most four layers 128 wide: a file beyond this is something else.
const MAX_BYTES: u64 = 1 << 20;

/// Why a file is no policy to run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BlobError {
    /// It cannot be read.
    #[error("cannot read the policy {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// It fails a check.
    #[error("{} is not a policy to run: {cause}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Which.
        cause: ParseError,
    },
}

/// The bytes of a policy file, aligned as [`Policy::parse`] wants them.
#[derive(Debug)]
pub struct PolicyBlob {
    path: PathBuf,
    words: Vec<u32>,
    len: usize,
}

impl PolicyBlob {
    /// Reads a file; nothing is checked yet.
    ///
    /// # Errors
    /// [`BlobError::Read`].
    pub fn read(path: &Path) -> Result<Self, BlobError> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|cause| BlobError::Read { path: path.to_owned(), cause })?;
        let mut words = vec![0_u32; bytes.len().div_ceil(4)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(&bytes);
        Ok(Self { path: path.to_owned(), words, len: bytes.len() })
    }

    /// The policy in it, every check passed.
    ///
    /// # Errors
    /// [`BlobError::Parse`].
    pub fn policy(&self) -> Result<Policy<'_>, BlobError> {
        let bytes = &bytemuck::cast_slice(&self.words)[..self.len];
        Policy::parse(bytes).map_err(|cause| BlobError::Parse { path: self.path.clone(), cause })
    }
}
