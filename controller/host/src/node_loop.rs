//! The control node of a process, as its control loop runs it.
//!
//! Changes come from a wait-free ring, and the state of the node goes out
//! through a triple buffer; [`super::node_server`] has the other ends. A tick
//! here neither waits, nor allocates, nor makes a system call.

use rtrb::{Consumer, Producer};
use triple_buffer::Input;

use super::realtime::Control;
use super::safe_state::SafeStateWatch;
use leg_control::guard::Counts;
use leg_control::policy::Policy;
use leg_control::serial::message::{PolicyReport, RunTick, Slot};
use leg_control::serial::node::{ControlNode, NodeStatus};
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;

/// Changes that may wait for the loop's next tick.
pub(super) const CHANGES: usize = 16;

/// A change of the node.
// A policy is moved as it is: in a box, the loop would free memory.
#[allow(clippy::large_enum_variant)]
#[derive(Debug)]
pub(super) enum Change {
    SetPoint { number: u64, set_point_m_s: Option<f32> },
    RunPolicy { number: u64, slot: Slot, policy: Policy<'static> },
}

/// The loop has taken changes: before the tick that answers this sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    /// All policies up to this number that were not reported before.
    pub(super) policies: u64,
    /// All set-points up to this number that were not reported before.
    pub(super) set_points: u64,
    pub(super) at: RunTick,
}

/// The state of the node after a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Snapshot {
    pub(super) status: NodeStatus<'static>,
    /// Number of the policy in force; 0 is the first.
    pub(super) in_force: u64,
    /// The first tick with a sample under it.
    pub(super) since: Option<RunTick>,
}

/// What came of a run, or of several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunResult {
    /// Number of runs.
    pub runs: u64,
    /// Samples answered.
    pub ticks: u64,
    /// Apexes.
    pub apexes: u64,
    /// What the guard rejected.
    pub counts: Counts,
}

impl RunResult {
    /// Adds the result of another run.
    pub fn add(&mut self, other: &Self) {
        *self = Self {
            runs: self.runs + other.runs,
            ticks: self.ticks + other.ticks,
            apexes: self.apexes + other.apexes,
            counts: self.counts.plus(&other.counts),
        };
    }
}

/// The run in progress.
#[derive(Clone, Copy, Debug, Default)]
struct CurrentRun {
    run_id: u32,
    ticks: u64,
    apexes: u32,
    /// Ticks that the guard has rejected.
    rejected: u32,
}

/// A control node that takes changes from beside its loop. Call it once a tick.
#[derive(Debug)]
pub struct NodeLoop {
    node: ControlNode<'static>,
    changes: Consumer<Change>,
    taken: Producer<Taken>,
    snapshot: Input<Snapshot>,
    /// The runs that have ended.
    ended: Producer<RunResult>,
    run: CurrentRun,
    total: RunResult,
    /// Sequence number of the last tick.
    seq: u32,
    /// Numbers of the latest policy and of the latest set-point taken, and of those reported.
    latest: u64,
    latest_set_point: u64,
    reported: (u64, u64),
    policy: Option<PolicyReport<'static>>,
    in_force: u64,
    since: Option<RunTick>,
    safe_state: SafeStateWatch,
}

impl NodeLoop {
    pub(super) fn new(
        node: ControlNode<'static>,
        changes: Consumer<Change>,
        taken: Producer<Taken>,
        snapshot: Input<Snapshot>,
        ended: Producer<RunResult>,
        safe_state: SafeStateWatch,
    ) -> Self {
        let mut this = Self {
            node,
            changes,
            taken,
            snapshot,
            ended,
            run: CurrentRun::default(),
            total: RunResult::default(),
            seq: 0,
            latest: 0,
            latest_set_point: 0,
            reported: (0, 0),
            policy: None,
            in_force: 0,
            since: None,
            safe_state,
        };
        this.take_changes();
        this.policy = this.node.report();
        this.publish(None);
        this
    }

