//! Replay of failed starts: episodes that ended in a fall are tried again.
//!
//! In thin media an actor soon masters nearly every start, and hardly one fresh start in
//! a hundred teaches it anything more. The starts that ended in a fall are therefore
//! stored for a second try. Air and thin media have a store each, so that the mix of
//! density ratios stays as configured.

use crate::environment::Start;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// Media with a density ratio below this count as thin.
pub const THIN: f64 = 0.2;
/// Starts stored for each kind of medium. The latest replace the oldest: falls late in
/// the training are the hard ones.
const CAPACITY: usize = 1000;

/// Starts of episodes that ended in a fall, by kind of medium.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FailedStarts {
    vacuum: Ring,
    thin: Ring,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Ring {
    starts: Vec<Start>,
    /// Index that is overwritten next once the ring is full.
    next: usize,
}

impl Ring {
    fn push(&mut self, start: Start) {
        if self.starts.len() < CAPACITY {
            self.starts.push(start);
        } else {
            self.next %= CAPACITY;
            self.starts[self.next] = start;
            self.next += 1;
        }
    }
}

impl FailedStarts {
    /// Returns the ring for a medium; `None` above [`THIN`], where falls are rare.
    fn ring(&mut self, density_ratio: f64) -> Option<&mut Ring> {
        match density_ratio {
            0.0 => Some(&mut self.vacuum),
            rho if rho < THIN => Some(&mut self.thin),
            _ => None,
        }
    }

    /// Stores the start of an episode that fell.
    pub(crate) fn push(&mut self, start: Start) {
        if let Some(ring) = self.ring(start.density_ratio) {
            ring.push(start);
        }
    }

    /// Replaces `start` with probability `share` by a stored one of the same kind of
    /// medium. The stored start is removed; it returns if the episode falls again.
    pub(crate) fn replay(&mut self, share: f64, start: &mut Start, rng: &mut impl Rng) {
        if share == 0.0 {
            return;
        }
        let Some(ring) = self.ring(start.density_ratio) else { return };
        if rng.random::<f64>() < share && !ring.starts.is_empty() {
            let index = rng.random_range(0..ring.starts.len() as u64) as usize;
            *start = ring.starts.swap_remove(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CAPACITY, FailedStarts};
    use crate::environment::Start;
    use leg_plant::Apex;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    fn start(vx_m_s: f64, density_ratio: f64) -> Start {
        Start { apex: Apex { vx_m_s, y_m: 2.0 }, density_ratio }
    }

    #[test]
    fn replays_a_failed_start_once_and_only_in_its_kind_of_medium() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut failed = FailedStarts::default();
        failed.push(start(1.0, 0.0));
        failed.push(start(2.0, 0.15));
        failed.push(start(3.0, 0.5));
        let mut replayed = |share, density_ratio| {
            let mut fresh = start(9.0, density_ratio);
            failed.replay(share, &mut fresh, &mut rng);
            (fresh.apex.vx_m_s, fresh.density_ratio)
        };
        assert_eq!(replayed(0.0, 0.0), (9.0, 0.0));
        assert_eq!(replayed(1.0, 0.6), (9.0, 0.6));
        assert_eq!(replayed(1.0, 0.01), (2.0, 0.15));
        assert_eq!(replayed(1.0, 0.01), (9.0, 0.01));
        assert_eq!(replayed(1.0, 0.0), (1.0, 0.0));
        assert_eq!(replayed(1.0, 0.0), (9.0, 0.0));
    }

    #[test]
    fn a_full_ring_overwrites_the_oldest_start() {
        let mut failed = FailedStarts::default();
        (0..CAPACITY + 10).for_each(|i| failed.push(start(i as f64, 0.0)));
        let starts = &failed.vacuum.starts;
        assert_eq!(starts.len(), CAPACITY);
        let oldest = starts.iter().map(|s| s.apex.vx_m_s).fold(f64::INFINITY, f64::min);
        assert_eq!(oldest, 10.0);
    }
}
