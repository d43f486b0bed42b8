//! The loop under a simulated clock.

use std::cell::Cell;
use std::time::Duration;

use leg_control::wire::{Command, Header, Sample, flags};
use leg_process::Stop;

use super::*;
use crate::link::{ControllerLink, Link, LinkError, Role};
use crate::memory;

const TICK_NS: u64 = 1_000_000;

/// A clock that advances only by waits, by work, and by chosen delays.
#[derive(Default)]
struct SimulatedClock {
    now_ns: Cell<u64>,
    cpu_ns: Cell<u64>,
    /// Number of waits so far.
    waits: Cell<usize>,
    /// Delays after the instant waited for: number of the wait, ns.
    delays_ns: Vec<(usize, u64)>,
}

impl SimulatedClock {
    fn with_delays(delays_ns: &[(usize, u64)]) -> Self {
        let now_ns = Cell::new(TICK_NS / 2);
        Self { delays_ns: delays_ns.to_vec(), now_ns, ..Self::default() }
    }

    /// Advances the time, and the processor time if this thread was running.
    fn advance(&self, ns: u64, is_running: bool) {
        self.now_ns.set(self.now_ns.get() + ns);
        self.cpu_ns.set(self.cpu_ns.get() + if is_running { ns } else { 0 });
    }
}

impl Clock for SimulatedClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn wait_until_ns(&self, instant_ns: u64) {
        let wait = self.waits.replace(self.waits.get() + 1);
        let delay = self.delays_ns.iter().find(|(at, _)| *at == wait).map_or(0, |(_, ns)| *ns);
        self.now_ns.set(self.now_ns.get().max(instant_ns) + delay);
    }

    fn cpu_time_ns(&self) -> u64 {
        self.cpu_ns.get()
    }
}

/// A task that records its ticks and takes some time for some of them.
#[derive(Default)]
struct RecordingTask<'c> {
    ticks: Vec<Tick>,
    last: usize,
    clock: Option<&'c SimulatedClock>,
    /// Duration of some ticks: number, ns, whether the thread was running.
    work: Vec<(usize, u64, bool)>,
}

impl Task for RecordingTask<'_> {
    type Error = ();

    fn tick(&mut self, at: &Tick, _clock: &impl Clock) -> Result<TickResult, ()> {
        for (_, ns, is_running) in self.work.iter().filter(|(tick, ..)| *tick == self.ticks.len()) {
            self.clock.unwrap().advance(*ns, *is_running);
        }
        self.ticks.push(*at);
        let rx = if at.index.is_multiple_of(2) { RxStatus::New } else { RxStatus::Stale };
        Ok(TickResult { rx, over: self.ticks.len() == self.last, ..TickResult::default() })
    }
}

fn leg_schedule() -> TickSchedule {
    TickSchedule::of(Role::Leg, 1000)
}

#[test]
fn ticks_whose_period_passes_are_missed_and_the_schedule_stays() {
    // Wait 3 ends 2.3 ms late, wait 5 a fifth of a period.
    let clock = SimulatedClock::with_delays(&[(3, 2_300_000), (5, 200_000)]);
    let mut task = RecordingTask { last: 8, ..RecordingTask::default() };
    let (mut stats, mut records) = StatsWriter::new(1000);
    run_ticks(&clock, leg_schedule(), &mut task, &mut stats, &Stop::default()).unwrap();

    let indices: Vec<_> = task.ticks.iter().map(|tick| (tick.index, tick.missed)).collect();
    assert_eq!(indices, [(1, 0), (2, 0), (3, 0), (6, 2), (7, 0), (8, 0), (9, 0), (10, 0)]);
    assert_eq!(task.ticks[3].lateness_ns(), 2_300_000, "from the first due tick");
    assert_eq!(task.ticks[4].woke_ns, 7 * TICK_NS + TICK_NS / 4, "on the schedule again");
    let c = stats.counters();
    assert_eq!((c.ticks, c.missed, c.late, c.deadline_misses), (10, 2, 2, 0));
    assert_eq!(c.idle + c.received + c.stale + c.missed, c.ticks);
    assert_eq!(c.longest_gap_ns, 3_300_000);
    let mut last = TickStats::default();
    while let Ok(record) = records.pop() {
        last = record;
    }
    assert_eq!(last.counters, c, "every record carries all counters");
}

#[test]
fn an_own_overrun_is_distinguished_from_a_deadline_missed_by_the_machine() {
    let clock = SimulatedClock::with_delays(&[]);
    // In tick 2 the thread does not run for 1.5 ms; in tick 5 it computes that long.
    let work = vec![(2, 1_500_000, false), (5, 1_500_000, true)];
    let mut task = RecordingTask { last: 8, clock: Some(&clock), work, ..Default::default() };
    let (mut stats, _records) = StatsWriter::new(1000);
    run_ticks(&clock, leg_schedule(), &mut task, &mut stats, &Stop::default()).unwrap();
    let c = stats.counters();
    assert_eq!((c.deadline_misses, c.own_overruns, c.missed), (2, 1, 0));
    assert_eq!(task.ticks[3].lateness_ns(), 500_000, "the next tick starts immediately");
}

#[test]
fn a_full_ring_drops_records_and_keeps_the_counters() {
    let clock = SimulatedClock::with_delays(&[]);
    let mut task = RecordingTask { last: 250, ..RecordingTask::default() };
    let (mut stats, records) = StatsWriter::new(100);
    let schedule = TickSchedule::of(Role::Leg, 100);
    run_ticks(&clock, schedule, &mut task, &mut stats, &Stop::default()).unwrap();
    assert_eq!(records.slots(), 200, "two seconds");
    assert_eq!((stats.counters().ticks, stats.counters().dropped_records), (250, 50));
}

