//! The controller in a running process, operated from beside its loop.
//!
//! It takes orders (go on with this policy) from a wait-free ring, and leaves
//! word of what it does on a board of atomic numbers, which [`super::office`]
//! reads. A tick here neither waits, nor allocates, nor makes a system call,
//! but for one look at the clock when a policy takes over.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rtrb::{Consumer, Producer};

use super::desk::requests::{Moment, Rejected};
use super::realtime::Control;
use super::shelf::Shelved;
use leg_control::config::Config;
use leg_control::guard::Counts;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;

/// Orders that may wait for the loop's next tick.
pub(super) const ORDERS: usize = 16;

/// To go on with a policy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Order {
    pub(super) number: u64,
    pub(super) policy: &'static Shelved,
}

/// When orders were taken: before the tick that answers this sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    /// Up to this number, all that had not been told of before.
    pub(super) up_to: u64,
    pub(super) at: Moment,
}

/// What the loop shows of itself. Numbers that stand beside each other may be
/// a tick apart.
#[derive(Debug, Default)]
pub(super) struct Board {
    ticks: AtomicU64,
    run_id: AtomicU32,
    seq: AtomicU64,
    is_safe: AtomicBool,
    apexes: AtomicU32,
    rejected: AtomicU32,
    missing: AtomicU32,
    stale: AtomicU32,
    safe_entered: AtomicU32,
    /// The order in force; 0 is the policy that the process began with.
    in_force: AtomicU64,
    since_ns: AtomicU64,
    since_run_id: AtomicU32,
    since_seq: AtomicU64,
    /// Whether a sample has been answered under it.
    since_is_known: AtomicBool,
}

/// A reading of the board.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub(super) ticks: u64,
    pub(super) last: Option<Moment>,
    pub(super) is_safe: bool,
    pub(super) apexes: u32,
    pub(super) rejected: Rejected,
    pub(super) in_force: u64,
    pub(super) since_unix: Duration,
    pub(super) since: Option<Moment>,
}

impl Board {
    pub(super) fn read(&self) -> Reading {
        let ticks = self.ticks.load(Ordering::Acquire);
        let last = Moment { run_id: load(&self.run_id), seq: self.seq.load(Ordering::Relaxed) };
        let in_force = self.in_force.load(Ordering::Acquire);
        let since = Moment {
            run_id: load(&self.since_run_id),
            seq: self.since_seq.load(Ordering::Relaxed),
        };
        Reading {
            ticks,
            last: (ticks > 0).then_some(last),
            is_safe: self.is_safe.load(Ordering::Relaxed),
            apexes: load(&self.apexes),
            rejected: Rejected {
                ticks: load(&self.rejected),
                missing: load(&self.missing),
                stale: load(&self.stale),
                safe_entered: load(&self.safe_entered),
            },
            in_force,
            since_unix: Duration::from_nanos(self.since_ns.load(Ordering::Relaxed)),
            since: self.since_is_known.load(Ordering::Relaxed).then_some(since),
        }
    }
}

fn load(number: &AtomicU32) -> u32 {
    number.load(Ordering::Relaxed)
}

/// The loop's own: a controller that takes orders. Call it once a tick.
#[derive(Debug)]
pub struct Operated {
    controller: WireController<'static>,
    config: Config,
    orders: Consumer<Order>,
    taken: Producer<Taken>,
    board: Arc<Board>,
    /// The latest order taken, the latest told of, and the one in force.
    latest: u64,
    told: u64,
    in_force: u64,
    since_is_known: bool,
    counts: Counts,
    ticks: u64,
}

impl Operated {
    pub(super) fn new(
        policy: &'static Shelved,
        config: Config,
        orders: Consumer<Order>,
        taken: Producer<Taken>,
        board: Arc<Board>,
    ) -> Self {
        board.since_ns.store(now_ns(), Ordering::Relaxed);
        board.is_safe.store(true, Ordering::Relaxed);
        Self {
            controller: WireController::new(policy.policy().clone(), config),
            config,
            orders,
            taken,
            board,
            latest: 0,
            told: 0,
            in_force: 0,
            since_is_known: false,
            counts: Counts::default(),
            ticks: 0,
        }
    }

    /// One tick: the sample that came, or none, and the command for it.
    pub fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.take_orders();
        let command = self.controller.tick(sample);
        if let Some(sample) = sample {
            self.note(sample);
        }
        self.board.is_safe.store(command.is_safe(), Ordering::Relaxed);
        self.board.apexes.store(command.apexes, Ordering::Relaxed);
        self.note_policy(sample);
        self.note_counts();
        command
    }

    /// Takes what has been ordered, also between two runs: then it is in force
    /// at once.
    pub fn take_orders(&mut self) {
        while let Ok(order) = self.orders.pop() {
            self.controller.swap(order.policy.policy().clone());
            self.latest = order.number;
        }
    }

    /// Forgets the run, and is as it was at first, under the same policy; one
    /// that waits for an apex waits no longer.
    pub fn restart(&mut self) {
        self.take_orders();
        self.controller.restart(self.config);
        self.note_policy(None);
        self.note_counts();
    }

    /// What it runs, and what the guard says.
    #[must_use]
    pub fn controller(&self) -> &WireController<'static> {
        &self.controller
    }

    fn note(&mut self, sample: &Sample) {
        let at = Moment { run_id: sample.header.run_id, seq: sample.header.seq };
        self.ticks += 1;
        let board = &*self.board;
        board.run_id.store(at.run_id, Ordering::Relaxed);
        board.seq.store(at.seq, Ordering::Relaxed);
        board.ticks.store(self.ticks, Ordering::Release);
        if self.told != self.latest {
            // There is room: each order asks for one place at most.
            let _ = self.taken.push(Taken { up_to: self.latest, at });
            self.told = self.latest;
        }
    }

    fn note_policy(&mut self, sample: Option<&Sample>) {
        let board = &*self.board;
        if self.in_force != self.latest && !self.controller.swap_is_pending() {
            self.in_force = self.latest;
            self.since_is_known = false;
            board.since_is_known.store(false, Ordering::Relaxed);
            board.since_ns.store(now_ns(), Ordering::Relaxed);
            board.in_force.store(self.in_force, Ordering::Release);
        }
        if let Some(sample) = sample
            && !self.since_is_known
        {
            self.since_is_known = true;
            board.since_run_id.store(sample.header.run_id, Ordering::Relaxed);
            board.since_seq.store(sample.header.seq, Ordering::Relaxed);
            board.since_is_known.store(true, Ordering::Relaxed);
        }
    }

    fn note_counts(&mut self) {
        let counts = *self.controller.counts();
        if counts != self.counts {
            self.counts = counts;
            let board = &*self.board;
            board.rejected.store(counts.rejected(), Ordering::Relaxed);
            board.missing.store(counts.missing, Ordering::Relaxed);
            board.stale.store(counts.stale, Ordering::Relaxed);
            board.safe_entered.store(counts.safe_entered, Ordering::Relaxed);
        }
    }
}

impl Control for Operated {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        Self::tick(self, sample)
    }

    fn reset(&mut self) {
        self.restart();
    }
}

fn now_ns() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    now.as_nanos() as u64
}
