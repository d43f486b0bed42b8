//! Retransmission of a message until it is answered.

use std::time::{Duration, Instant};

/// Interval before any round trip is known: an emulator answers in 1 ms, a board at
/// 115,200 baud in 10.
const FIRST: Duration = Duration::from_millis(20);
/// Shortest interval: the system may suspend a process for as long.
const SOONEST: Duration = Duration::from_micros(250);
/// Longest interval: within it a controller that was away is back in the run.
const LATEST: Duration = Duration::from_millis(250);
/// Tries at the same interval, against noise; after them the interval grows, for a controller
/// that is busy or gone.
const EVEN_TRIES: u32 = 8;
/// A round trip longer than this multiple of the smoothed one counts as this multiple.
const OUTLIER: u32 = 4;

/// Deviations added to the smoothed round trip. Not four, as RFC 6298 has it for shared
/// networks: the line has one user, a needless retransmission costs it a millisecond, and in
/// noise each wait is lost time.
const SPREADS: u32 = 2;

/// The retransmission interval, estimated from round trips (Jacobson and Karels, RFC 6298).
#[derive(Clone, Copy, Debug)]
pub(super) struct RetransmitTimer {
    smooth: Option<Duration>,
    spread: Duration,
    interval: Duration,
}

impl RetransmitTimer {
    pub(super) const fn new() -> Self {
        Self { smooth: None, spread: Duration::ZERO, interval: FIRST }
    }

    /// Updates the estimate with the round trip of a message that was answered just now.
    /// Karn's rule: a retransmitted message gives no round trip, because it is unknown which
    /// transmission was answered. Before the first round trip it only raises the interval.
    fn learn(&mut self, answered: &Pending) {
        if !answered.was_retransmitted() {
            self.learn_round_trip(answered.age());
        } else if self.smooth.is_none() {
            self.interval = answered.interval;
        }
    }

    /// Updates the estimate after a second answer to a retransmitted message: the first answer
    /// belonged to the transmission before the last, at least `took` earlier, so the
    /// retransmission came too soon.
    pub(super) fn was_too_soon(&mut self, took: Duration) {
        self.learn_round_trip(took);
    }

    fn learn_round_trip(&mut self, took: Duration) {
        let smooth = self.smooth.unwrap_or(took);
        // A single outlier, as when this process was suspended, counts for less.
        let took = took.min(smooth * OUTLIER);
        let spread = if self.smooth.is_some() { self.spread } else { took / 2 };
        self.spread = (spread * 3 + smooth.abs_diff(took)) / 4;
        let smooth = (smooth * 7 + took) / 8;
        self.smooth = Some(smooth);
        self.interval = (smooth + SPREADS * self.spread).clamp(SOONEST, LATEST);
    }
}

/// A message that was transmitted more than once and answered once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answered {
    pub(super) number: u32,
    /// Time from the transmission before the last to the answer.
    pub(super) took: Duration,
}

/// A message that has not been answered.
#[derive(Clone, Debug)]
pub(super) struct Pending {
    pub(super) number: u32,
    pub(super) frame: Vec<u8>,
    first: Instant,
    last: Instant,
    /// When the transmission before the last took place.
    previous: Instant,
    interval: Duration,
    /// No answer can arrive sooner after the last transmission.
    soonest: Duration,
    tries: u32,
    /// The tries that followed a silence.
    silences: u32,
}

impl Pending {
    /// Returns a message that is transmitted for the first time now.
    pub(super) fn new(number: u32, frame: Vec<u8>, timer: &RetransmitTimer) -> Self {
        let now = Instant::now();
        let soonest = timer.smooth.unwrap_or_default() / 2;
        let interval = timer.interval;
        Self {
            number,
            frame,
            first: now,
            last: now,
            previous: now,
            interval,
            soonest,
            tries: 1,
            silences: 0,
        }
    }

    /// Returns the time until the next transmission.
    pub(super) fn wait(&self) -> Duration {
        self.interval.saturating_sub(self.last.elapsed())
    }