    /// Runs one tick: returns the command for the sample that came, or for none.
    pub fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.take_changes();
        self.seq = self.seq.wrapping_add(1);
        let command = self.tick_of_run(sample);
        let at =
            sample.map(|sample| RunTick { run_id: sample.header.run_id, seq: sample.header.seq });
        let latest = (self.latest, self.latest_set_point);
        if let Some(at) = at
            && self.reported != latest
        {
            // There is room: each change needs one place at most, and the server empties the ring
            // before each change.
            let (policies, set_points) = latest;
            let _ = self.taken.push(Taken { policies, set_points, at });
            self.reported = latest;
        }
        self.publish(at);
        command
    }

    /// Runs one tick of the law, and counts it in its run. A sample of another run that the guard
    /// accepts ends the run before.
    fn tick_of_run(&mut self, sample: Option<&Sample>) -> Command {
        let is_other = |sample: &&Sample| sample.header.run_id != self.run.run_id;
        let before = sample.filter(is_other).and_then(|_| self.result_of_run());
        let command = self.node.tick(self.seq, sample);
        if let Some(controller) = self.node.controller() {
            self.safe_state.note(sample, &command, controller.counts());
        }
        if let Some(sample) = sample {
            let is_accepted = command.rejected <= self.run.rejected;
            if is_accepted && sample.header.run_id != self.run.run_id {
                self.close_run(before);
                self.run.run_id = sample.header.run_id;
            }
            self.run.ticks += 1;
        }
        (self.run.apexes, self.run.rejected) = (command.apexes, command.rejected);
        command
    }

    /// Returns the result of the run in progress, if it has had a tick.
    #[must_use]
    pub fn result_of_run(&self) -> Option<RunResult> {
        let CurrentRun { ticks, apexes, .. } = self.run;
        let counts = self.controller().map(|controller| *controller.counts()).unwrap_or_default();
        (ticks > 0).then_some(RunResult { runs: 1, ticks, apexes: apexes.into(), counts })
    }

    fn close_run(&mut self, result: Option<RunResult>) {
        if let Some(result) = result {
            self.total.add(&result);
            // Where nobody reads them there is no room, and nothing is lost.
            let _ = self.ended.push(result);
        }
        self.run = CurrentRun::default();
    }

    /// Returns the result of all runs so far.
    #[must_use]
    pub fn total(&self) -> RunResult {
        let mut total = self.total;
        if let Some(result) = self.result_of_run() {
            total.add(&result);
        }
        total
    }

    /// Takes the changes that wait; also between two runs, where a policy takes
    /// over at once.
    pub fn take_changes(&mut self) {
        while let Ok(change) = self.changes.pop() {
            match change {
                // The server has checked it.
                Change::SetPoint { number, set_point_m_s } => {
                    let _ = self.node.set_point(set_point_m_s);
                    self.latest_set_point = number;
                }
                Change::RunPolicy { number, slot, policy } => {
                    self.node.run_policy(slot, &policy);
                    self.latest = number;
                }
            }
        }
    }

    /// Forgets the run and keeps the policy; one that waits for an apex runs.
    pub fn restart(&mut self) {
        self.take_changes();
        self.end_run();
        self.node.end_run();
        self.safe_state.restart();
        self.publish(None);
    }

    /// Counts the run in progress among those that have ended.
    pub fn end_run(&mut self) {
        self.close_run(self.result_of_run());
    }

    /// Takes the changes that wait while no leg is there.
    pub fn idle(&mut self) {
        self.take_changes();
        self.publish(None);
    }

    /// Returns the control law that runs.
    #[must_use]
    pub fn controller(&self) -> Option<&WireController<'static>> {
        self.node.controller()
    }

    fn publish(&mut self, at: Option<RunTick>) {
        let is_pending = self.controller().is_some_and(WireController::swap_is_pending);
        if self.in_force != self.latest && !is_pending {
            self.in_force = self.latest;
            self.since = None;
            self.policy = self.node.report();
        }
        self.since = self.since.or(at);
        let status = self.node.status(self.policy);
        self.snapshot.write(Snapshot { status, in_force: self.in_force, since: self.since });
    }
}

impl Control for NodeLoop {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        Self::tick(self, sample)
    }

    fn reset(&mut self) {
        self.restart();
    }
}
