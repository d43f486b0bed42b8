//! The replay buffer: it stores transitions and draws random batches from them.

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::net::Row;

/// One step of the environment, scaled to the networks' inputs and outputs.
#[repr(align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// Scaled observation before the step.
    pub observation: [f32; 3],
    /// Action in unit space.
    pub action: [f32; 2],
    /// Reward of the step.
    pub reward: f32,
    /// Scaled observation after the step.
    pub next: [f32; 3],
    /// 1, or 0 where the episode ended with this step and has no next value.
    pub continues: f32,
}

impl Transition {
    /// Number of `f32` in a transition.
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

/// The state of a replay buffer in a checkpoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReplayState {
    /// The transitions, ten numbers each.
    #[serde(with = "bytes")]
    numbers: Vec<f32>,
    oldest: usize,
}

/// Serialises numbers as one byte string, little-endian. One number at a time would be slow.
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

/// A buffer of the latest transitions, up to a capacity.
#[derive(Clone, Debug)]
pub struct Replay {
    transitions: Vec<Transition>,
    capacity: usize,
    /// Index of the oldest transition once the buffer is full.
    oldest: usize,
}

/// A batch; every row has one number for each sample.
#[derive(Clone, Debug)]
pub(crate) struct Batch<const B: usize> {
    pub(crate) observation: [Row<B>; 3],
    pub(crate) action: [Row<B>; 2],
    pub(crate) reward: Row<B>,
    pub(crate) next: [Row<B>; 3],
    pub(crate) continues: Row<B>,
}

impl Replay {
    /// Creates an empty buffer.
    ///
    /// # Panics
    /// If `capacity` is 0 or does not fit 32 bits.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        assert!(capacity > 0 && u32::try_from(capacity).is_ok());
        Self { transitions: Vec::new(), capacity, oldest: 0 }
    }

    /// Returns the number of stored transitions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.transitions.len()
    }

    /// Whether the buffer is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.transitions.is_empty()
    }

    /// Stores a transition; a full buffer overwrites the oldest.
    pub fn push(&mut self, transition: Transition) {
        if self.transitions.len() < self.capacity {
            self.transitions.push(transition);
        } else {
            self.transitions[self.oldest] = transition;
            self.oldest = (self.oldest + 1) % self.capacity;
        }
    }

    /// Returns the state to store in a checkpoint.
    #[must_use]
    pub fn state(&self) -> ReplayState {
        let mut numbers = Vec::with_capacity(Transition::NUMBERS * self.transitions.len());
        self.transitions.iter().for_each(|t| numbers.extend(t.numbers()));
        ReplayState { numbers, oldest: self.oldest }
    }

    /// Restores the state of a buffer of the same capacity; `None` when it does not fit.
    #[must_use]
    pub fn from_state(capacity: usize, state: &ReplayState) -> Option<Self> {
        let (transitions, rest) = state.numbers.as_chunks::<{ Transition::NUMBERS }>();
        let transitions: Vec<_> =
            transitions.iter().map(|t| Transition::from_numbers(*t)).collect();
        let fits = rest.is_empty() && transitions.len() <= capacity && state.oldest < capacity;
        fits.then_some(Self { transitions, capacity, oldest: state.oldest })
    }

    /// Draws a batch, with replacement. With `mirror`, each sample is mirrored with probability
    /// 1/2, because the dynamics of the leg are mirror-symmetric.
    #[inline(always)]
    pub(crate) fn sample<const B: usize>(
        &self,
        mirror: bool,
        rng: &mut impl Rng,
        batch: &mut Batch<B>,
    ) {
        let count = self.transitions.len() as u64;
        for b in 0..B {
            let bits = rng.next_u64();
            // The high half selects the transition; the bias of the multiplication is below
            // count / 2^32.
            let t = &self.transitions[(((bits >> 32) * count) >> 32) as usize];
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
    fn a_full_buffer_overwrites_the_oldest_transition() {
        let mut replay = Replay::new(3);
        (1..=5).for_each(|i| replay.push(transition(i)));
        let mut transitions: Vec<f32> = replay.transitions.iter().map(|t| t.reward).collect();
        transitions.sort_by(f32::total_cmp);
        assert_eq!(transitions, [3.0, 4.0, 5.0]);
    }

    #[test]
    fn mirroring_changes_the_sign_of_every_odd_number_of_a_sample() {
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
