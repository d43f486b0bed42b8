//! Polls a controller in another process for what changes its commands beside the samples: the
//! policies that it runs, and set-points of requests.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use leg_control::serial::message::RunTick;
use leg_host::cli::target::open_process;
use leg_host::serial::Client;
use leg_host::status::{Crc32, SetPointRecord, Status};
use leg_process::Stop;
use leg_process::policy_file::AlignedBytes;

use super::recorder::RecordSink;
use super::schema::{Policy, SetPoint};

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
pub struct ChangePoller {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ChangePoller {
    /// Starts to poll the controller in `domain` about the run `run_id`, and the runs that follow
    /// it when a leg is put back to its start.
    #[must_use]
    pub fn begin(domain: &str, run_id: u32, sink: RecordSink) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let (ends, domain) = (Arc::clone(&end), domain.to_owned());
        let poll = move || {
            let mut changes = Changes::new(run_id);
            loop {
                let last = ends.load(Ordering::Relaxed);
                let answer = request(&domain, &mut changes);
                if let Some(Answer::Process(status)) = &answer {
                    for change in changes.update(status) {
                        match change {
                            Change::Policy(policy) => sink.policy(policy),
                            Change::SetPoint(set_point) => sink.set_point(set_point),
                        }
                    }
                }
                if last || matches!(answer, Some(Answer::Board)) {
                    break;
                }
                let mut left = if changes.began { INTERVAL } else { FIRST_INTERVAL };
                while !left.is_zero() && !ends.load(Ordering::Relaxed) {
                    std::thread::sleep(END_CHECK_INTERVAL);
                    left = left.saturating_sub(END_CHECK_INTERVAL);
                }
            }
        };
        let thread = std::thread::Builder::new().name("changes".to_owned()).spawn(poll).ok();
        Self { end, thread }
    }
}

impl Drop for ChangePoller {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What the controller answers.
#[derive(Debug)]
enum Answer {
    Process(Box<Status>),
    /// It is a board behind a bridge, and cannot send its policy.
    Board,
}

/// Requests the status, and the policies of the run that are not known yet. `None` if the
/// controller does not answer.
fn request(domain: &str, changes: &mut Changes) -> Option<Answer> {
    let mut client = Client::new(open_process(domain).ok()?, &Stop::default());
    let Some(report) = client.report().ok()? else { return Some(Answer::Board) };
    let status: Status = serde_json::from_slice(&report).ok()?;
    for crc32 in changes.policies(&status) {
        if let Entry::Vacant(unknown) = changes.blobs.entry(crc32.0) {
            unknown.insert(client.read_policy(crc32.0).ok()?.unwrap_or_default());
        }
    }
    Some(Answer::Process(Box::new(status)))
}

/// A change to record.
#[derive(Clone, Debug, PartialEq)]
enum Change {
    Policy(Policy),
    SetPoint(SetPoint),
}

/// The changes of a run that have been recorded.
#[derive(Debug)]
struct Changes {
    run_id: u32,
    began: bool,
    /// Whether the set-point in force before the run is recorded.
    has_set_point: bool,
    /// Numbers of the last swap and of the last set-point that are recorded.
    last_swap: u64,
    last_set_point: u64,
    /// The policies known so far, by checksum; empty where the controller does not have one.
    blobs: HashMap<u32, Vec<u8>>,
}

impl Changes {
    fn new(run_id: u32) -> Self {
        let blobs = HashMap::new();
        let (began, has_set_point) = (false, false);
        Self { run_id, began, has_set_point, last_swap: 0, last_set_point: 0, blobs }
    }

    /// Returns whether a tick belongs to the recording: run ids only rise, and may wrap.
    fn is_ours(&self, at: RunTick) -> bool {
        at.run_id.wrapping_sub(self.run_id) < u32::MAX / 2
    }

    /// Returns the policy with which the run began.
    fn first_policy(&self, status: &Status) -> Crc32 {
        // Of the swaps that were taken, the last one before the run.
        let before =
            status.swap_log.iter().rev().find(|s| s.at.is_some_and(|at| !self.is_ours(at)));
        let any_of_ours = status.swap_log.iter().any(|s| s.at.is_some_and(|at| self.is_ours(at)));
        match before {
            Some(before) => before.crc32,
            None if any_of_ours => status.before_swaps.unwrap_or(status.policy.crc32),
            None => status.policy.crc32,
        }
    }

