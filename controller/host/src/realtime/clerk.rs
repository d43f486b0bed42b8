//! The clerk: a thread beside the loop that makes figures and messages of its rows.

use std::fmt;
use std::io::{IsTerminal, Write, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rtrb::Consumer;

use super::super::card::Role;
use super::report::LoopReport;
use super::row::{Row, Word};
use super::tally::Tally;

/// The figures of a running loop, for whoever asks: the clerk brings them up to
/// date some ten times a second, the loop never touches them. Clones show the same.
#[derive(Clone, Debug, Default)]
pub struct Shared(Arc<Mutex<LoopReport>>);

impl Shared {
    /// As they stand.
    #[must_use]
    pub fn newest(&self) -> LoopReport {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn put(&self, report: LoopReport) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}

/// Between two rounds.
const ROUND: Duration = Duration::from_millis(10);
/// Between two fresh reports for others.
const REPORT: Duration = Duration::from_millis(100);
/// Between two live lines.
const LIVE: Duration = Duration::from_secs(1);
/// Ticks of silence after which a peer is said to be lost: when either side
/// takes its safe command.
const LOST_AFTER_TICKS: u64 = 10;

/// Sees every row of a loop: a recorder does. Called by the clerk, so it may
/// take its time, though not for long: rows wait for two seconds.
#[derive(Clone)]
pub struct Listener(Arc<dyn Fn(&Row) + Send + Sync>);

impl Listener {
    /// Calls a function with every row.
    pub fn new(hear: impl Fn(&Row) + Send + Sync + 'static) -> Self {
        Self(Arc::new(hear))
    }
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Listener")
    }
}

/// The thread's work.
#[derive(Debug)]
pub struct Clerk {
    rows: Consumer<Row>,
    tally: Tally,
    shared: Shared,
    watch: Watch,
    live: bool,
    listener: Option<Listener>,
}

impl Clerk {
    /// A clerk for the rows of a loop.
    #[must_use]
    pub fn new(role: Role, rate_hz: u32, rows: Consumer<Row>, shared: Shared, live: bool) -> Self {
        Self {
            rows,
            tally: Tally::new(role, rate_hz),
            shared,
            watch: Watch::new(role, rate_hz),
            live,
            listener: None,
        }
    }

    /// The same, with somebody who sees every row.
    #[must_use]
    pub fn with_listener(self, listener: Option<Listener>) -> Self {
        Self { listener, ..self }
    }

    /// Works until the loop is over and its last row is read.
    pub fn work(mut self, over: &AtomicBool) -> Tally {
        let in_place = self.live && stderr().is_terminal();
        let (mut reported, mut shown) = (Instant::now(), Instant::now());
        loop {
            // Looked at first, so that nothing is written after the last look at the rows.
            let last = over.load(Ordering::Acquire);
            while let Ok(row) = self.rows.pop() {
                self.tally.take(&row);
                if let Some(Listener(hear)) = &self.listener {
                    hear(&row);
                }
                if let Some(message) = self.watch.hear(&row) {
                    say(in_place, &format!("{}: {message}\n", self.watch.role));
                }
            }
            if last || reported.elapsed() >= REPORT {
                reported = Instant::now();
                let report = self.tally.report();
                if self.live && (last || shown.elapsed() >= LIVE) {
                    shown = Instant::now();
                    say(in_place, &report.line());
                    if last || !in_place {
                        say(false, "\n");
                    }
                }
                self.shared.put(report);
            }
            if last {
                return self.tally;
            }
            thread::sleep(ROUND);
        }
    }
}

/// Writes on stderr; in the place of the live line, if there is one.
fn say(in_place: bool, text: &str) {
    let mut stderr = stderr().lock();
    let clear = if in_place { "\r\x1b[2K" } else { "" };
    // A closed stderr is no reason to end the loop.
    let _ = write!(stderr, "{clear}{text}").and_then(|()| stderr.flush());
}

/// How a peer went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Gone {
    /// It fell silent.
    Silent,
    /// It said that its run is over.
    Parted,
}

/// Notices, in the rows, what a person should be told, once each.
#[derive(Debug)]
struct Watch {
    role: Role,
    tick_ns: u64,
    run_id: u32,
    /// When the peer was last heard.
    heard_ns: Option<u64>,
    /// Ticks since then.
    stale_ticks: u64,
    /// How it went, if it did; told.
    gone: Option<Gone>,
    /// Whether the leg was under a command other than the safe one in this run.
    was_flying: bool,
    /// Since when a safe command is in force though the peer is heard; told.
    safe_since_ns: Option<u64>,
}

impl Watch {
    fn new(role: Role, rate_hz: u32) -> Self {
        Self {
            role,
            tick_ns: 1_000_000_000 / u64::from(rate_hz.max(1)),
            run_id: 0,
            heard_ns: None,
            stale_ticks: 0,
            gone: None,
            was_flying: false,
            safe_since_ns: None,
        }
    }

