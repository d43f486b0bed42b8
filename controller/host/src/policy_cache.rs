//! Policies that stay in memory for the life of the process.
//!
//! A policy lies over its bytes, and a controller that runs it may be swapped
//! to another and back at any time: so the bytes stay. Each different blob is
//! kept once, however often it comes.

use std::sync::{Mutex, PoisonError};

use leg_control::policy::{ParseError, Policy};
use leg_process::policy_file::{AlignedBytes, MAX_BYTES};

/// Different blobs that a process keeps: 256 MiB at the very most.
pub const MAX_POLICIES: usize = 256;

/// A policy that stays.
#[derive(Debug)]
pub struct CachedPolicy {
    blob: &'static [u8],
    policy: Policy<'static>,
}

/// Why a blob is not kept.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyCacheError {
    /// It is too long to be one.
    #[error("it is {0} bytes long, and a policy is at most {MAX_BYTES}")]
    TooLong(usize),
    /// It fails a check.
    #[error("{0}")]
    Parse(ParseError),
    /// There is no room for one more.
    #[error(
        "this process has kept {MAX_POLICIES} different policies, its limit; start it again to try more"
    )]
    Full,
}

static CACHE: Mutex<Vec<&'static CachedPolicy>> = Mutex::new(Vec::new());

/// Keeps a blob, once it has passed every check; the same again costs nothing.
///
/// # Errors
/// [`PolicyCacheError`]; a blob that is refused is not kept.
pub fn intern(bytes: &[u8]) -> Result<&'static CachedPolicy, PolicyCacheError> {
    let mut cache = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(there) = cache.iter().find(|there| there.blob == bytes) {
        return Ok(there);
    }
    if bytes.len() as u64 > MAX_BYTES {
        return Err(PolicyCacheError::TooLong(bytes.len()));
    }
    let aligned = AlignedBytes::from(bytes);
    Policy::parse(aligned.as_slice()).map_err(PolicyCacheError::Parse)?;
    if cache.len() >= MAX_POLICIES {
        return Err(PolicyCacheError::Full);
    }
    let blob = aligned.leak();
    let policy = Policy::parse(blob).map_err(PolicyCacheError::Parse)?;
    let cached: &'static CachedPolicy = Box::leak(Box::new(CachedPolicy { blob, policy }));
    cache.push(cached);
    Ok(cached)
}

/// Returns the policy with this checksum, if it was ever kept.
#[must_use]
pub fn find(crc32: u32) -> Option<&'static CachedPolicy> {
    let cache = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    cache.iter().find(|kept| kept.policy.crc32() == crc32).copied()
}

impl CachedPolicy {
    /// Returns its bytes.
    #[must_use]
    pub fn blob(&self) -> &'static [u8] {
        self.blob
    }

    /// Returns the policy in them.
    #[must_use]
    pub fn policy(&self) -> &Policy<'static> {
        &self.policy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::policy::SHIPPED;

    #[test]
    fn the_same_blob_is_kept_once_and_a_bad_one_never() {
        let one = intern(SHIPPED).unwrap();
        assert!(std::ptr::eq(one, intern(AlignedBytes::from(SHIPPED).as_slice()).unwrap()));
        assert_eq!(one.blob(), SHIPPED);
        let mut bad = SHIPPED.to_vec();
        bad[100] ^= 1;
        assert!(matches!(intern(&bad), Err(PolicyCacheError::Parse(ParseError::Crc { .. }))));
        let long = vec![0; MAX_BYTES as usize + 1];
        assert_eq!(intern(&long).unwrap_err(), PolicyCacheError::TooLong(long.len()));
    }
}
