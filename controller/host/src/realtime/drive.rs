//! The loop: tick after tick, and what goes into the log.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use super::super::card::Role;
use super::clerk::{Clerk, Listener, Shared};
use super::clock::{Clock, Monotonic};
use super::grid::Grid;
use super::pacer::{Pacer, Tick};
use super::privileges::Privileges;
use super::row::{Counters, Row, Word};
use super::tally::Tally;
use leg_process::signals::Stop;

/// A tick that begins later than this part of a tick counts as late.
const LATE: u64 = 10;
/// Time for which the ring takes rows while nobody fetches them, s.
const ROWS_S: u32 = 2;
/// Between two looks of the supervisor.
const LOOK: Duration = Duration::from_millis(10);

/// What happens in a tick.
pub trait Task {
    /// What ends the loop before its time.
    type Error;

    /// Plays a tick. Must neither allocate, nor log, nor wait.
    ///
    /// # Errors
    /// Whatever ends the loop.
    fn tick(&mut self, at: &Tick, clock: &impl Clock) -> Result<Done, Self::Error>;
}

/// What has come of a tick; the fields are those of a [`Row`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Done {
    /// What was heard.
    pub word: Word,
    /// Whether a safe command is in force.
    pub safe: bool,
    /// The run.
    pub run_id: u32,
    /// Its tick.
    pub seq: u64,
    /// How old the sample is that the tick went by, ns.
    pub sample_age_ns: Option<u64>,
    /// From a sample to its command, ns.
    pub round_trip_ns: Option<u64>,
    /// Whether this was the last tick.
    pub over: bool,
}

/// Where a loop writes what it has to tell: counts, and a row a tick.
#[derive(Debug)]
pub struct Log {
    counters: Counters,
    rows: Producer<Row>,
    last_woke_ns: Option<u64>,
}

impl Log {
    /// A log with room for two seconds of ticks, and the end at which to read it.
    #[must_use]
    pub fn new(rate_hz: u32) -> (Self, Consumer<Row>) {
        let (rows, read) = RingBuffer::new(ROWS_S as usize * rate_hz.max(1) as usize);
        (Self { counters: Counters::default(), rows, last_woke_ns: None }, read)
    }

    /// All counts so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Takes in a tick that is done, at `now_ns`, and took `own_ns` of processor time.
    fn enter(&mut self, grid: Grid, at: &Tick, done: &Done, own_ns: u64, now_ns: u64) {
        let c = &mut self.counters;
        let gap_ns = at.woke_ns - self.last_woke_ns.replace(at.woke_ns).unwrap_or(at.woke_ns);
        c.longest_gap_ns = c.longest_gap_ns.max(gap_ns);
        c.ticks += 1 + at.missed;
        c.missed += at.missed;
        match done.word {
            Word::Idle | Word::Farewell => c.idle += 1,
            Word::Stale => c.stale += 1,
            Word::New => c.heard += 1,
        }
        c.late += u64::from(at.lateness_ns() > grid.tick_ns() / LATE);
        c.deadline_misses += u64::from(now_ns > grid.at_ns(at.index + 1));
        c.own_overruns += u64::from(own_ns > grid.tick_ns());
        c.safe += u64::from(done.safe);
        let row = Row {
            woke_ns: at.woke_ns,
            lateness_ns: at.lateness_ns(),
            work_ns: now_ns.saturating_sub(at.woke_ns),
            sample_age_ns: done.sample_age_ns,
            round_trip_ns: done.round_trip_ns,
            word: done.word,
            safe: done.safe,
            run_id: done.run_id,
            seq: done.seq,
            counters: *c,
        };
        self.counters.dropped_rows += u64::from(self.rows.push(row).is_err());
    }
}

/// Plays `task` at every tick of `grid`, until it is over or `stop` is raised.
///
/// # Errors
/// That of the task.
pub fn drive<T: Task>(
    clock: &impl Clock,
    grid: Grid,
    task: &mut T,
    log: &mut Log,
    stop: &Stop,
) -> Result<(), T::Error> {
    let mut pacer = Pacer::new(clock, grid);
    while !stop.is_raised() {
        let at = pacer.wait();
        let own_ns = clock.own_ns();
        let done = task.tick(&at, clock)?;
        let own_ns = clock.own_ns().saturating_sub(own_ns);
        log.enter(grid, &at, &done, own_ns, clock.now_ns());
        if done.over {
            break;
        }
    }
    Ok(())
}

/// How a loop is run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Whose loop.
    pub role: Role,
    /// Ticks a second.
    pub rate_hz: u32,
    /// How early it wakes, to spin the rest.
    pub spin: Duration,
    /// What it asks of the system.
    pub privileges: Privileges,
    /// Whether to show the figures on stderr, every second.
    pub live: bool,
    /// Where the figures so far are found by others, ten times a second.
    pub shared: Shared,
    /// Who sees every row, from the clerk's thread.
    pub listener: Option<Listener>,
}

/// Sets on drop, whatever happens.
struct Raise<'a>(&'a AtomicBool);

impl Drop for Raise<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Runs a loop on this thread, with a clerk and a supervisor beside it, until
/// the task is over or `stop` is raised. Gives how it ended, and the figures.
///
/// `supervise` is called every 10 ms by the supervisor: the place for what may
/// take its time, such as looking after the peer.
pub fn run<T: Task>(
    options: &Options,
    task: &mut T,
    stop: &Stop,
    mut supervise: impl FnMut() + Send,
) -> (Result<(), T::Error>, Tally) {
    let Options { role, rate_hz, ref privileges, .. } = *options;
    let grid = Grid::of(role, rate_hz);
    let clock = Monotonic::new(options.spin, grid.tick_ns());
    let (mut log, rows) = Log::new(rate_hz);
    let clerk = Clerk::new(role, rate_hz, rows, options.shared.clone(), options.live)
        .with_listener(options.listener.clone());
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let raise = Raise(&over);
        // Before the privileges: helpers inherit none of them.
        let clerk = thread::Builder::new()
            .name("clerk".to_owned())
            .spawn_scoped(scope, || clerk.work(&over))
            .expect("a thread");
        thread::Builder::new()
            .name("supervisor".to_owned())
            .spawn_scoped(scope, || {
                while !over.load(Ordering::Acquire) {
                    supervise();
                    thread::sleep(LOOK);
                }
            })
            .expect("a thread");
        if let Some(warning) = privileges.take() {
            eprintln!("{role}: {warning}");
        }
        let ended = drive(&clock, grid, task, &mut log, stop);
        drop(raise);
        let mut tally = clerk.join().expect("a clerk that does not panic");
        tally.close(log.counters());
        (ended, tally)
    })
}
