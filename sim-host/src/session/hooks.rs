//! What a session calls in the course of a run.

use super::leg::{Leg, TickRecord};

/// What a session calls in the course of a run. `()` does nothing.
///
/// In real time nothing here may allocate, log, or wait, but
/// [`Hooks::wait`], which is not called there.
pub trait Hooks {
    /// In lock-step, before each tick: time waits for this.
    fn wait(&mut self) {}
    /// Before each tick: whether the run is to end here, as somebody wishes.
    fn ends(&mut self) -> bool {
        false
    }
    /// Before each tick: what is ordered of the leg by hand.
    fn steer(&mut self, _leg: &mut Leg<'_>) {}
    /// At each tick of the plant.
    fn observe(&mut self, _tick: &TickRecord<'_>) {}
}

impl Hooks for () {}

impl<H: Hooks + ?Sized> Hooks for &mut H {
    fn wait(&mut self) {
        (**self).wait();
    }
    fn ends(&mut self) -> bool {
        (**self).ends()
    }
    fn steer(&mut self, leg: &mut Leg<'_>) {
        (**self).steer(leg);
    }
    fn observe(&mut self, tick: &TickRecord<'_>) {
        (**self).observe(tick);
    }
}

impl<H: Hooks> Hooks for Option<H> {
    fn wait(&mut self) {
        if let Some(hooks) = self {
            hooks.wait();
        }
    }
    fn ends(&mut self) -> bool {
        self.as_mut().is_some_and(Hooks::ends)
    }
    fn steer(&mut self, leg: &mut Leg<'_>) {
        if let Some(hooks) = self {
            hooks.steer(leg);
        }
    }
    fn observe(&mut self, tick: &TickRecord<'_>) {
        if let Some(hooks) = self {
            hooks.observe(tick);
        }
    }
}

/// Both, in this order.
impl<A: Hooks, B: Hooks> Hooks for (A, B) {
    fn wait(&mut self) {
        self.0.wait();
        self.1.wait();
    }
    fn ends(&mut self) -> bool {
        // Either may keep count: both are asked.
        let ends = self.0.ends();
        self.1.ends() || ends
    }
    fn steer(&mut self, leg: &mut Leg<'_>) {
        self.0.steer(leg);
        self.1.steer(leg);
    }
    fn observe(&mut self, tick: &TickRecord<'_>) {
        self.0.observe(tick);
        self.1.observe(tick);
    }
}

/// Only sees the ticks.
#[derive(Clone, Copy, Debug)]
pub struct Observe<F>(pub F);

impl<F: FnMut(&TickRecord)> Hooks for Observe<F> {
    fn observe(&mut self, tick: &TickRecord<'_>) {
        (self.0)(tick);
    }
}
