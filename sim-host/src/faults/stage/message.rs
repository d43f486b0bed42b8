//! Faults of the transport: they know nothing of what is carried.

use std::collections::VecDeque;

use super::chain::{Now, Passed, Stage};
use super::dice::Dice;
use super::wire::WireMessage;

/// Most ticks that [`Delay`] holds a message back, the random ones included.
pub const MAX_DELAY_TICKS: u32 = 2000;

/// Messages that do not arrive.
#[derive(Debug)]
pub struct Drop {
    share: f64,
    dice: Dice,
}

impl Drop {
    /// Loses this share of the messages, 0 to 1.
    #[must_use]
    pub fn new(share: f64, dice: Dice) -> Self {
        Self { share, dice }
    }
}

impl<M: WireMessage> Stage<M> for Drop {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if now.active && message.is_some() && self.dice.happens(self.share) {
            Passed::touched(None)
        } else {
            Passed::untouched(message)
        }
    }
}

/// Messages that arrive later, each by the same time, by a random one, or both.
///
/// Of those that arrive in one tick the one that was sent last counts. One that
/// waits longer than its successor comes after it, out of order.
#[derive(Debug)]
pub struct Delay<M> {
    ticks: u32,
    jitter_ticks: u32,
    dice: Dice,
    under_way: VecDeque<(u64, M)>,
}

impl<M> Delay<M> {
    /// By `ticks`, and 0 to `jitter_ticks` more; together at most
    /// [`MAX_DELAY_TICKS`], and cut to that.
    #[must_use]
    pub fn new(ticks: u32, jitter_ticks: u32, dice: Dice) -> Self {
        let ticks = ticks.min(MAX_DELAY_TICKS);
        let jitter_ticks = jitter_ticks.min(MAX_DELAY_TICKS - ticks);
        let most = (ticks + jitter_ticks) as usize + 2;
        Self { ticks, jitter_ticks, dice, under_way: VecDeque::with_capacity(most) }
    }
}

impl<M: WireMessage> Stage<M> for Delay<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        let mut touched = false;
        if let Some(message) = message {
            let late = if now.active {
                u64::from(self.ticks) + u64::from(self.dice.up_to(self.jitter_ticks))
            } else {
                0
            };
            touched = late > 0;
            if self.under_way.len() == self.under_way.capacity() {
                // More than one a tick, which no session sends: the oldest goes.
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

/// Messages that arrive twice: once more a tick later, in place of the one then.
#[derive(Debug)]
pub struct Duplicate<M> {
    share: f64,
    dice: Dice,
    again: Option<(u64, M)>,
}

impl<M> Duplicate<M> {
    /// Of this share, 0 to 1.
    #[must_use]
    pub fn new(share: f64, dice: Dice) -> Self {
        Self { share, dice, again: None }
    }
}

impl<M: WireMessage> Stage<M> for Duplicate<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if let Some((due, again)) = self.again
            && due <= now.tick
        {
            self.again = None;
            return Passed::touched(Some(again));
        }
        if let Some(message) = message
            && now.active
            && self.dice.happens(self.share)
        {
            self.again = Some((now.tick + 1, message));
        }
        Passed::untouched(message)
    }
}

/// Messages that are overtaken: the next one comes before, and then this one, two
/// ticks late and in place of the one then.
#[derive(Debug)]
pub struct Reorder<M> {
    share: f64,
    dice: Dice,
    overtaken: Option<(u64, M)>,
}

impl<M> Reorder<M> {
    /// Of this share, 0 to 1.
    #[must_use]
    pub fn new(share: f64, dice: Dice) -> Self {
        Self { share, dice, overtaken: None }
    }
}

impl<M: WireMessage> Stage<M> for Reorder<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        match (self.overtaken, message) {
            (Some((due, overtaken)), _) if due <= now.tick => {
                self.overtaken = None;
                Passed::untouched(Some(overtaken))
            }
            (None, Some(message)) if now.active && self.dice.happens(self.share) => {
                self.overtaken = Some((now.tick + 2, message));
                Passed::touched(None)
            }
            _ => Passed::untouched(message),
        }
    }
}

/// Messages with bits turned over, anywhere.
#[derive(Debug)]
pub struct Corrupt {
    share: f64,
    bits: u32,
    dice: Dice,
}

impl Corrupt {
    /// Of this share, 0 to 1; so many bits in each, drawn one by one.
    #[must_use]
    pub fn new(share: f64, bits: u32, dice: Dice) -> Self {
        Self { share, bits, dice }
    }
}

impl<M: WireMessage> Stage<M> for Corrupt {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        let Some(mut message) = message else { return Passed::untouched(None) };
        if !(now.active && self.dice.happens(self.share)) {
            return Passed::untouched(Some(message));
        }
        for _ in 0..self.bits {
            message.flip(self.dice.up_to(M::BITS - 1));
        }
        Passed::touched(Some(message))
    }
}

/// What comes from a frozen link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ice {
    /// The last message before, again at every tick.
    Last,
    /// Nothing.
    Nothing,
}

/// A link that stands still for a while, now and then.
#[derive(Debug)]
pub struct Freeze<M> {
    ticks: u64,
    chance: f64,
    ice: Ice,
    dice: Dice,
    /// The first tick after.
    until: u64,
    last: Option<M>,
}

impl<M> Freeze<M> {
    /// For so many ticks; while it runs, each tick freezes it by this chance.
    #[must_use]
    pub fn new(ticks: u64, chance: f64, ice: Ice, dice: Dice) -> Self {
        Self { ticks, chance, ice, dice, until: 0, last: None }
    }
}

impl<M: WireMessage> Stage<M> for Freeze<M> {
    fn pass(&mut self, now: Now, message: Option<M>) -> Passed<M> {
        if now.tick >= self.until && now.active && self.dice.happens(self.chance) {
            self.until = now.tick + self.ticks;
        }
        if now.tick < self.until {
            return Passed::touched(self.last.filter(|_| self.ice == Ice::Last));
        }
        self.last = message.or(self.last);
        Passed::untouched(message)
    }
}
