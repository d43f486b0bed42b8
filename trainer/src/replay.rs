//! The replay buffer: transitions kept, and drawn from at random.

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::net::Row;

/// One step of the environment, in the networks' units.
#[repr(align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// The scaled observation acted on.
    pub observation: [f32; 3],
    /// The action in unit space.
    pub action: [f32; 2],
    /// The reward.
    pub reward: f32,
    /// The scaled observation that followed.
    pub next: [f32; 3],
    /// 1, or 0 where the episode ended for good, so that nothing follows.
    pub continues: f32,
}

impl Transition {
    /// Numbers in one.
    const NUMBERS: usize = 10;

    fn numbers(&self) -> [f32; Self::NUMBERS] {
        let ([a, b, c], [d, e], [f, g, h]) = (self.observation, self.action, self.next);
        [a, b, c, d, e, self.reward, f, g, h, self.continues]
    }

    fn from_numbers(numbers: [f32; Self::NUMBERS]) -> Self {
        let [a, b, c, d, e, reward, f, g, h, continues] = numbers;
        Self { observation: [a, b, c], action: [d, e], reward, next: [f, g, h], continues }
    }
}

/// A replay buffer as it is kept in a checkpoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReplayState {
    /// Transition by transition, ten numbers each.
    #[serde(with = "bytes")]
    numbers: Vec<f32>,
    oldest: usize,
}

/// Many numbers as one run of bytes, little-endian: item by item is slow.
pub(crate) mod bytes {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(numbers: &[f32], to: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        to.serialize_bytes(&bytes)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f32>, D::Error> {
        let bytes = <&[u8]>::deserialize(from)?;
        let (numbers, rest) = bytes.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(D::Error::custom("bytes that are no numbers"));
        }
        Ok(numbers.iter().map(|x| f32::from_le_bytes(*x)).collect())
    }
}

/// The latest transitions, up to a capacity.
#[derive(Clone, Debug)]
pub struct Replay {
    kept: Vec<Transition>,
    capacity: usize,
    /// Where the next transition goes once the buffer is full.
    oldest: usize,
}

/// A batch, sample by sample along the rows.
#[derive(Clone, Debug)]
pub(crate) struct Batch<const B: usize> {
    pub(crate) observation: [Row<B>; 3],
    pub(crate) action: [Row<B>; 2],
    pub(crate) reward: Row<B>,
    pub(crate) next: [Row<B>; 3],
    pub(crate) continues: Row<B>,
}

impl Replay {
    /// An empty buffer.
    ///
    /// # Panics
    /// If `capacity` is 0 or does not fit 32 bits.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        assert!(capacity > 0 && u32::try_from(capacity).is_ok());
        Self { kept: Vec::new(), capacity, oldest: 0 }
    }

    /// Transitions kept.
    #[must_use]
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Keeps `transition`, in place of the oldest when full.
    pub fn push(&mut self, transition: Transition) {
        if self.kept.len() < self.capacity {
            self.kept.push(transition);
        } else {
            self.kept[self.oldest] = transition;
            self.oldest = (self.oldest + 1) % self.capacity;
        }
    }

    /// What is in it.
    #[must_use]
    pub fn state(&self) -> ReplayState {
        let mut numbers = Vec::with_capacity(Transition::NUMBERS * self.kept.len());
        self.kept.iter().for_each(|t| numbers.extend(t.numbers()));
        ReplayState { numbers, oldest: self.oldest }
    }

    /// With what was in another of the same capacity; `None` when it does not fit.
    #[must_use]
    pub fn from_state(capacity: usize, state: &ReplayState) -> Option<Self> {
        let (transitions, rest) = state.numbers.as_chunks::<{ Transition::NUMBERS }>();
        let kept: Vec<_> = transitions.iter().map(|t| Transition::from_numbers(*t)).collect();
        let fits = rest.is_empty() && kept.len() <= capacity && state.oldest < capacity;
        fits.then_some(Self { kept, capacity, oldest: state.oldest })
    }

    /// Draws a batch, with replacement. With `mirror`, each sample is reflected
    /// with probability 1/2: the leg does not know forwards from backwards.
    #[inline(always)]
    pub(crate) fn sample<const B: usize>(
        &self,
        mirror: bool,
        rng: &mut impl Rng,
        batch: &mut Batch<B>,
    ) {
        let count = self.kept.len() as u64;
        for b in 0..B {
            let bits = rng.next_u64();
            // High half: which. The bias of the multiplication is below count / 2^32.
            let t = &self.kept[(((bits >> 32) * count) >> 32) as usize];
            let sign = if mirror && bits & 1 == 1 { -1.0 } else { 1.0 };
            for i in 0..3 {
                let sign = if i == 0 { sign } else { 1.0 };
                batch.observation[i][b] = sign * t.observation[i];
                batch.next[i][b] = sign * t.next[i];
            }
            batch.action[0][b] = sign * t.action[0];
            batch.action[1][b] = t.action[1];
            batch.reward[b] = t.reward;
            batch.continues[b] = t.continues;
        }
    }
}

impl<const B: usize> Batch<B> {
    pub(crate) fn new() -> Self {
        Self {
            observation: [Row::ZERO; 3],
            action: [Row::ZERO; 2],
            reward: Row::ZERO,
            next: [Row::ZERO; 3],
            continues: Row::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Batch, Replay, Transition};
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    fn transition(i: usize) -> Transition {
        let x = i as f32;
        Transition {
            observation: [x, 10.0 + x, 0.5],
            action: [x, 0.25],
            reward: x,
            next: [x, 20.0 + x, 0.5],
            continues: 1.0,
        }
    }

    #[test]
    fn the_oldest_makes_room() {
        let mut replay = Replay::new(3);
        (1..=5).for_each(|i| replay.push(transition(i)));
        let mut kept: Vec<f32> = replay.kept.iter().map(|t| t.reward).collect();
        kept.sort_by(f32::total_cmp);
        assert_eq!(kept, [3.0, 4.0, 5.0]);
    }

    #[test]
    fn a_mirrored_sample_is_reflected_as_a_whole() {
        let mut replay = Replay::new(8);
        (1..=8).for_each(|i| replay.push(transition(i)));
        let mut rng = Pcg64::seed_from_u64(1);
        let mut batch = Batch::<64>::new();
        replay.sample(true, &mut rng, &mut batch);
        let mut mirrored = 0;
        for b in 0..64 {
            let sign = batch.observation[0][b].signum();
            mirrored += usize::from(sign < 0.0);
            let x = batch.reward[b];
            assert!(x >= 1.0);
            assert_eq!(batch.observation[0][b], sign * x);
            assert_eq!(batch.observation[1][b], 10.0 + x);
            assert_eq!(batch.action[0][b], sign * x);
            assert_eq!(batch.action[1][b], 0.25);
            assert_eq!(batch.next[0][b], sign * x);
        }
        assert!((16..48).contains(&mirrored), "{mirrored}");
    }
}
