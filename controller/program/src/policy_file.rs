//! A policy file in memory, where its weights can be read in place.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use leg_control::policy::{self, ParseError, Policy};

/// A blob has at most four layers 128 wide: a file beyond this is something else.
pub const MAX_BYTES: u64 = 1 << 20;

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

/// Bytes at a 4-byte aligned address, as [`Policy::parse`] wants them.
#[derive(Clone, Debug)]
pub struct AlignedBytes {
    words: Vec<u32>,
    len: usize,
}

impl AlignedBytes {
    /// So many zeros, to be written to.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        Self { words: vec![0; len.div_ceil(4)], len }
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }

    /// The bytes, to be written to.
    pub fn as_mut_slice(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.len]
    }

    /// The bytes, for the life of the process.
    #[must_use]
    pub fn leak(self) -> &'static [u8] {
        &bytemuck::cast_slice(self.words.leak())[..self.len]
    }

    /// Only the first bytes, if there are more.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }
}

impl From<&[u8]> for AlignedBytes {
    fn from(bytes: &[u8]) -> Self {
        let mut aligned = Self::zeros(bytes.len());
        aligned.as_mut_slice().copy_from_slice(bytes);
        aligned
    }
}

/// A policy file in memory.
#[derive(Clone, Debug)]
pub struct PolicyBlob {
    path: PathBuf,
    bytes: AlignedBytes,
}

impl PolicyBlob {
    /// The given file or, without one, the policy shipped with the program;
    /// nothing is checked yet.
    ///
    /// # Errors
    /// [`BlobError::Read`].
    pub fn load(path: Option<&Path>) -> Result<Self, BlobError> {
        let shipped = || Self { path: "the shipped policy".into(), bytes: policy::SHIPPED.into() };
        path.map_or_else(|| Ok(shipped()), Self::read)
    }

    /// Reads a file; nothing is checked yet.
    ///
    /// # Errors
    /// [`BlobError::Read`].
    pub fn read(path: &Path) -> Result<Self, BlobError> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|cause| BlobError::Read { path: path.to_owned(), cause })?;
        Ok(Self { path: path.to_owned(), bytes: bytes.as_slice().into() })
    }

    /// The policy in it, every check passed.
    ///
    /// # Errors
    /// [`BlobError::Parse`].
    pub fn policy(&self) -> Result<Policy<'_>, BlobError> {
        Policy::parse(self.as_slice())
            .map_err(|cause| BlobError::Parse { path: self.path.clone(), cause })
    }

    /// Its file; words in its place for the shipped policy.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.as_slice()
    }
}
