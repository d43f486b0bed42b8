//! Which policies a controller in another process runs, asked of its desk.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use leg_host::Role;
use leg_host::desk;
use leg_host::desk::requests::{Crc32, Moment, Policies, PolicyBytes, Request, SwapRecord};

use super::recorder::Notes;
use super::schema::Policy;

/// Between two questions, and until the first is answered: a run may be short.
const EVERY: Duration = Duration::from_millis(200);
const FIRST: Duration = Duration::from_millis(10);
const LOOK: Duration = Duration::from_millis(10);
/// For an answer.
const PATIENCE: Duration = Duration::from_secs(1);

/// Asks now and then, from a thread of its own, until it is dropped; the last
/// time then. A controller that cannot be asked, as one behind a bridge, is no
/// error: then the recording has no policy.
#[derive(Debug)]
pub struct PolicyWatch {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PolicyWatch {
    /// Begins to ask the controller in `domain` about the run `run_id`.
    #[must_use]
    pub fn begin(domain: &str, run_id: u32, notes: Notes) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let (ends, domain) = (Arc::clone(&end), domain.to_owned());
        let ask = move || {
            let mut known = Known::new(run_id);
            loop {
                let last = ends.load(Ordering::Relaxed);
                if let Ok(policies) =
                    desk::ask(&domain, Role::Controller, &Request::Policy, PATIENCE)
                {
                    known.take(&policies).into_iter().for_each(|policy| notes.policy(policy));
                }
                if last {
                    break;
                }
                let mut left = if known.began { EVERY } else { FIRST };
                while !left.is_zero() && !ends.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                    left = left.saturating_sub(LOOK);
                }
            }
        };
        let thread = std::thread::Builder::new().name("policies".to_owned()).spawn(ask).ok();
        Self { end, thread }
    }
}

impl Drop for PolicyWatch {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What has been told of a run's policies.
#[derive(Debug)]
struct Known {
    run_id: u32,
    began: bool,
    /// The last swap that is told, or lies before the run.
    swap: u64,
    blobs: Vec<PolicyBytes>,
}

impl Known {
    fn new(run_id: u32) -> Self {
        Self { run_id, began: false, swap: 0, blobs: Vec::new() }
    }

    /// What is new in an answer.
    fn take(&mut self, Policies { running, swaps }: &Policies) -> Vec<Policy> {
        if !self.blobs.iter().any(|known| known.policy.crc32 == running.policy.crc32) {
            self.blobs.push(running.clone());
        }
        let mut told = Vec::new();
        let of_this_run = |swap: &&SwapRecord| swap.at.is_some_and(|at| at.run_id == self.run_id);
        if !self.began {
            self.began = true;
            // What it began with; when it has been swapped since, its bytes are gone.
            if swaps.iter().find(of_this_run).is_none() {
                told.push(self.policy(running.policy.crc32, 0));
            }
        }
        let ours: Vec<_> = swaps.iter().filter(of_this_run).copied().collect();
        let in_force =
            ours.iter().filter(|s| s.crc32 == running.policy.crc32).map(|s| s.number).max();
        for SwapRecord { number, crc32, at } in ours {
            let Some(Moment { seq, .. }) = at else { continue };
            // One that waits for its apex can be told only when its bytes are seen.
            if number > self.swap && in_force >= Some(number) {
                self.swap = number;
                told.push(self.policy(crc32, seq));
            }
        }
        told
    }

    fn policy(&self, crc32: Crc32, seq: u64) -> Policy {
        let bytes = self.blobs.iter().find(|known| known.policy.crc32 == crc32);
        Policy {
            name: bytes.map(|bytes| bytes.policy.name.clone()).unwrap_or_default(),
            crc32: crc32.0,
            blob: bytes.map(|bytes| bytes.blob.clone()).unwrap_or_default(),
            run_id: self.run_id,
            seq,
        }
    }
}

#[cfg(test)]
mod tests {
    use leg_host::desk::requests::PolicyName;

    use super::*;

    fn bytes(crc32: u32) -> PolicyBytes {
        let policy = PolicyName {
            name: format!("p{crc32}"),
            crc32: Crc32(crc32),
            file: String::new(),
            provenance: String::new(),
        };
        PolicyBytes { policy, blob: vec![crc32 as u8] }
    }

    fn swap(number: u64, crc32: u32, at: Option<(u32, u64)>) -> SwapRecord {
        let at = at.map(|(run_id, seq)| Moment { run_id, seq });
        SwapRecord { number, crc32: Crc32(crc32), at }
    }

    #[test]
    fn each_policy_of_the_run_is_told_once_with_its_tick() {
        let mut known = Known::new(4);
        let told = |policies: Vec<Policy>| -> Vec<(u32, u64, usize)> {
            policies.iter().map(|p| (p.crc32, p.seq, p.blob.len())).collect()
        };
        let mut answer = |running: u32, swaps: &[SwapRecord]| {
            told(known.take(&Policies { running: bytes(running), swaps: swaps.to_vec() }))
        };
        let before = swap(1, 7, Some((3, 99)));
        assert_eq!(answer(7, &[before]), [(7, 0, 1)]);
        assert_eq!(answer(7, &[before]), []);
        // Ordered, then answered under it, then in force.
        assert_eq!(answer(7, &[before, swap(2, 8, None)]), []);
        let second = swap(2, 8, Some((4, 50)));
        assert_eq!(answer(7, &[before, second]), []);
        assert_eq!(answer(8, &[before, second]), [(8, 50, 1)]);
        assert_eq!(answer(8, &[before, second]), []);
        // One came and went between two questions: its bytes are not known.
        let (third, fourth) = (swap(3, 9, Some((4, 60))), swap(4, 7, Some((4, 70))));
        assert_eq!(answer(7, &[second, third, fourth]), [(9, 60, 0), (7, 70, 1)]);
    }
}
