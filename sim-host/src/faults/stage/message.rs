//! Faults of the transport, which do not depend on the content of a message.

use std::collections::VecDeque;

use super::pipeline::{FaultStage, Now, Passed};
use super::rng::FaultRng;
use super::wire::WireMessage;

/// Largest delay of [`Delay`], ticks, including the random part.
pub const MAX_DELAY_TICKS: u32 = 2000;

/// Drops messages.
#[derive(Debug)]
pub struct Loss {
    share: f64,
    rng: FaultRng,
}

impl Loss {
    /// Drops this share of the messages, 0 to 1.
    #[must_use]
    pub fn new(share: f64, rng: FaultRng) -> Self {
        Self { share, rng }
    }
}

impl<M: WireMessage> FaultStage<M> for Loss {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if now.active && message.is_some() && self.rng.occurs(self.share) {
            Passed::touched(None)
        } else {
            Passed::untouched(message)
        }
    }
}

/// Delays messages by a fixed time, a random time, or both.
///
/// If several messages are due in one tick, the one that was sent last is released. A message
/// with a longer delay than its successor arrives after it, out of order.
#[derive(Debug)]
pub struct Delay<M> {
    ticks: u32,
    jitter_ticks: u32,
    rng: FaultRng,
    under_way: VecDeque<(u64, M)>,
}

impl<M> Delay<M> {
    /// Delays by `ticks` and by 0 to `jitter_ticks` more. The sum is limited to
    /// [`MAX_DELAY_TICKS`].
    #[must_use]
    pub fn new(ticks: u32, jitter_ticks: u32, rng: FaultRng) -> Self {
        let ticks = ticks.min(MAX_DELAY_TICKS);
        let jitter_ticks = jitter_ticks.min(MAX_DELAY_TICKS - ticks);
        let most = (ticks + jitter_ticks) as usize + 2;
        Self { ticks, jitter_ticks, rng, under_way: VecDeque::with_capacity(most) }
    }
}

impl<M: WireMessage> FaultStage<M> for Delay<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        let mut touched = false;
        if let Some(message) = message {
            let late = if now.active {
                u64::from(self.ticks) + u64::from(self.rng.up_to(self.jitter_ticks))
            } else {
                0
            };
            touched = late > 0;
            if self.under_way.len() == self.under_way.capacity() {
                // No session sends more than one message a tick; drop the oldest.
                self.under_way.pop_front();
            }
            self.under_way.push_back((now.tick + late, message));
        }
        let mut arrived = None;
        self.under_way.retain(|&(due, message)| {
            if due <= now.tick {
                arrived = Some(message);
            }
            due > now.tick
        });
        Passed { message: arrived, touched }
    }
}

/// Duplicates messages: the copy arrives a tick later, in place of that tick's message.
#[derive(Debug)]
pub struct Duplicate<M> {
    share: f64,
    rng: FaultRng,
    again: Option<(u64, M)>,
}

impl<M> Duplicate<M> {
    /// Affects this share of the messages, 0 to 1.
    #[must_use]
    pub fn new(share: f64, rng: FaultRng) -> Self {
        Self { share, rng, again: None }
    }
}

impl<M: WireMessage> FaultStage<M> for Duplicate<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if let Some((due, again)) = self.again
            && due <= now.tick
        {
            self.again = None;
            return Passed::touched(Some(again));
        }
        if let Some(message) = message
            && now.active
            && self.rng.occurs(self.share)
        {
            self.again = Some((now.tick + 1, message));
        }
        Passed::untouched(message)
    }
}

/// Reorders messages: a message arrives two ticks late, after its successor and in place of that
/// tick's message.
#[derive(Debug)]
pub struct Reorder<M> {
    share: f64,
    rng: FaultRng,
    overtaken: Option<(u64, M)>,
}

impl<M> Reorder<M> {
    /// Affects this share of the messages, 0 to 1.
    #[must_use]
    pub fn new(share: f64, rng: FaultRng) -> Self {
        Self { share, rng, overtaken: None }
    }
}

impl<M: WireMessage> FaultStage<M> for Reorder<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        match (self.overtaken, message) {
            (Some((due, overtaken)), _) if due <= now.tick => {
                self.overtaken = None;
                Passed::untouched(Some(overtaken))
            }
            (None, Some(message)) if now.active && self.rng.occurs(self.share) => {
                self.overtaken = Some((now.tick + 2, message));
                Passed::touched(None)
            }
            _ => Passed::untouched(message),
        }
    }
}

/// Inverts bits of messages, header included.
#[derive(Debug)]
pub struct Corrupt {
    share: f64,
    bits: u32,
    rng: FaultRng,
}

impl Corrupt {
    /// Corrupts this share of the messages, 0 to 1, by `bits` inversions each, drawn independently.
    #[must_use]
    pub fn new(share: f64, bits: u32, rng: FaultRng) -> Self {
        Self { share, bits, rng }
    }
}

impl<M: WireMessage> FaultStage<M> for Corrupt {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        let Some(mut message) = message else { return Passed::untouched(None) };
        if !(now.active && self.rng.occurs(self.share)) {
            return Passed::untouched(Some(message));
        }
        for _ in 0..self.bits {
            message.flip(self.rng.up_to(M::BITS - 1));
        }
        Passed::touched(Some(message))
    }
}

/// The output of a frozen link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FreezeMode {
    /// The last message before the freeze, repeated in every tick.
    Last,
    /// No message.
    Nothing,
}

/// Freezes the link for some ticks, at random instants.
#[derive(Debug)]
pub struct Freeze<M> {
    ticks: u64,
    chance: f64,
    mode: FreezeMode,
    rng: FaultRng,
    /// First tick after the freeze.
    until: u64,
    last: Option<M>,
}

impl<M> Freeze<M> {
    /// Freezes the link for `ticks` ticks; every tick of a running link starts a freeze with this
    /// probability.
    #[must_use]
    pub fn new(ticks: u64, chance: f64, mode: FreezeMode, rng: FaultRng) -> Self {
        Self { ticks, chance, mode, rng, until: 0, last: None }
    }
}

impl<M: WireMessage> FaultStage<M> for Freeze<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if now.tick >= self.until && now.active && self.rng.occurs(self.chance) {
            self.until = now.tick + self.ticks;
        }
        if now.tick < self.until {
            return Passed::touched(self.last.filter(|_| self.mode == FreezeMode::Last));
        }
        self.last = message.or(self.last);
        Passed::untouched(message)
    }
}
