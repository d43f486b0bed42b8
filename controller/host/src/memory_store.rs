//! The policy store of a controller process: two slots in memory.

use std::collections::HashMap;

use leg_control::policy::Policy;
use leg_control::serial::error::{BlobError, SlotError};
use leg_control::serial::message::Slot;
use leg_control::serial::store::{PolicyStore, StoreError};
use leg_process::policy_file::{AlignedBytes, MAX_BYTES};

use super::policy_cache::{self, CachedPolicy};
use super::status::{Crc32, PolicyName};

/// A policy in a slot.
#[derive(Clone, Copy, Debug)]
struct Kept {
    policy: &'static CachedPolicy,
    sequence: u32,
    is_revoked: bool,
}

/// Two slots in memory. Their policies stay in the process's cache, so a policy
/// that waits for its apex may be replaced.
#[derive(Debug)]
pub(super) struct MemoryStore {
    slots: [Option<Kept>; 2],
    upload: Vec<u8>,
    upload_origin: String,
    /// Where the policies came from, by checksum.
    origins: HashMap<u32, String>,
}

impl MemoryStore {
    /// Makes a store with this policy, from `origin`, in slot A.
    pub(super) fn new(policy: &'static CachedPolicy, origin: &str) -> Self {
        let kept = Kept { policy, sequence: 0, is_revoked: false };
        let origins = HashMap::from([(policy.policy().crc32(), origin.to_owned())]);
        Self {
            slots: [Some(kept), None],
            upload: Vec::new(),
            upload_origin: String::new(),
            origins,
        }
    }

    /// Describes the policy with this checksum.
    pub(super) fn describe(&self, crc32: u32) -> PolicyName {
        let file = self.origins.get(&crc32).cloned().unwrap_or_default();
        let Some(cached) = policy_cache::find(crc32) else {
            let (name, provenance) = (String::new(), String::new());
            return PolicyName { name, crc32: Crc32(crc32), file, provenance };
        };
        let manifest = cached.policy().manifest();
        let from = &manifest.provenance;
        let provenance = format!(
            "preset {}, seed {}, {} steps, trainer {}",
            from.preset, from.seed, from.steps, from.trainer_version
        );
        PolicyName { name: manifest.name.to_owned(), crc32: Crc32(crc32), file, provenance }
    }
}

impl PolicyStore for MemoryStore {
    const BEGIN_STALLS: bool = false;
    const OVERWRITES: bool = false;

    fn capacity(&self) -> usize {
        MAX_BYTES as usize
    }

    fn sequence(&self, slot: Slot) -> u32 {
        self.slots[slot as usize].map_or(0, |kept| kept.sequence)
    }

    fn policy<R>(&self, slot: Slot, f: impl FnOnce(&Policy<'static>) -> R) -> Result<R, SlotError> {
        match self.slots[slot as usize] {
            None => Err(SlotError::Empty),
            Some(kept) if kept.is_revoked => Err(SlotError::RolledBack),
            Some(kept) => Ok(f(kept.policy.policy())),
        }
    }

    fn blob(&self, crc32: u32) -> Option<&[u8]> {
        policy_cache::find(crc32).map(CachedPolicy::blob)
    }

    fn begin(&mut self, _slot: Slot, length: usize, origin: &str) -> Result<(), StoreError> {
        self.upload = vec![0; length];
        origin.clone_into(&mut self.upload_origin);
        Ok(())
    }

    fn write(&mut self, _slot: Slot, offset: u32, bytes: &[u8]) -> Result<(), StoreError> {
        let part = self.upload.get_mut(offset as usize..).unwrap_or_default();
        part.get_mut(..bytes.len()).ok_or(StoreError)?.copy_from_slice(bytes);
        Ok(())
    }

    fn check(&self, _slot: Slot, length: usize) -> Result<u32, BlobError> {
        let blob = AlignedBytes::from(self.upload.get(..length).unwrap_or_default());
        Ok(Policy::parse(blob.as_slice())?.crc32())
    }

    fn commit(&mut self, slot: Slot, length: u32, crc32: u32) -> Result<(), StoreError> {
        let blob = self.upload.get(..length as usize).ok_or(StoreError)?;
        let policy = policy_cache::intern(blob).map_err(|_| StoreError)?;
        let sequence = self.sequence(slot.other()).max(self.sequence(slot)) + 1;
        self.slots[slot as usize] = Some(Kept { policy, sequence, is_revoked: false });
        self.origins.insert(crc32, std::mem::take(&mut self.upload_origin));
        self.upload = Vec::new();
        Ok(())
    }

    fn revoke(&mut self, slot: Slot) -> Result<(), StoreError> {
        if let Some(kept) = &mut self.slots[slot as usize] {
            kept.is_revoked = true;
        }
        Ok(())
    }
}
