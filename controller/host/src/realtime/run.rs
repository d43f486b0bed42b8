//! Running a task at every tick of a schedule.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use leg_process::{Stop, stderr};
use rtrb::{Consumer, Producer, RingBuffer};

use super::clock::{Clock, MonotonicClock};
use super::loop_stats::LoopStats;
use super::privileges::Privileges;
use super::schedule::TickSchedule;
use super::stats_thread::{LatestReport, StatsThread, TickObserver};
use super::tick_stats::{LoopCounters, RxStatus, TickStats};
use super::ticker::{Tick, Ticker};
use crate::link::Role;

/// A tick is late if its lateness exceeds the period divided by this.
const LATE_DIVISOR: u64 = 10;
/// Capacity of the ring of records, s of ticks.
const RING_S: u32 = 2;
/// Interval of the supervisor's calls.
const SUPERVISE_INTERVAL: Duration = Duration::from_millis(10);

/// The work of a loop.
pub trait Task {
    /// The error that ends the loop early.
    type Error;

    /// Performs one tick. Must neither allocate, nor log, nor wait.
    ///
    /// # Errors
    /// Returns the error that ends the loop.
    fn tick(&mut self, at: &Tick, clock: &impl Clock) -> Result<TickResult, Self::Error>;
}

/// The result of a tick. Most fields are those of [`TickStats`].
#[derive(Clone, Copy, Debug, Default)]
pub struct TickResult {
    /// What the tick has received.
    pub rx: RxStatus,
    /// Whether a safe command is in force.
    pub safe: bool,
    /// Id of the run.
    pub run_id: u32,
    /// Tick of the run.
    pub seq: u64,
    /// Age of the sample that the tick used, ns.
    pub sample_age_ns: Option<u64>,
    /// Time from a sample to its command, ns.
    pub round_trip_ns: Option<u64>,
    /// Whether this was the last tick.
    pub over: bool,
}

/// The loop's end of the ring of tick records, with the counters.
#[derive(Debug)]
pub struct StatsWriter {
    counters: LoopCounters,
    records: Producer<TickStats>,
    last_woke_ns: Option<u64>,
}

impl StatsWriter {
    /// Creates a ring with room for two seconds of ticks; returns both its ends.
    #[must_use]
    pub fn new(rate_hz: u32) -> (Self, Consumer<TickStats>) {
        let (records, reader) = RingBuffer::new(RING_S as usize * rate_hz.max(1) as usize);
        (Self { counters: LoopCounters::default(), records, last_woke_ns: None }, reader)
    }

    /// Returns the counters so far.
    #[must_use]
    pub fn counters(&self) -> LoopCounters {
        self.counters
    }

    /// Records a tick that ended at `now_ns` and used `cpu_ns` of processor time.
    fn record(
        &mut self,
        schedule: TickSchedule,
        at: &Tick,
        result: &TickResult,
        cpu_ns: u64,
        now_ns: u64,
    ) {
        let c = &mut self.counters;
        let gap_ns = at.woke_ns - self.last_woke_ns.replace(at.woke_ns).unwrap_or(at.woke_ns);
        c.longest_gap_ns = c.longest_gap_ns.max(gap_ns);
        c.ticks += 1 + at.missed;
        c.missed += at.missed;
        match result.rx {
            RxStatus::Idle | RxStatus::EndOfRun => c.idle += 1,
            RxStatus::Stale => c.stale += 1,
            RxStatus::New => c.received += 1,
        }
        c.late += u64::from(at.lateness_ns() > schedule.tick_ns() / LATE_DIVISOR);
        c.deadline_misses += u64::from(now_ns > schedule.at_ns(at.index + 1));
        c.own_overruns += u64::from(cpu_ns > schedule.tick_ns());
        c.safe += u64::from(result.safe);
        let record = TickStats {
            woke_ns: at.woke_ns,
            lateness_ns: at.lateness_ns(),
            work_ns: now_ns.saturating_sub(at.woke_ns),
            sample_age_ns: result.sample_age_ns,
            round_trip_ns: result.round_trip_ns,
            rx: result.rx,
            safe: result.safe,
            run_id: result.run_id,
            seq: result.seq,
            counters: *c,
        };
        self.counters.dropped_records += u64::from(self.records.push(record).is_err());
    }
}

