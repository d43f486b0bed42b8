//! The loop by a clock that does what it is told.

use std::cell::Cell;
use std::time::Duration;

use super::super::link::{Link, LinkError};
use super::*;
use crate::{Role, memory};
use leg_control::wire::{Command, Header, Sample, flags};
use leg_process::Stop;

const TICK_NS: u64 = 1_000_000;

/// A clock that stands still but for what is waited, worked, and overslept.
#[derive(Default)]
struct Told {
    now_ns: Cell<u64>,
    own_ns: Cell<u64>,
    /// Waits so far, and which of them end how late, ns.
    waits: Cell<usize>,
    late_ns: Vec<(usize, u64)>,
}

impl Told {
    fn late(late_ns: &[(usize, u64)]) -> Self {
        Self { late_ns: late_ns.to_vec(), now_ns: Cell::new(TICK_NS / 2), ..Self::default() }
    }

    /// Time passes: that of work, or of a machine that does something else.
    fn pass(&self, ns: u64, is_own: bool) {
        self.now_ns.set(self.now_ns.get() + ns);
        self.own_ns.set(self.own_ns.get() + if is_own { ns } else { 0 });
    }
}

impl Clock for Told {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn wait_until_ns(&self, instant_ns: u64) {
        let wait = self.waits.replace(self.waits.get() + 1);
        let late = self.late_ns.iter().find(|(at, _)| *at == wait).map_or(0, |(_, ns)| *ns);
        self.now_ns.set(self.now_ns.get().max(instant_ns) + late);
    }

    fn own_ns(&self) -> u64 {
        self.own_ns.get()
    }
}

/// A task of so many ticks, that takes some time for some of them.
#[derive(Default)]
struct Worker<'c> {
    ticks: Vec<Tick>,
    last: usize,
    clock: Option<&'c Told>,
    /// In which tick, how long, and whether that is its own doing.
    work: Vec<(usize, u64, bool)>,
}

impl Task for Worker<'_> {
    type Error = ();

    fn tick(&mut self, at: &Tick, _clock: &impl Clock) -> Result<Done, ()> {
        for (_, ns, is_own) in self.work.iter().filter(|(tick, ..)| *tick == self.ticks.len()) {
            self.clock.unwrap().pass(*ns, *is_own);
        }
        self.ticks.push(*at);
        let word = if at.index.is_multiple_of(2) { Word::New } else { Word::Stale };
        Ok(Done { word, over: self.ticks.len() == self.last, ..Done::default() })
    }
}

fn leg_grid() -> Grid {
    Grid::of(Role::Leg, 1000)
}

#[test]
fn what_is_slept_through_is_missed_and_the_grid_stays() {
    // Wait 3 ends 2.3 ms late, wait 5 a fifth of a tick.
    let clock = Told::late(&[(3, 2_300_000), (5, 200_000)]);
    let mut worker = Worker { last: 8, ..Worker::default() };
    let (mut log, mut rows) = Log::new(1000);
    drive(&clock, leg_grid(), &mut worker, &mut log, &Stop::default()).unwrap();

    let indices: Vec<_> = worker.ticks.iter().map(|tick| (tick.index, tick.missed)).collect();
    assert_eq!(indices, [(1, 0), (2, 0), (3, 0), (6, 2), (7, 0), (8, 0), (9, 0), (10, 0)]);
    assert_eq!(worker.ticks[3].lateness_ns(), 2_300_000, "late for the first that was due");
    assert_eq!(worker.ticks[4].woke_ns, 7 * TICK_NS + TICK_NS / 4, "on the grid again");
    let c = log.counters();
    assert_eq!((c.ticks, c.missed, c.late, c.deadline_misses), (10, 2, 2, 0));
    assert_eq!(c.idle + c.heard + c.stale + c.missed, c.ticks);
    assert_eq!(c.longest_gap_ns, 3_300_000);
    let mut last = Row::default();
    while let Ok(row) = rows.pop() {
        last = row;
    }
    assert_eq!(last.counters, c, "every row carries all counts");
}

#[test]
fn a_tick_that_ends_too_late_has_missed_its_deadline_and_the_cause_is_told() {
    let clock = Told::late(&[]);
    // Once the machine takes 1.5 ms away, once the tick itself works that long.
    let work = vec![(2, 1_500_000, false), (5, 1_500_000, true)];
    let mut worker = Worker { last: 8, clock: Some(&clock), work, ..Worker::default() };
    let (mut log, _rows) = Log::new(1000);
    drive(&clock, leg_grid(), &mut worker, &mut log, &Stop::default()).unwrap();
    let c = log.counters();
    assert_eq!((c.deadline_misses, c.own_overruns, c.missed), (2, 1, 0));
    assert_eq!(worker.ticks[3].lateness_ns(), 500_000, "the next begins at once");
}

#[test]
fn a_full_ring_costs_rows_and_no_counts() {
    let clock = Told::late(&[]);
    let mut worker = Worker { last: 250, ..Worker::default() };
    let (mut log, rows) = Log::new(100);
    drive(&clock, Grid::of(Role::Leg, 100), &mut worker, &mut log, &Stop::default()).unwrap();
    assert_eq!(rows.slots(), 200, "two seconds");
    assert_eq!((log.counters().ticks, log.counters().dropped_rows), (250, 50));
}