    fn hear(&mut self, row: &Row) -> Option<String> {
        let peer = match self.role {
            Role::Leg => Role::Controller,
            Role::Controller => Role::Leg,
        };
        match row.word {
            Word::Farewell => {
                (self.gone, self.heard_ns) = (Some(Gone::Parted), Some(row.woke_ns));
                (self.was_flying, self.safe_since_ns) = (false, None);
                Some(format!("the run of the {peer} is over: safe until the next begins"))
            }
            // What comes after a farewell.
            Word::Idle if self.gone == Some(Gone::Parted) => None,
            Word::Idle => {
                (self.heard_ns, self.was_flying, self.safe_since_ns) = (None, false, None);
                self.gone.take().map(|_| format!("the run of the {peer} is over"))
            }
            Word::Stale => {
                let silent_ns = row.woke_ns.saturating_sub(self.heard_ns?);
                self.stale_ticks += 1;
                let is_lost = row.safe && silent_ns >= LOST_AFTER_TICKS * self.tick_ns;
                (is_lost && self.gone.is_none()).then(|| {
                    self.gone = Some(Gone::Silent);
                    (self.was_flying, self.safe_since_ns) = (false, None);
                    let ms = 1e-6 * silent_ns as f64;
                    let ticks = self.stale_ticks;
                    format!(
                        "nothing from the {peer} for {ms:.0} ms, {ticks} ticks: safe until it is \
                         heard again"
                    )
                })
            }
            Word::New => {
                let before_ns = self.heard_ns.replace(row.woke_ns);
                self.stale_ticks = 0;
                if row.run_id != self.run_id {
                    (self.run_id, self.was_flying, self.safe_since_ns) = (row.run_id, false, None);
                }
                if self.gone.take().is_some() {
                    let silent_ns = row.woke_ns - before_ns.unwrap_or(row.woke_ns);
                    let s = 1e-9 * silent_ns as f64;
                    return Some(format!("the {peer} is heard again, after {s:.3} s"));
                }
                self.judge(row)
            }
        }
    }

    /// The peer is heard, but is it of use? That is for the controller's guard to tell.
    fn judge(&mut self, row: &Row) -> Option<String> {
        if self.role != Role::Controller {
            return None;
        }
        match (row.safe, self.safe_since_ns) {
            (true, None) if self.was_flying => {
                self.safe_since_ns = Some(row.woke_ns);
                let peer = Role::Leg;
                Some(format!("the samples of the {peer} are rejected: safe until good ones come"))
            }
            (false, since_ns) => {
                (self.was_flying, self.safe_since_ns) = (true, None);
                since_ns.map(|since_ns| {
                    let s = 1e-9 * (row.woke_ns - since_ns) as f64;
                    format!("good samples again, after {s:.3} s")
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hear(watch: &mut Watch, ms: u64, word: Word, safe: bool) -> Option<String> {
        watch.hear(&Row { woke_ns: ms * 1_000_000, word, safe, ..Row::default() })
    }

    #[test]
    fn a_peer_is_said_to_be_lost_once_and_to_be_back_once() {
        let mut watch = Watch::new(Role::Leg, 1000);
        for ms in 0..30 {
            assert_eq!(hear(&mut watch, ms, Word::Idle, true), None, "nobody was there yet");
        }
        assert_eq!(hear(&mut watch, 30, Word::New, false), None);
        let said: Vec<_> =
            (31..100).filter_map(|ms| hear(&mut watch, ms, Word::Stale, ms >= 40)).collect();
        assert_eq!(
            said,
            ["nothing from the controller for 10 ms, 10 ticks: safe until it is heard again"]
        );
        let said: Vec<_> =
            (100..200).filter_map(|ms| hear(&mut watch, ms, Word::New, false)).collect();
        assert_eq!(said, ["the controller is heard again, after 0.070 s"]);
    }

    #[test]
    fn a_farewell_is_told_once_and_so_is_the_next_run() {
        let mut watch = Watch::new(Role::Controller, 1000);
        let mut said = Vec::new();
        for ms in 0..100 {
            said.extend(hear(&mut watch, ms, Word::New, false));
        }
        said.extend(hear(&mut watch, 100, Word::Farewell, false));
        for ms in 101..300 {
            said.extend(hear(&mut watch, ms, Word::Idle, false));
        }
        for ms in 300..400 {
            said.extend(hear(&mut watch, ms, Word::New, false));
        }
        assert_eq!(
            said,
            [
                "the run of the simulator is over: safe until the next begins",
                "the simulator is heard again, after 0.200 s"
            ]
        );
    }

    #[test]
    fn a_controller_says_once_that_its_guard_has_taken_over() {
        let mut watch = Watch::new(Role::Controller, 1000);
        let mut said = Vec::new();
        for ms in 0..300 {
            let safe = ms < 8 || (100..150).contains(&ms);
            said.extend(hear(&mut watch, ms, Word::New, safe));
        }
        assert_eq!(
            said,
            [
                "the samples of the simulator are rejected: safe until good ones come",
                "good samples again, after 0.050 s"
            ],
            "but not of the start, before the medium is known"
        );
    }
}