    /// Returns the checksums of all policies of the run.
    fn policies(&self, status: &Status) -> Vec<Crc32> {
        let swaps = status.swap_log.iter().filter(|s| s.at.is_some_and(|at| self.is_ours(at)));
        let first = (!self.began).then(|| self.first_policy(status));
        first.into_iter().chain(swaps.map(|swap| swap.crc32)).collect()
    }

    /// Returns the changes that are new in an answer, in their order.
    fn update(&mut self, status: &Status) -> Vec<Change> {
        let mut new = Vec::new();
        if !self.began {
            self.began = true;
            let at = RunTick { run_id: self.run_id, seq: 0 };
            new.push(self.policy(self.first_policy(status), at));
        }
        for swap in &status.swap_log {
            if let Some(at) = swap.at.filter(|at| self.is_ours(*at))
                && swap.number > self.last_swap
            {
                self.last_swap = swap.number;
                new.push(self.policy(swap.crc32, at));
            }
        }
        // Before the first tick another request may still replace the one of an earlier run.
        if status.last.is_some_and(|at| self.is_ours(at)) {
            self.set_points(&status.set_point_log, &mut new);
        }
        new
    }

    fn set_points(&mut self, log: &[SetPointRecord], new: &mut Vec<Change>) {
        let first = RunTick { run_id: self.run_id, seq: 0 };
        let is_earlier = |r: &&SetPointRecord| r.at.is_some_and(|at| !self.is_ours(at));
        let earlier = log.iter().rfind(is_earlier).filter(|_| !self.has_set_point);
        self.has_set_point = true;
        let ours = log.iter().filter_map(|r| Some((r, r.at.filter(|at| self.is_ours(*at))?)));
        let all: Vec<_> = earlier
            .filter(|record| record.set_point_m_s.is_some())
            .map(|record| (record, first))
            .into_iter()
            .chain(ours)
            .collect();
        for (i, (record, at)) in all.iter().enumerate() {
            // Of those before the same tick the last one counts.
            let is_replaced = all.get(i + 1).is_some_and(|(_, next)| next == at);
            if record.number > self.last_set_point {
                self.last_set_point = record.number;
                if !is_replaced {
                    new.push(set_point(record, *at));
                }
            }
        }
    }

    fn policy(&self, crc32: Crc32, at: RunTick) -> Change {
        let blob = self.blobs.get(&crc32.0).cloned().unwrap_or_default();
        let aligned = AlignedBytes::from(blob.as_slice());
        let name = leg_control::policy::Policy::parse(aligned.as_slice())
            .map(|policy| policy.manifest().name.to_owned())
            .unwrap_or_default();
        Change::Policy(Policy { name, crc32: crc32.0, blob, run_id: at.run_id, seq: at.seq })
    }
}

fn set_point(record: &SetPointRecord, at: RunTick) -> Change {
    Change::SetPoint(SetPoint {
        is_set: record.set_point_m_s.is_some(),
        set_point_m_s: record.set_point_m_s.unwrap_or_default(),
        run_id: at.run_id,
        seq: at.seq,
    })
}

#[cfg(test)]
mod tests {
    use leg_host::status::SwapRecord;

    use super::*;

    fn swap(number: u64, crc32: u32, at: Option<(u32, u64)>) -> SwapRecord {
        let at = at.map(|(run_id, seq)| RunTick { run_id, seq });
        SwapRecord { number, crc32: Crc32(crc32), at }
    }

    fn set_point(
        number: u64,
        set_point_m_s: Option<f32>,
        at: Option<(u32, u64)>,
    ) -> SetPointRecord {
        let at = at.map(|(run_id, seq)| RunTick { run_id, seq });
        SetPointRecord { number, set_point_m_s, at }
    }

    fn status(running: u32, swap_log: &[SwapRecord], set_points: &[SetPointRecord]) -> Status {
        let mut status: Status = serde_json::from_value(serde_json::json!({
            "pid": 2, "rate_hz": 1000, "gravity_m_s2": 9.81, "time_mode": "lock-step",
            "activity": "running", "since_unix_s": 0.0, "since": null, "pending": null,
            "policy": {"name": "p", "crc32": format!("{running:08x}"), "file": "", "provenance": ""},
            "swaps": 0, "last": null, "ticks": 0, "apexes": 0,
            "rejected": {"ticks": 0, "missing": 0, "stale": 0, "safe_entered": 0},
            "peer": {"pid": 1, "connections": 1, "losses": 0}, "before_swaps": "00000001"
        }))
        .unwrap();
        status.swap_log = swap_log.to_vec();
        status.set_point_log = set_points.to_vec();
        status
    }