#[test]
fn a_loop_ends_when_it_is_told_to() {
    let stop = Stop::default();
    stop.raise();
    let mut worker = Worker { last: 8, ..Worker::default() };
    let (mut log, _rows) = Log::new(1000);
    drive(&Told::late(&[]), leg_grid(), &mut worker, &mut log, &stop).unwrap();
    assert_eq!(log.counters().ticks, 0);
}

/// A law that remembers what it was asked.
#[derive(Default)]
struct Asked {
    seqs: Vec<Option<u64>>,
    rests: usize,
}

impl Law for Asked {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.seqs.push(sample.map(|sample| sample.header.seq));
        Command {
            header: sample.map(|sample| sample.header).unwrap_or_default(),
            ..Command::default()
        }
    }

    fn rest(&mut self) {
        self.rests += 1;
    }
}

fn sample(seq: u64, flags: u16) -> Sample {
    Sample { header: Header { flags, run_id: 1, seq, ..Header::default() }, ..Sample::default() }
}

/// Plays one tick of a controller.
fn tick<L: super::super::ControllerLink>(
    task: &mut ControllerTask<L, &mut Asked>,
    at_ms: u64,
) -> Done {
    let clock = Told { now_ns: Cell::new(at_ms * TICK_NS + TICK_NS / 4 * 3), ..Told::default() };
    let now_ns = clock.now_ns();
    let at = Tick { index: at_ms, due_ns: now_ns, woke_ns: now_ns, missed: 0 };
    task.tick(&at, &clock).unwrap()
}

#[test]
fn a_controller_goes_by_the_newest_sample_and_continues_without() {
    let (mut leg, end) = memory::pair();
    let mut law = Asked::default();
    let mut task = ControllerTask::new(end, &mut law, 1000, Ends::Never);
    assert_eq!(tick(&mut task, 1).word, Word::Idle, "before the first sample it says nothing");
    assert_eq!(leg.receive(Duration::ZERO), Ok(None));

    leg.send(&sample(0, 0)).unwrap();
    let done = tick(&mut task, 2);
    assert_eq!((done.word, done.sample_age_ns), (Word::New, Some(TICK_NS / 2)));
    for seq in 1..4 {
        leg.send(&sample(seq, 0)).unwrap();
    }
    assert_eq!(tick(&mut task, 5).sample_age_ns, Some(TICK_NS / 2), "of three, the newest");
    assert_eq!(leg.receive(Duration::ZERO).unwrap().unwrap().header.seq, 3);
    assert_eq!(tick(&mut task, 6).word, Word::Stale);
    assert!(leg.receive(Duration::ZERO).unwrap().is_some(), "it goes on commanding");

    leg.send(&sample(4, flags::END)).unwrap();
    assert_eq!(tick(&mut task, 7).word, Word::Farewell);
    assert_eq!(tick(&mut task, 8).word, Word::Idle, "between two runs");
    leg.send(&sample(0, 0)).unwrap();
    assert_eq!(tick(&mut task, 9).word, Word::New, "the next run");
    assert_eq!(task.samples(), 3);
    drop(task);
    assert_eq!(law.seqs, [Some(0), Some(3), None, Some(0)]);
    assert_eq!(law.rests, 1);
}

#[test]
fn a_controller_for_one_run_ends_at_its_farewell_and_when_the_leg_leaves() {
    let (mut leg, end) = memory::pair();
    let mut law = Asked::default();
    let mut task = ControllerTask::new(end, &mut law, 1000, Ends::AtFarewell);
    leg.send(&sample(0, flags::END)).unwrap();
    assert!(tick(&mut task, 1).over);
    drop(leg);
    let at = Tick { index: 0, due_ns: 0, woke_ns: 0, missed: 0 };
    let left = task.tick(&at, &Told::default());
    assert!(matches!(left, Err(LinkError::PeerLeft { .. })));
}

#[test]
fn the_figures_are_those_of_the_rows() {
    let mut tally = Tally::new(Role::Controller, 1000);
    for i in 1..=1000 {
        tally.take(&Row {
            woke_ns: i * TICK_NS,
            lateness_ns: i * 1000,
            work_ns: 3000,
            sample_age_ns: (i % 2 == 0).then_some(500_000),
            ..Row::default()
        });
    }
    let report = tally.report();
    let near = |got: f64, want: f64| (got - want).abs() <= 0.002 * want;
    let late = report.lateness_us;
    assert!(near(late.p50, 500.0) && near(late.p90, 900.0) && near(late.p99, 990.0), "{late:?}");
    assert!(near(late.p99_9, 999.0) && near(late.max, 1000.0), "{late:?}");
    assert_eq!(
        (late.count, report.sample_age_us.count, report.round_trip_us.count),
        (1000, 500, 0)
    );
    assert!(near(report.time_s, 0.999), "{}", report.time_s);
    let bars: u64 = report.lateness_histogram.iter().map(|bar| bar.ticks).sum();
    assert_eq!(bars, 1000, "{:?}", report.lateness_histogram);

    let text = report.to_string();
    for part in ["the controller's loop", "wake-up lateness", "500 us", "1.00 ms"] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    assert!(!text.contains("sample to command"), "nothing was measured:\n{text}");
    let json = serde_json::to_value(&report).unwrap();
    for key in ["ticks", "missed", "stale", "lateness_us", "sample_age_us", "own_overruns"] {
        assert!(!json[key].is_null(), "{key} is not in {json}");
    }
    let back: LoopReport = serde_json::from_value(json).unwrap();
    assert_eq!(back, report);
}