/// Performs `task` at every tick of `schedule`, until its last tick or until `stop` is
/// raised.
///
/// # Errors
/// Returns the error of the task.
pub fn run_ticks<T: Task>(
    clock: &impl Clock,
    schedule: TickSchedule,
    task: &mut T,
    stats: &mut StatsWriter,
    stop: &Stop,
) -> Result<(), T::Error> {
    let mut ticker = Ticker::new(clock, schedule);
    while !stop.is_raised() {
        let at = ticker.wait();
        let cpu_ns = clock.cpu_time_ns();
        let result = task.tick(&at, clock)?;
        let cpu_ns = clock.cpu_time_ns().saturating_sub(cpu_ns);
        stats.record(schedule, &at, &result, cpu_ns, clock.now_ns());
        if result.over {
            break;
        }
    }
    Ok(())
}

/// The options of a loop.
#[derive(Clone, Debug)]
pub struct LoopOptions {
    /// Role of the process.
    pub role: Role,
    /// Tick rate, Hz.
    pub rate_hz: u32,
    /// Age from which on a message of the peer counts for nothing, ns.
    pub stale_limit_ns: u64,
    /// How long to spin before each tick.
    pub spin: Duration,
    /// Scheduling and memory privileges to acquire.
    pub privileges: Privileges,
    /// Whether to print a status line on stderr every second.
    pub live: bool,
    /// Where to publish the latest report, ten times a second.
    pub latest_report: LatestReport,
    /// Observer of every tick, called on the statistics thread.
    pub observer: Option<TickObserver>,
}

/// Sets a flag when dropped, on a panic too.
struct SetOnDrop<'a>(&'a AtomicBool);

impl Drop for SetOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Runs a loop on this thread, with a statistics thread and a supervisor beside it,
/// until the task's last tick or until `stop` is raised. Returns the task's result and
/// the statistics.
///
/// `supervise` is called every 10 ms on the supervisor's thread: the place for work
/// that may block, such as monitoring the peer.
///
/// # Panics
/// Panics when the system cannot start a thread.
pub fn run<T: Task>(
    options: &LoopOptions,
    task: &mut T,
    stop: &Stop,
    mut supervise: impl FnMut() + Send,
) -> (Result<(), T::Error>, LoopStats) {
    let LoopOptions { role, rate_hz, ref privileges, .. } = *options;
    let schedule = TickSchedule::of(role, rate_hz);
    let clock = MonotonicClock::new(options.spin, schedule.tick_ns());
    let (mut stats, records) = StatsWriter::new(rate_hz);
    let stats_thread =
        StatsThread::new(role, rate_hz, records, options.latest_report.clone(), options.live)
            .with_stale_limit(options.stale_limit_ns)
            .with_observer(options.observer.clone());
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let set_over = SetOnDrop(&over);
        // Start the helpers before acquiring the privileges, which they would inherit.
        let stats_thread = thread::Builder::new()
            .name("statistics".to_owned())
            .spawn_scoped(scope, || stats_thread.run(&over))
            .expect("a thread");
        thread::Builder::new()
            .name("supervisor".to_owned())
            .spawn_scoped(scope, || {
                while !over.load(Ordering::Acquire) {
                    supervise();
                    thread::sleep(SUPERVISE_INTERVAL);
                }
            })
            .expect("a thread");
        if let Some(warning) = privileges.acquire() {
            stderr::print_line(format_args!("{role}: {warning}"));
        }
        let ended = run_ticks(&clock, schedule, task, &mut stats, stop);
        drop(set_over);
        let mut loop_stats = stats_thread.join().expect("a statistics thread that does not panic");
        loop_stats.set_counters(stats.counters());
        (ended, loop_stats)
    })
}
