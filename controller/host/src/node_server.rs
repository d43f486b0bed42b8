//! Answers requests to the control node of this process, beside its loop.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::fmt;
use std::path::Path;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use rtrb::{Consumer, Producer, RingBuffer};
use triple_buffer::{Output, triple_buffer};

use super::link::{PeerStatus, SessionParams, TimeMode};
use super::memory_store::MemoryStore;
use super::node_loop::{CHANGES, Change, NodeLoop, RunResult, Snapshot, Taken};
use super::policy_cache::CachedPolicy;
use super::realtime::LatestReport;
use super::safe_state::{self, SafeStateReporter};
use super::status::{Crc32, PolicyName, SetPointRecord, Status, SwapRecord};
use leg_control::config::ConfigError;
use leg_control::serial::endpoint::{Endpoint, RepeatFilter};
use leg_control::serial::handler::{DeviceInfo, RequestHandler};
use leg_control::serial::message::{
    Activity, DeviceCounts, LineCounts, MAX_CHUNK, Mode, Reply, Request, RequestError, Slot,
    ToController, ToHost,
};
use leg_control::serial::node::{
    self, ControlNode, NodeChange, NodeHandle, NodeStatus, check_set_point,
};
use leg_control::wire::{Command, Sample};
use leg_process::policy_file::PolicyFile;

/// Name of the device of a process.
pub const PROCESS: &str = "process";
const DEVICE: DeviceInfo = DeviceInfo { name: PROCESS, firmware: env!("CARGO_PKG_VERSION") };
/// Swaps that a report lists.
const SWAP_LOG: usize = 64;
/// Set-points that a report lists.
const SET_POINT_LOG: usize = 64;
/// Reports of changes that the loop may send between two looks of the server: of those that wait
/// in its ring, of one more, and of those that it took while no leg was there.
const TAKEN: usize = CHANGES + 2;

/// Runs that may end between two looks of a reader.
const ENDED_RUNS: usize = 64;

/// Where a status comes from, as far as the node does not know it.
pub struct StatusSources {
    /// Returns the state of the connection to the leg.
    pub peer: Box<dyn Fn() -> PeerStatus + Send>,
    /// The statistics of the loop, in real time.
    pub timing: Option<LatestReport>,
}

impl fmt::Debug for StatusSources {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StatusSources")
    }
}

/// The handle on the node in the loop.
struct LoopHandle {
    changes: RefCell<Producer<Change>>,
    snapshot: RefCell<Output<Snapshot>>,
    taken: RefCell<Consumer<Taken>>,
    sources: StatusSources,
    /// Number of the next policy; the first has number 0.
    next: Cell<u64>,
    /// Slot of the latest policy.
    slot: Cell<Slot>,
    /// The set-points that were requested, the latest last.
    set_points: RefCell<VecDeque<SetPointRecord>>,
    /// The policies that were to run, the latest last; the first of them before
    /// the oldest swap that is listed.
    policies: RefCell<VecDeque<SwapRecord>>,
}

impl fmt::Debug for LoopHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("LoopHandle")
    }
}

impl LoopHandle {
    fn snapshot(&self) -> Snapshot {
        *self.snapshot.borrow_mut().read()
    }

    /// Enters what the loop has taken into the log.
    fn update_log(&self) {
        while let Ok(Taken { policies, set_points, at }) = self.taken.borrow_mut().pop() {
            for record in self.policies.borrow_mut().iter_mut() {
                if record.number <= policies && record.number > 0 && record.at.is_none() {
                    record.at = Some(at);
                }
            }
            for record in self.set_points.borrow_mut().iter_mut() {
                if record.number <= set_points && record.at.is_none() {
                    record.at = Some(at);
                }
            }
        }
    }

    fn run_policy(
        &self,
        slot: Slot,
        policy: &leg_control::policy::Policy<'static>,
    ) -> Result<(), RequestError> {
        self.update_log();
        let mut policies = self.policies.borrow_mut();
        // A place for its taking, too: the loop never finds that ring full.
        let waiting = policies.iter().filter(|record| record.number > 0 && record.at.is_none());
        if waiting.count() >= CHANGES {
            return Err(RequestError::Busy);
        }
        let number = self.next.get();
        let change = Change::RunPolicy { number, slot, policy: policy.clone() };
        self.changes.borrow_mut().push(change).map_err(|_| RequestError::Busy)?;
        self.next.set(number + 1);
        self.slot.set(slot);
        policies.push_back(SwapRecord { number, crc32: Crc32(policy.crc32()), at: None });
        if policies.len() > SWAP_LOG + 1 {
            policies.pop_front();
        }
        Ok(())
    }

    fn set_point(&self, set_point_m_s: Option<f32>) -> Result<(), RequestError> {
        check_set_point(set_point_m_s)?;
        self.update_log();
        let mut set_points = self.set_points.borrow_mut();
        let number = set_points.back().map_or(1, |last| last.number + 1);
        let change = Change::SetPoint { number, set_point_m_s };
        self.changes.borrow_mut().push(change).map_err(|_| RequestError::Busy)?;
        set_points.push_back(SetPointRecord { number, set_point_m_s, at: None });
        if set_points.len() > SET_POINT_LOG {
            set_points.pop_front();
        }
        Ok(())
    }

