//! Saying a message again until it is answered.

use std::time::{Duration, Instant};

/// Before anything is known of the line: an emulator answers in 1 ms, a board
/// at 115,200 baud in 10.
const FIRST: Duration = Duration::from_millis(20);
/// Soonest: a process on this machine may be away for as long.
const SOONEST: Duration = Duration::from_micros(500);
/// Latest: a controller that was away is back in the run so soon.
const LATEST: Duration = Duration::from_millis(250);
/// So many times at the same interval, for noise; then at growing ones, for a
/// controller that is busy or gone.
const EVEN_TRIES: u32 = 6;

/// When to say a message again: learnt from the round trips, after Jacobson
/// and Karels (RFC 6298).
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    smooth: Option<Duration>,
    spread: Duration,
    interval: Duration,
}

impl Pace {
    pub(super) const fn new() -> Self {
        Self { smooth: None, spread: Duration::ZERO, interval: FIRST }
    }

    /// Learns from a message that was answered: by its round trip when it was
    /// said once. Said again, nobody knows which saying was answered; then the
    /// interval stays as it has grown (Karn).
    fn learn(&mut self, answered: &Pending) {
        if answered.tries > 1 {
            self.interval = answered.interval;
            return;
        }
        let took = answered.first.elapsed();
        let smooth = self.smooth.unwrap_or(took);
        let spread = if self.smooth.is_some() { self.spread } else { took / 2 };
        self.spread = (spread * 3 + smooth.abs_diff(took)) / 4;
        let smooth = (smooth * 7 + took) / 8;
        self.smooth = Some(smooth);
        self.interval = (smooth + 4 * self.spread).clamp(SOONEST, LATEST);
    }
}

/// A message on its way, unanswered.
#[derive(Clone, Debug)]
pub(super) struct Pending {
    pub(super) number: u32,
    pub(super) frame: Vec<u8>,
    first: Instant,
    due: Instant,
    interval: Duration,
    tries: u32,
}

impl Pending {
    /// Said for the first time, now.
    pub(super) fn new(number: u32, frame: Vec<u8>, pace: &Pace) -> Self {
        let now = Instant::now();
        let interval = pace.interval;
        Self { number, frame, first: now, due: now + interval, interval, tries: 1 }
    }

    /// How long until it is to be said again.
    pub(super) fn wait(&self) -> Duration {
        self.due.saturating_duration_since(Instant::now())
    }

    /// It is being said again.
    pub(super) fn said_again(&mut self) {
        self.tries += 1;
        if self.tries > EVEN_TRIES {
            self.interval = LATEST.min(self.interval * 2);
        }
        self.due = Instant::now() + self.interval;
    }

    /// Since it was first said.
    pub(super) fn age(&self) -> Duration {
        self.first.elapsed()
    }

    /// It was answered, just now.
    pub(super) fn answered(&self, pace: &mut Pace) {
        pace.learn(self);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waited(tries: u32, took: Duration) -> Pending {
        let first = Instant::now().checked_sub(took).unwrap();
        Pending { first, tries, ..Pending::new(1, Vec::new(), &Pace::new()) }
    }

    #[test]
    fn the_interval_follows_the_round_trip() {
        let mut pace = Pace::new();
        assert_eq!(pace.interval, FIRST);
        for _ in 0..100 {
            waited(1, Duration::from_millis(10)).answered(&mut pace);
        }
        let ms = pace.interval.as_secs_f64() * 1e3;
        assert!((10.0..13.0).contains(&ms), "{ms}");
        for _ in 0..100 {
            waited(1, Duration::from_micros(50)).answered(&mut pace);
        }
        assert_eq!(pace.interval, SOONEST);
        waited(1, Duration::from_secs(5)).answered(&mut pace);
        assert_eq!(pace.interval, LATEST);
    }

    #[test]
    fn noise_is_met_evenly_and_silence_ever_more_slowly() {
        let mut pending = Pending::new(1, Vec::new(), &Pace::new());
        let intervals: Vec<_> = (0..12)
            .map(|_| {
                pending.said_again();
                pending.interval
            })
            .collect();
        assert!(intervals[..5].iter().all(|interval| *interval == FIRST), "{intervals:?}");
        assert!(intervals[5..8].is_sorted_by(|a, b| a < b), "{intervals:?}");
        assert_eq!(intervals[11], LATEST);
        // What was said more than once teaches how patient to be, and no round trip.
        let mut pace = Pace::new();
        pending.answered(&mut pace);
        assert_eq!((pace.interval, pace.smooth), (LATEST, None));
    }
}
