//! The thread that turns a loop's tick records into statistics and messages.

use std::fmt;
use std::io::{IsTerminal, Write, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rtrb::Consumer;

use super::loop_stats::LoopStats;
use super::report::LoopReport;
use super::tick_stats::TickStats;
use super::transitions::Transitions;
use crate::link::Role;

/// Interval at which the ring of records is read.
const READ_INTERVAL: Duration = Duration::from_millis(10);
/// Interval at which the latest report is published.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(100);
/// Interval of the live status line.
const LIVE_INTERVAL: Duration = Duration::from_secs(1);

/// The latest report of a running loop, readable from any thread. The statistics
/// thread updates it ten times a second; the loop never accesses it. Clones share one
/// report.
#[derive(Clone, Debug, Default)]
pub struct LatestReport(Arc<Mutex<LoopReport>>);

impl LatestReport {
    /// Returns the latest report.
    #[must_use]
    pub fn get(&self) -> LoopReport {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, report: LoopReport) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}

/// An observer of every tick record, such as a recorder.
///
/// It is called on the statistics thread. It may block, but not for long: the ring
/// holds the records of two seconds.
#[derive(Clone)]
pub struct TickObserver(Arc<dyn Fn(&TickStats) + Send + Sync>);

impl TickObserver {
    /// Creates an observer that calls `observe` with every record.
    pub fn new(observe: impl Fn(&TickStats) + Send + Sync + 'static) -> Self {
        Self(Arc::new(observe))
    }
}

impl fmt::Debug for TickObserver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TickObserver")
    }
}

/// The work of the statistics thread.
#[derive(Debug)]
pub struct StatsThread {
    role: Role,
    records: Consumer<TickStats>,
    stats: LoopStats,
    latest_report: LatestReport,
    transitions: Transitions,
    live: bool,
    observer: Option<TickObserver>,
}

impl StatsThread {
    /// Creates the work for the records of the loop of `role`. With `live`, it prints a
    /// status line on stderr every second.
    #[must_use]
    pub fn new(
        role: Role,
        rate_hz: u32,
        records: Consumer<TickStats>,
        latest_report: LatestReport,
        live: bool,
    ) -> Self {
        Self {
            role,
            records,
            stats: LoopStats::new(role, rate_hz),
            latest_report,
            transitions: Transitions::new(role, rate_hz),
            live,
            observer: None,
        }
    }

    /// Returns the same work for a peer whose messages count for nothing from this age on, ns.
    #[must_use]
    pub fn with_stale_limit(self, stale_limit_ns: u64) -> Self {
        Self { transitions: self.transitions.with_stale_limit(stale_limit_ns), ..self }
    }

    /// Returns the same work with an observer of every record.
    #[must_use]
    pub fn with_observer(self, observer: Option<TickObserver>) -> Self {
        Self { observer, ..self }
    }

    /// Processes records until `over` is set and all records are read. Returns the
    /// statistics.
    pub fn run(mut self, over: &AtomicBool) -> LoopStats {
        let in_place = self.live && stderr().is_terminal();
        let (mut published, mut shown) = (Instant::now(), Instant::now());
        loop {
            // Read the flag before the ring: no record is written after it is set.
            let last = over.load(Ordering::Acquire);
            while let Ok(tick) = self.records.pop() {
                self.stats.add(&tick);
                if let Some(TickObserver(observe)) = &self.observer {
                    observe(&tick);
                }
                if let Some(message) = self.transitions.update(&tick) {
                    print_error_line(in_place, &format!("{}: {message}\n", self.role));
                }
            }
            if last || published.elapsed() >= PUBLISH_INTERVAL {
                published = Instant::now();
                let report = self.stats.report();
                if self.live && (last || shown.elapsed() >= LIVE_INTERVAL) {
                    shown = Instant::now();
                    print_error_line(in_place, &report.line());
                    if last || !in_place {
                        print_error_line(false, "\n");
                    }
                }
                self.latest_report.set(report);
            }
            if last {
                return self.stats;
            }
            thread::sleep(READ_INTERVAL);
        }
    }
}

/// Prints on stderr, with `in_place` over the live status line.
fn print_error_line(in_place: bool, text: &str) {
    let mut stderr = stderr().lock();
    let clear = if in_place { "\r\x1b[2K" } else { "" };
    // A closed stderr must not end the loop.
    let _ = write!(stderr, "{clear}{text}").and_then(|()| stderr.flush());
}