    /// Returns the set-point in place of that in the samples, m/s.
    fn set_point_m_s(&self) -> Option<f32> {
        self.set_points.borrow().back()?.set_point_m_s
    }

    /// Returns the checksum of the policy with this number; of forgotten ones,
    /// that of the oldest in the log.
    fn crc32(&self, number: u64) -> u32 {
        let policies = self.policies.borrow();
        let found = policies.iter().rev().find(|record| record.number <= number);
        found.or(policies.front()).map_or(0, |record| record.crc32.0)
    }
}

impl NodeHandle for LoopHandle {
    fn status(&self) -> NodeStatus<'static> {
        let Snapshot { mut status, in_force, .. } = self.snapshot();
        if in_force + 1 < self.next.get() {
            status.run.pending = Some(self.slot.get());
        }
        if (self.sources.peer)().pid.is_none() {
            status.run.activity = Activity::Waiting;
        }
        status
    }

    fn change(&self, change: NodeChange<'_>) -> Result<(), RequestError> {
        match change {
            NodeChange::Reset(..) | NodeChange::SetMode(_) => Err(RequestError::InSession),
            NodeChange::SetPoint(set_point_m_s) => self.set_point(set_point_m_s),
            NodeChange::RunPolicy(slot, policy) => self.run_policy(slot, policy),
            NodeChange::CountRepeated => Ok(()),
        }
    }

    /// Samples come from shared memory only.
    fn sample(&self, _seq: u32, _sample: &Sample) -> Option<Command> {
        None
    }
}

/// Answers requests to a [`NodeLoop`].
#[derive(Debug)]
pub struct NodeServer {
    handler: RequestHandler<MemoryStore>,
    node: LoopHandle,
    ended: Consumer<RunResult>,
    params: SessionParams,
    /// The last report, as JSON.
    report: Vec<u8>,
    /// The policy in force when last looked at, and when it took over.
    seen_in_force: u64,
    since: SystemTime,
    safe_state: SafeStateReporter,
}

impl NodeServer {
    /// Makes a node that begins with `policy`, from `file`, and its server.
    ///
    /// # Errors
    /// [`ConfigError`] when a parameter of the session is out of range.
    pub fn open(
        policy: &'static CachedPolicy,
        file: &str,
        params: SessionParams,
        sources: StatusSources,
    ) -> Result<(NodeLoop, Self), ConfigError> {
        let (changes, to_take) = RingBuffer::new(CHANGES);
        let (to_report, taken) = RingBuffer::new(TAKEN);
        let mut control_node = ControlNode::new();
        let session = node::SessionParams {
            rate_hz: params.rate_hz,
            gravity_m_s2: params.gravity_m_s2,
            stale_limit_ns: u32::try_from(params.stale_limit_ns)
                .map_err(|_| ConfigError::StaleLimit(params.stale_limit_ns))?,
            estimator: params.estimator.unwrap_or_default(),
        };
        control_node.reset(std::process::id(), session)?;
        control_node.set_mode(match params.time_mode {
            Some(TimeMode::RealTime) => Mode::Live,
            Some(TimeMode::LockStep) | None => Mode::LockStep,
        });
        let status = control_node.status(None);
        let (input, output) = triple_buffer(&Snapshot { status, in_force: 0, since: None });
        let handle = LoopHandle {
            changes: RefCell::new(changes),
            snapshot: RefCell::new(output),
            taken: RefCell::new(taken),
            sources,
            next: Cell::new(0),
            slot: Cell::new(Slot::A),
            set_points: RefCell::new(VecDeque::new()),
            policies: RefCell::new(VecDeque::new()),
        };
        let store = MemoryStore::new(policy, file);
        // The policy is there, so there is no alarm.
        let (handler, _) = RequestHandler::power_up(DEVICE, store, &handle);
        let (to_end, ended) = RingBuffer::new(ENDED_RUNS);
        let (watch, safe_state) = safe_state::watch(params.rate_hz);
        let node_loop = NodeLoop::new(control_node, to_take, to_report, input, to_end, watch);
        let server = Self {
            handler,
            node: handle,
            ended,
            params,
            report: Vec::new(),
            seen_in_force: 0,
            since: SystemTime::now(),
            safe_state,
        };
        Ok((node_loop, server))
    }