#[test]
fn a_loop_ends_when_stop_is_raised() {
    let stop = Stop::default();
    stop.raise();
    let mut task = RecordingTask { last: 8, ..RecordingTask::default() };
    let (mut stats, _records) = StatsWriter::new(1000);
    let clock = SimulatedClock::with_delays(&[]);
    run_ticks(&clock, leg_schedule(), &mut task, &mut stats, &stop).unwrap();
    assert_eq!(stats.counters().ticks, 0);
}

/// A control that records its calls.
#[derive(Default)]
struct RecordingControl {
    seqs: Vec<Option<u64>>,
    resets: usize,
}

impl Control for RecordingControl {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.seqs.push(sample.map(|sample| sample.header.seq));
        Command {
            header: sample.map(|sample| sample.header).unwrap_or_default(),
            ..Command::default()
        }
    }

    fn reset(&mut self) {
        self.resets += 1;
    }
}

fn sample(seq: u64, flags: u16) -> Sample {
    Sample { header: Header { flags, run_id: 1, seq, ..Header::default() }, ..Sample::default() }
}

/// Performs one tick of a controller.
fn tick<L: ControllerLink>(
    task: &mut ControllerTask<L, &mut RecordingControl>,
    at_ms: u64,
) -> TickResult {
    let now_ns = at_ms * TICK_NS + TICK_NS / 4 * 3;
    let clock = SimulatedClock { now_ns: Cell::new(now_ns), ..SimulatedClock::default() };
    let at = Tick { index: at_ms, due_ns: now_ns, woke_ns: now_ns, missed: 0 };
    task.tick(&at, &clock).unwrap()
}

#[test]
fn a_controller_uses_the_newest_sample_and_continues_without_one() {
    let (mut leg, end) = memory::pair();
    let mut control = RecordingControl::default();
    let mut task = ControllerTask::new(end, &mut control, 1000, ExitOn::StopSignal);
    assert_eq!(tick(&mut task, 1).rx, RxStatus::Idle, "before the first sample it sends nothing");
    assert_eq!(leg.receive(Duration::ZERO), Ok(None));

    leg.send(&sample(0, 0)).unwrap();
    let result = tick(&mut task, 2);
    assert_eq!((result.rx, result.sample_age_ns), (RxStatus::New, Some(TICK_NS / 2)));
    for seq in 1..4 {
        leg.send(&sample(seq, 0)).unwrap();
    }
    assert_eq!(tick(&mut task, 5).sample_age_ns, Some(TICK_NS / 2), "the newest of three");
    assert_eq!(leg.receive(Duration::ZERO).unwrap().unwrap().header.seq, 3);
    assert_eq!(tick(&mut task, 6).rx, RxStatus::Stale);
    assert!(leg.receive(Duration::ZERO).unwrap().is_some(), "it sends a command all the same");

    leg.send(&sample(4, flags::END)).unwrap();
    assert_eq!(tick(&mut task, 7).rx, RxStatus::EndOfRun);
    assert_eq!(tick(&mut task, 8).rx, RxStatus::Idle, "between two runs");
    leg.send(&sample(0, 0)).unwrap();
    assert_eq!(tick(&mut task, 9).rx, RxStatus::New, "the next run");
    assert_eq!(task.samples(), 3);
    drop(task);
    assert_eq!(control.seqs, [Some(0), Some(3), None, Some(0)]);
    assert_eq!(control.resets, 1);
}

#[test]
fn a_controller_for_one_run_ends_with_the_run_and_when_the_leg_leaves() {
    let (mut leg, end) = memory::pair();
    let mut control = RecordingControl::default();
    let mut task = ControllerTask::new(end, &mut control, 1000, ExitOn::EndOfRun);
    leg.send(&sample(0, flags::END)).unwrap();
    assert!(tick(&mut task, 1).over);
    drop(leg);
    let at = Tick { index: 0, due_ns: 0, woke_ns: 0, missed: 0 };
    let left = task.tick(&at, &SimulatedClock::default());
    assert!(matches!(left, Err(LinkError::PeerLeft { .. })));
}

#[test]
fn the_report_has_the_quantiles_of_the_records() {
    let mut stats = LoopStats::new(Role::Controller, 1000);
    for i in 1..=1000 {
        stats.add(&TickStats {
            woke_ns: i * TICK_NS,
            lateness_ns: i * 1000,
            work_ns: 3000,
            sample_age_ns: (i % 2 == 0).then_some(500_000),
            ..TickStats::default()
        });
    }
    let report = stats.report();
    let near = |got: f64, want: f64| (got - want).abs() <= 0.002 * want;
    let late = report.lateness_us;
    assert!(near(late.p50, 500.0) && near(late.p90, 900.0) && near(late.p99, 990.0), "{late:?}");
    assert!(near(late.p99_9, 999.0) && near(late.max, 1000.0), "{late:?}");
    assert_eq!(
        (late.count, report.sample_age_us.count, report.round_trip_us.count),
        (1000, 500, 0)
    );
    assert!(near(report.time_s, 0.999), "{}", report.time_s);
    let binned: u64 = report.lateness_histogram.iter().map(|bin| bin.ticks).sum();
    assert_eq!(binned, 1000, "{:?}", report.lateness_histogram);

    let text = report.to_string();
    for part in ["the controller's loop", "wake-up lateness", "500 us", "1.00 ms"] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
    assert!(!text.contains("sample to command"), "there are no measurements:\n{text}");
    let json = serde_json::to_value(&report).unwrap();
    for key in ["ticks", "missed", "stale", "lateness_us", "sample_age_us", "own_overruns"] {
        assert!(!json[key].is_null(), "`{key}` is missing in {json}");
    }
    let back: LoopReport = serde_json::from_value(json).unwrap();
    assert_eq!(back, report);
}
