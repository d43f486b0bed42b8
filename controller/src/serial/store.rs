//! Where a node keeps its policies: two slots, in flash or in memory.

use core::error::Error;
use core::fmt;

use super::error::{BlobError, SlotError};
use super::message::Slot;
use crate::policy::{ParseError, Policy};

/// The store did not keep what was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreError;

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the policy store does not keep what is written")
    }
}

impl Error for StoreError {}

/// Two slots for policies. [`super::handler::RequestHandler`] writes to one of
/// them while the node runs the policy in the other.
pub trait PolicyStore {
    /// Returns the most bytes of a blob.
    fn capacity(&self) -> usize;

    /// Whether the processor stalls, ticks included, while [`begin`](Self::begin)
    /// makes room.
    const BEGIN_STALLS: bool;

    /// Whether a policy that waits for its apex must not be replaced, because
    /// its bytes would be overwritten.
    const OVERWRITES: bool;

    /// Returns the sequence number of a slot's policy: a higher one is newer.
    fn sequence(&self, slot: Slot) -> u32;

    /// Calls `f` with the policy in a slot, once it has passed every check. It
    /// passes a reference because a returned policy would lie on a target's
    /// stack twice.
    ///
    /// # Errors
    /// [`SlotError`] when the slot holds no policy that could run.
    fn policy<R>(&self, slot: Slot, f: impl FnOnce(&Policy<'static>) -> R) -> Result<R, SlotError>;

    /// Returns the blob with this checksum, if the store can be read from.
    fn blob(&self, _crc32: u32) -> Option<&[u8]> {
        None
    }

    /// Makes room in a slot for a blob.
    ///
    /// # Errors
    /// [`StoreError`] when it fails.
    fn begin(&mut self, slot: Slot, length: usize, origin: &str) -> Result<(), StoreError>;

    /// Writes a part of the blob at `offset` bytes, a multiple of 4.
    ///
    /// # Errors
    /// [`StoreError`] when it fails, or when the blob has no such part.
    fn write(&mut self, slot: Slot, offset: u32, bytes: &[u8]) -> Result<(), StoreError>;

    /// Checks a blob that is written and not committed; returns its checksum.
    ///
    /// # Errors
    /// [`BlobError`] when it fails a check.
    fn check(&self, slot: Slot, length: usize) -> Result<u32, BlobError>;

    /// Commits the blob, which becomes the newest one.
    ///
    /// # Errors
    /// [`StoreError`] when it fails.
    fn commit(&mut self, slot: Slot, length: u32, crc32: u32) -> Result<(), StoreError>;

    /// Revokes the policy in a slot: it is never chosen again.
    ///
    /// # Errors
    /// [`StoreError`] when it fails.
    fn revoke(&mut self, slot: Slot) -> Result<(), StoreError>;

    /// Returns the newest slot, A if both are as old: its policy is the one to
    /// run after power-up, if it passes every check.
    fn newest(&self) -> Slot {
        let [a, b] = Slot::ALL.map(|slot| self.sequence(slot));
        if b > a { Slot::B } else { Slot::A }
    }
}

/// Converts a parse error; once in an image.
#[inline(never)]
fn blob_error(error: &ParseError) -> BlobError {
    (*error).into()
}

/// Parses a blob and returns its checksum.
///
/// # Errors
/// [`BlobError`] when it fails a check.
#[inline(never)]
pub(super) fn check(blob: &[u8]) -> Result<u32, BlobError> {
    match &Policy::parse(blob) {
        Ok(policy) => Ok(policy.crc32()),
        Err(error) => Err(blob_error(error)),
    }
}

/// Parses a blob and calls `f` with the policy, unless its checksum is not the
/// one in the seal.
pub(super) fn with_policy<R>(
    blob: &'static [u8],
    sealed: Option<u32>,
    f: impl FnOnce(&Policy<'static>) -> R,
) -> Result<R, SlotError> {
    match &Policy::parse(blob) {
        Ok(policy) if sealed.is_some_and(|crc32| crc32 != policy.crc32()) => {
            Err(SlotError::BadSeal)
        }
        Ok(policy) => Ok(f(policy)),
        Err(error) => Err(SlotError::Blob(blob_error(error))),
    }
}