    /// Records a retransmission after no answer in time.
    pub(super) fn retransmit_after_timeout(&mut self) {
        self.silences += 1;
        if self.silences > EVEN_TRIES {
            self.interval = LATEST.min(self.interval * 2);
        }
        self.retransmit();
    }

    /// Records a retransmission.
    pub(super) fn retransmit(&mut self) {
        self.tries += 1;
        self.previous = std::mem::replace(&mut self.last, Instant::now());
    }

    /// Returns whether a frame that arrives now may be its answer.
    pub(super) fn may_be_answered(&self) -> bool {
        self.last.elapsed() >= self.soonest
    }

    /// Returns whether it was transmitted more than once.
    fn was_retransmitted(&self) -> bool {
        self.tries > 1
    }

    /// Returns the time since the first transmission.
    pub(super) fn age(&self) -> Duration {
        self.first.elapsed()
    }

    /// Records the answer; returns the message if it may be answered once more.
    pub(super) fn answered(&self, timer: &mut RetransmitTimer) -> Option<Answered> {
        timer.learn(self);
        self.was_retransmitted()
            .then(|| Answered { number: self.number, took: self.previous.elapsed() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waited(tries: u32, took: Duration) -> Pending {
        let first = Instant::now().checked_sub(took).unwrap();
        Pending { first, tries, ..Pending::new(1, Vec::new(), &RetransmitTimer::new()) }
    }

    #[test]
    fn the_interval_follows_the_round_trip() {
        let mut timer = RetransmitTimer::new();
        assert_eq!(timer.interval, FIRST);
        for _ in 0..100 {
            waited(1, Duration::from_millis(10)).answered(&mut timer);
        }
        let ms = timer.interval.as_secs_f64() * 1e3;
        assert!((10.0..13.0).contains(&ms), "{ms}");
        for _ in 0..100 {
            waited(1, Duration::from_micros(50)).answered(&mut timer);
        }
        assert_eq!(timer.interval, SOONEST);
        for _ in 0..100 {
            waited(1, Duration::from_secs(1)).answered(&mut timer);
        }
        assert_eq!(timer.interval, LATEST);
    }

    #[test]
    fn the_interval_stays_in_noise_and_grows_in_silence() {
        let mut pending = Pending::new(1, Vec::new(), &RetransmitTimer::new());
        let intervals: Vec<_> = (0..14)
            .map(|_| {
                pending.retransmit_after_timeout();
                pending.interval
            })
            .collect();
        assert!(intervals[..8].iter().all(|interval| *interval == FIRST), "{intervals:?}");
        assert!(intervals[7..11].is_sorted_by(|a, b| a < b), "{intervals:?}");
        assert_eq!(intervals[13], LATEST);
        // Only the first message of all raises the interval; later ones do not.
        let mut timer = RetransmitTimer::new();
        pending.answered(&mut timer);
        assert_eq!((timer.interval, timer.smooth), (LATEST, None));
        waited(1, Duration::from_millis(10)).answered(&mut timer);
        let learnt = timer.interval;
        pending.answered(&mut timer);
        assert_eq!(timer.interval, learnt);
    }

    #[test]
    fn a_repeated_answer_raises_the_interval() {
        let mut timer = RetransmitTimer::new();
        for _ in 0..100 {
            waited(1, Duration::from_micros(50)).answered(&mut timer);
        }
        assert_eq!(timer.interval, SOONEST);
        // Answers take 5 ms now, and what is retransmitted after 0.25 ms is answered twice.
        let took = Duration::from_millis(5);
        let mut too_soon = 0;
        while timer.interval < took {
            timer.was_too_soon(took);
            too_soon += 1;
        }
        assert!(too_soon < 20, "{too_soon}");
        // A single stall changes little.
        let before = timer.interval;
        timer.was_too_soon(Duration::from_secs(1));
        assert!(timer.interval < before * 3, "{:?}", timer.interval);
    }
}