    /// Returns checksum, run and tick of the new policies.
    fn policies(changes: &mut Changes, running: u32, swaps: &[SwapRecord]) -> Vec<(u32, u32, u64)> {
        let new = changes.update(&status(running, swaps, &[]));
        let policy = |change| match change {
            Change::Policy(policy) => (policy.crc32, policy.run_id, policy.seq),
            Change::SetPoint(set_point) => panic!("{set_point:?}"),
        };
        new.into_iter().map(policy).collect()
    }

    #[test]
    fn returns_each_policy_of_the_run_once_with_its_tick() {
        let mut changes = Changes::new(4);
        let before = swap(1, 7, Some((3, 99)));
        assert_eq!(policies(&mut changes, 7, &[before]), [(7, 4, 0)]);
        assert_eq!(policies(&mut changes, 7, &[before]), []);
        // Requested, then accepted, then in force.
        assert_eq!(policies(&mut changes, 7, &[before, swap(2, 8, None)]), []);
        let second = swap(2, 8, Some((4, 50)));
        assert_eq!(policies(&mut changes, 7, &[before, second]), [(8, 4, 50)]);
        assert_eq!(policies(&mut changes, 8, &[before, second]), []);
        // One that came and went between two polls, and one after the leg was put back.
        let (third, fourth) = (swap(3, 9, Some((4, 60))), swap(4, 7, Some((5, 70))));
        let answer = [second, third, fourth];
        assert_eq!(changes.policies(&status(7, &answer, &[])), [8, 9, 7].map(Crc32));
        assert_eq!(policies(&mut changes, 7, &answer), [(9, 4, 60), (7, 5, 70)]);
    }

    #[test]
    fn finds_the_first_policy_of_a_run_in_which_it_was_swapped_already() {
        let (earlier, own) = (swap(1, 7, Some((3, 99))), swap(2, 8, Some((4, 0))));
        let mut changes = Changes::new(4);
        assert_eq!(policies(&mut changes, 8, &[earlier, own]), [(7, 4, 0), (8, 4, 0)]);
        let mut changes = Changes::new(4);
        assert_eq!(policies(&mut changes, 8, &[own]), [(1, 4, 0), (8, 4, 0)]);
    }

    #[test]
    fn returns_the_set_point_of_before_the_run_and_each_of_the_run_once() {
        let mut changes = Changes::new(4);
        let mut poll = |set_points: &[SetPointRecord]| -> Vec<(Option<f32>, u32, u64)> {
            let last = Some(RunTick { run_id: 4, seq: 8 });
            let new = changes.update(&Status { last, ..status(7, &[], set_points) });
            let set_points = new.into_iter().filter_map(|change| match change {
                Change::Policy(_) => None,
                Change::SetPoint(s) => Some((s.is_set.then_some(s.set_point_m_s), s.run_id, s.seq)),
            });
            set_points.collect()
        };
        let old = [set_point(1, Some(0.5), Some((2, 7))), set_point(2, Some(-0.5), Some((3, 7)))];
        assert_eq!(poll(&old), [(Some(-0.5), 4, 0)]);
        let own = set_point(3, None, Some((4, 9)));
        let later = [old[1], own, set_point(4, Some(0.0), None)];
        assert_eq!(poll(&later), [(None, 4, 9)]);
        let later = [old[1], own, set_point(4, Some(0.0), Some((4, 20)))];
        assert_eq!(poll(&later), [(Some(0.0), 4, 20)]);
        assert_eq!(poll(&later), []);
        let [one, other] = [5, 6].map(|n| set_point(n, Some(n as f32), Some((4, 30))));
        assert_eq!(poll(&[one, other]), [(Some(6.0), 4, 30)]);

        let last = Some(RunTick { run_id: 4, seq: 8 });
        let status = |set_points: &[SetPointRecord]| Status { last, ..status(7, &[], set_points) };
        let mut changes = Changes::new(4);
        let ended = [old[0], set_point(2, None, Some((3, 7)))];
        assert_eq!(changes.update(&status(&ended)).len(), 1, "the policy only");
        // The run has not begun: another request may still come.
        let mut changes = Changes::new(4);
        let waiting = Status { last: Some(RunTick { run_id: 3, seq: 99 }), ..status(&old) };
        assert_eq!(changes.update(&waiting).len(), 1, "the policy only");
        let replaced = [old[0], old[1], set_point(3, Some(2.0), Some((4, 0)))];
        let new = changes.update(&status(&replaced));
        assert!(matches!(&new[..], [Change::SetPoint(s)] if s.set_point_m_s == 2.0), "{new:?}");
    }
}