    /// Takes a byte that a client sent; returns the frame to send, if there is one.
    pub(super) fn push<'e>(&mut self, endpoint: &'e mut Endpoint, byte: u8) -> Option<&'e [u8]> {
        endpoint.push_with(byte, |message, filter, line| match message {
            // Samples come from shared memory only.
            ToController::Sample { .. } => None,
            ToController::Request { id, request } => {
                let reply = self.answer(id, &request, filter, line);
                Some(ToHost::Reply { id, reply })
            }
        })
    }

    fn answer(
        &mut self,
        id: u32,
        request: &Request<'_>,
        filter: &mut RepeatFilter,
        line: &LineCounts,
    ) -> Reply<'_> {
        if let Request::Report { offset } = *request {
            if offset == 0 {
                self.report = serde_json::to_vec(&self.status()).unwrap_or_default();
            }
            let rest = self.report.get(offset as usize..).unwrap_or_default();
            return Reply::Bytes(rest.get(..MAX_CHUNK).unwrap_or(rest));
        }
        filter.answer(id, request, &mut self.handler, &self.node, line, &DeviceCounts::default())
    }

    /// Has the node run the policy in a file, from the next apex on, and returns
    /// its description.
    ///
    /// # Errors
    /// A message when it is refused; nothing has changed then.
    pub fn swap_file(&mut self, path: &Path) -> Result<PolicyName, String> {
        self.swap(path).map_err(|cause| {
            let PolicyName { name, crc32, .. } = self.in_force();
            format!("{cause}; the policy {name} ({crc32}) stays")
        })
    }

    fn swap(&mut self, path: &Path) -> Result<PolicyName, String> {
        let file = PolicyFile::read(path).map_err(|cause| cause.to_string())?;
        let crc32 = file.policy().map_err(|cause| cause.to_string())?.crc32();
        let blob = file.as_slice();
        let origin = path.display().to_string();
        let mut request = |request: &Request<'_>| {
            let device = DeviceCounts::default();
            match self.handler.answer(request, &self.node, &LineCounts::ZERO, &device) {
                Reply::Refused(error) => Err(error.to_string()),
                _ => Ok(()),
            }
        };
        request(&Request::Begin { length: blob.len() as u32, crc32, origin: &origin })?;
        for (index, bytes) in blob.chunks(MAX_CHUNK).enumerate() {
            let offset = (index * MAX_CHUNK) as u32;
            request(&Request::Chunk { offset, bytes })?;
        }
        request(&Request::Commit)?;
        Ok(self.handler.store().describe(crc32))
    }

    /// Returns the result of a run that has ended since the last call, oldest first.
    pub fn ended_run(&mut self) -> Option<RunResult> {
        self.ended.pop().ok()
    }

    /// Returns a message about a safe state that holds while samples come, once a second.
    pub fn safe_state(&mut self) -> Option<String> {
        self.safe_state.message(Instant::now())
    }

    /// Returns a message when another policy has taken over since the last call.
    pub fn news(&mut self) -> Option<String> {
        self.node.update_log();
        let Snapshot { in_force, since, .. } = self.node.snapshot();
        if in_force == self.seen_in_force {
            return None;
        }
        (self.seen_in_force, self.since) = (in_force, SystemTime::now());
        let PolicyName { name, crc32, file, .. } = self.in_force();
        let at = since.map_or_else(String::new, |at| format!(" at tick {}", at.seq));
        Some(format!("the policy {name} ({crc32}, {file}) has taken over{at}"))
    }

    /// Returns the policy in force.
    #[must_use]
    pub fn in_force(&self) -> PolicyName {
        self.handler.store().describe(self.node.crc32(self.node.snapshot().in_force))
    }

    /// Returns the set-point in force in place of that in the samples, m/s.
    #[must_use]
    pub fn set_point_m_s(&self) -> Option<f32> {
        self.node.set_point_m_s()
    }

    /// Returns the status of the process.
    pub fn status(&mut self) -> Status {
        self.node.update_log();
        let status = self.node.status();
        let Snapshot { in_force, since, .. } = self.node.snapshot();
        if in_force != self.seen_in_force {
            self.since = SystemTime::now();
        }
        let store = self.handler.store();
        let latest = self.node.next.get() - 1;
        let log = self.node.policies.borrow();
        Status {
            pid: std::process::id(),
            rate_hz: self.params.rate_hz,
            gravity_m_s2: self.params.gravity_m_s2,
            time_mode: self.params.time_mode.unwrap_or(TimeMode::LockStep),
            estimator: Some(self.params.estimator.unwrap_or_default()),
            stale_limit_ns: Some(self.params.stale_limit_ns),
            activity: status.run.activity,
            policy: store.describe(self.node.crc32(in_force)),
            since_unix_s: self.since.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64(),
            since,
            pending: (in_force < latest).then(|| store.describe(self.node.crc32(latest))),
            swaps: in_force,
            last: status.run.last,
            ticks: status.run.counts.ticks - status.run.counts.missed,
            set_point_m_s: self.node.set_point_m_s(),
            apexes: status.run.apexes,
            rejected: status.run.rejected,
            peer: (self.node.sources.peer)(),
            swap_log: log.iter().skip(1).copied().collect(),
            before_swaps: log.front().map(|record| record.crc32),
            set_point_log: self.node.set_points.borrow().iter().copied().collect(),
            timing: self.node.sources.timing.as_ref().map(LatestReport::get),
        }
    }
}

#[cfg(test)]
mod tests;
