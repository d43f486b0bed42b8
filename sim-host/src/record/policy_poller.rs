//! Polls a controller in another process for the policies that it runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use leg_control::serial::message::RunTick;
use leg_host::cli::target::open_process;
use leg_host::serial::Client;
use leg_host::status::{Crc32, PolicyName, Status, SwapRecord};
use leg_process::Stop;

use super::recorder::RecordSink;
use super::schema::Policy;

/// Time between two requests.
const INTERVAL: Duration = Duration::from_millis(200);
/// Time between two requests until the first is answered: a run may be short.
const FIRST_INTERVAL: Duration = Duration::from_millis(10);
/// Time between two checks whether the thread is to end.
const END_CHECK_INTERVAL: Duration = Duration::from_millis(10);

/// A thread that polls the controller until this value is dropped, a last time
/// then. If the controller does not answer, as one behind a bridge, the
/// recording has no policy; that is no error.
#[derive(Debug)]
pub struct PolicyPoller {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PolicyPoller {
    /// Starts to poll the controller in `domain` about the run `run_id`.
    #[must_use]
    pub fn begin(domain: &str, run_id: u32, sink: RecordSink) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let (ends, domain) = (Arc::clone(&end), domain.to_owned());
        let poll = move || {
            let mut log = PolicyLog::new(run_id);
            loop {
                let last = ends.load(Ordering::Relaxed);
                let answer = request(&domain, &log);
                if let Some(Answer::Policies(policies)) = &answer {
                    log.update(policies).into_iter().for_each(|policy| sink.policy(policy));
                }
                if last || matches!(answer, Some(Answer::Board)) {
                    break;
                }
                let mut left = if log.began { INTERVAL } else { FIRST_INTERVAL };
                while !left.is_zero() && !ends.load(Ordering::Relaxed) {
                    std::thread::sleep(END_CHECK_INTERVAL);
                    left = left.saturating_sub(END_CHECK_INTERVAL);
                }
            }
        };
        let thread = std::thread::Builder::new().name("policies".to_owned()).spawn(poll).ok();
        Self { end, thread }
    }
}

impl Drop for PolicyPoller {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A policy with its blob.
#[derive(Clone, Debug)]
struct PolicyBytes {
    policy: PolicyName,
    blob: Vec<u8>,
}

/// The policies of the controller process.
#[derive(Debug)]
struct Policies {
    running: PolicyBytes,
    swaps: Vec<SwapRecord>,
}

/// What the controller answers.
#[derive(Debug)]
enum Answer {
    Policies(Policies),
    /// It is a board behind a bridge, and cannot send its policy.
    Board,
}

/// Requests the policies; the blob only if it is not in the log. `None` if the controller does
/// not answer.
fn request(domain: &str, log: &PolicyLog) -> Option<Answer> {
    let mut client = Client::new(open_process(domain).ok()?, &Stop::default());
    let Some(report) = client.report().ok()? else { return Some(Answer::Board) };
    let status: Status = serde_json::from_slice(&report).ok()?;
    let crc32 = status.policy.crc32;
    let known = log.blobs.iter().find(|known| known.policy.crc32 == crc32);
    let blob = match known {
        Some(known) => known.blob.clone(),
        None => client.read_policy(crc32.0).ok()??,
    };
    let running = PolicyBytes { policy: status.policy, blob };
    Some(Answer::Policies(Policies { running, swaps: status.swap_log }))
}

/// The policies of a run that have been recorded.
#[derive(Debug)]
struct PolicyLog {
    run_id: u32,
    began: bool,
    /// Number of the last swap that is recorded, or lies before the run.
    last_swap: u64,
    /// Every policy seen so far.
    blobs: Vec<PolicyBytes>,
}

impl PolicyLog {
    fn new(run_id: u32) -> Self {
        Self { run_id, began: false, last_swap: 0, blobs: Vec::new() }
    }

    /// Returns the policies that are new in an answer.
    fn update(&mut self, Policies { running, swaps }: &Policies) -> Vec<Policy> {
        if !self.blobs.iter().any(|known| known.policy.crc32 == running.policy.crc32) {
            self.blobs.push(running.clone());
        }
        let mut new = Vec::new();
        let of_this_run = |swap: &&SwapRecord| swap.at.is_some_and(|at| at.run_id == self.run_id);
        if !self.began {
            self.began = true;
            // If the first policy has been swapped already, its bytes cannot be obtained.
            if swaps.iter().find(of_this_run).is_none() {
                new.push(self.policy(running.policy.crc32, 0));
            }
        }
        let ours: Vec<_> = swaps.iter().filter(of_this_run).copied().collect();
        let in_force =
            ours.iter().filter(|s| s.crc32 == running.policy.crc32).map(|s| s.number).max();
        for SwapRecord { number, crc32, at } in ours {
            let Some(RunTick { seq, .. }) = at else { continue };
            // A pending policy is recorded once it runs, because its bytes are seen only then.
            if number > self.last_swap && in_force >= Some(number) {
                self.last_swap = number;
                new.push(self.policy(crc32, seq));
            }
        }
        new
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
        let at = at.map(|(run_id, seq)| RunTick { run_id, seq });
        SwapRecord { number, crc32: Crc32(crc32), at }
    }

    #[test]
    fn returns_each_policy_of_the_run_once_with_its_tick() {
        let mut log = PolicyLog::new(4);
        let summary = |policies: Vec<Policy>| -> Vec<(u32, u64, usize)> {
            policies.iter().map(|p| (p.crc32, p.seq, p.blob.len())).collect()
        };
        let mut poll = |running: u32, swaps: &[SwapRecord]| {
            summary(log.update(&Policies { running: bytes(running), swaps: swaps.to_vec() }))
        };
        let before = swap(1, 7, Some((3, 99)));
        assert_eq!(poll(7, &[before]), [(7, 0, 1)]);
        assert_eq!(poll(7, &[before]), []);
        // Requested, then accepted, then in force.
        assert_eq!(poll(7, &[before, swap(2, 8, None)]), []);
        let second = swap(2, 8, Some((4, 50)));
        assert_eq!(poll(7, &[before, second]), []);
        assert_eq!(poll(8, &[before, second]), [(8, 50, 1)]);
        assert_eq!(poll(8, &[before, second]), []);
        // A policy that came and went between two polls: its bytes are unknown.
        let (third, fourth) = (swap(3, 9, Some((4, 60))), swap(4, 7, Some((4, 70))));
        assert_eq!(poll(7, &[second, third, fourth]), [(9, 60, 0), (7, 70, 1)]);
    }
}
