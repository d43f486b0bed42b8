//! Policy files in memory, aligned so that the weights can be read in place.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use leg_control::actor::MAX_WEIGHTS;
use leg_control::policy::{self, ParseError, Policy};

/// Largest policy file, bytes: 1 MiB of weights, and 64 KiB for all else.
pub const MAX_BYTES: u64 = 4 * MAX_WEIGHTS as u64 + (1 << 16);

/// A policy file could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyFileError {
    /// The file cannot be read.
    #[error("cannot read the policy {}: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        cause: io::Error,
    },
    /// The file is not a valid policy blob.
    #[error("{} is not a valid policy: {cause}", path.display())]
    Parse {
        /// Path of the file.
        path: PathBuf,
        /// The check that failed.
        cause: ParseError,
    },
}

/// Bytes at a 4-byte aligned address, as [`Policy::parse`] requires.
#[derive(Clone, Debug)]
pub struct AlignedBytes {
    words: Vec<u32>,
    len: usize,
}

impl AlignedBytes {
    /// Creates a buffer of `len` zero bytes.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        Self { words: vec![0; len.div_ceil(4)], len }
    }

    /// Returns the bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }

    /// Returns the bytes for writing.
    pub fn as_mut_slice(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.len]
    }

    /// Leaks the buffer and returns its bytes.
    #[must_use]
    pub fn leak(self) -> &'static [u8] {
        &bytemuck::cast_slice(self.words.leak())[..self.len]
    }

    /// Shortens the buffer to at most `len` bytes.
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

/// A policy file in memory, with its path for messages.
#[derive(Clone, Debug)]
pub struct PolicyFile {
    path: PathBuf,
    bytes: AlignedBytes,
}

impl PolicyFile {
    /// Reads the file at `path` or, without a path, returns the policy that is
    /// compiled in. The content is not checked; see [`PolicyFile::policy`].
    ///
    /// # Errors
    /// Returns [`PolicyFileError::Read`] when the file cannot be read.
    pub fn load(path: Option<&Path>) -> Result<Self, PolicyFileError> {
        let shipped = || Self { path: "the shipped policy".into(), bytes: policy::SHIPPED.into() };
        path.map_or_else(|| Ok(shipped()), Self::read)
    }

    /// Reads the file at `path`. The content is not checked; see
    /// [`PolicyFile::policy`].
    ///
    /// # Errors
    /// Returns [`PolicyFileError::Read`] when the file cannot be read.
    pub fn read(path: &Path) -> Result<Self, PolicyFileError> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|cause| PolicyFileError::Read { path: path.to_owned(), cause })?;
        Ok(Self { path: path.to_owned(), bytes: bytes.as_slice().into() })
    }

    /// Parses and checks the policy.
    ///
    /// # Errors
    /// Returns [`PolicyFileError::Parse`] with the check that failed.
    pub fn policy(&self) -> Result<Policy<'_>, PolicyFileError> {
        Policy::parse(self.as_slice())
            .map_err(|cause| PolicyFileError::Parse { path: self.path.clone(), cause })
    }

    /// Returns the path, or a description for the compiled-in policy.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the bytes of the file.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.as_slice()
    }
}
