//! Episodes that fell, to be tried again.
//!
//! In thin media nearly every start is soon mastered, and of fresh starts hardly one in
//! a hundred teaches anything more. Those that end in a fall are therefore kept for a
//! second try, apart by medium, so that the mix of densities stays what it was.

use crate::environment::Start;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// Density ratios below this are thin.
pub const THIN: f64 = 0.2;
/// Starts kept of each kind of medium. The latest: what falls late is what is hard.
const KEPT: usize = 1000;

/// Starts of episodes that ended in a fall.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fallen {
    vacuum: Ring,
    thin: Ring,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Ring {
    kept: Vec<Start>,
    /// What is overwritten next once it is full.
    next: usize,
}

impl Ring {
    fn push(&mut self, start: Start) {
        if self.kept.len() < KEPT {
            self.kept.push(start);
        } else {
            self.next %= KEPT;
            self.kept[self.next] = start;
            self.next += 1;
        }
    }
}

impl Fallen {
    /// Those in media of this kind; none are kept where falls are rare.
    fn like(&mut self, density_ratio: f64) -> Option<&mut Ring> {
        match density_ratio {
            0.0 => Some(&mut self.vacuum),
            rho if rho < THIN => Some(&mut self.thin),
            _ => None,
        }
    }

    /// Keeps the start of an episode that fell.
    pub(crate) fn push(&mut self, start: Start) {
        if let Some(ring) = self.like(start.density_ratio) {
            ring.push(start);
        }
    }

    /// Puts one that fell in the place of `start`, in a medium of the same kind, with
    /// probability `share`. It is out of the box then, and comes back if it falls again.
    pub(crate) fn retry(&mut self, share: f64, start: &mut Start, rng: &mut impl Rng) {
        if share == 0.0 {
            return;
        }
        let Some(ring) = self.like(start.density_ratio) else { return };
        if rng.random::<f64>() < share && !ring.kept.is_empty() {
            let which = rng.random_range(0..ring.kept.len() as u64) as usize;
            *start = ring.kept.swap_remove(which);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Fallen, KEPT};
    use crate::environment::Start;
    use leg_plant::Apex;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    fn start(vx_m_s: f64, density_ratio: f64) -> Start {
        Start { apex: Apex { vx_m_s, y_m: 2.0 }, density_ratio }
    }

    #[test]
    fn a_fall_comes_back_once_and_in_a_medium_of_its_kind() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut fallen = Fallen::default();
        fallen.push(start(1.0, 0.0));
        fallen.push(start(2.0, 0.15));
        fallen.push(start(3.0, 0.5));
        let mut again = |share, density_ratio| {
            let mut fresh = start(9.0, density_ratio);
            fallen.retry(share, &mut fresh, &mut rng);
            (fresh.apex.vx_m_s, fresh.density_ratio)
        };
        assert_eq!(again(0.0, 0.0), (9.0, 0.0));
        assert_eq!(again(1.0, 0.6), (9.0, 0.6));
        assert_eq!(again(1.0, 0.01), (2.0, 0.15));
        assert_eq!(again(1.0, 0.01), (9.0, 0.01));
        assert_eq!(again(1.0, 0.0), (1.0, 0.0));
        assert_eq!(again(1.0, 0.0), (9.0, 0.0));
    }

    #[test]
    fn the_latest_falls_are_kept() {
        let mut fallen = Fallen::default();
        (0..KEPT + 10).for_each(|i| fallen.push(start(i as f64, 0.0)));
        let kept = &fallen.vacuum.kept;
        assert_eq!(kept.len(), KEPT);
        let oldest = kept.iter().map(|s| s.apex.vx_m_s).fold(f64::INFINITY, f64::min);
        assert_eq!(oldest, 10.0);
    }
}
