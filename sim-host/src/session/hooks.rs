//! Callbacks of a session.

use super::leg::{Leg, TickRecord};

/// Callbacks of a session; `()` does nothing.
///
/// In real time they must not allocate, log or block. [`Hooks::wait`] may block,
/// because it is called in lock-step only.
pub trait Hooks {
    /// Called before each tick in lock-step; blocks while the run is paused.
    fn wait(&mut self) {}
    /// Called before each tick; returns true to end the run.
    fn ends(&mut self) -> bool {
        false
    }
    /// Called before each sample is sent; may change the leg's set-point.
    fn steer(&mut self, _leg: &mut Leg<'_>) {}
    /// Called after each tick.
    fn observe(&mut self, _tick: &TickRecord<'_>) {}
    /// Called in lock-step before the end of the run is announced to the controller, which may
    /// leave then; may block.
    fn before_end(&mut self) {}
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
    fn before_end(&mut self) {
        (**self).before_end();
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
    fn before_end(&mut self) {
        if let Some(hooks) = self {
            hooks.before_end();
        }
    }
}

/// Calls both in this order.
impl<A: Hooks, B: Hooks> Hooks for (A, B) {
    fn wait(&mut self) {
        self.0.wait();
        self.1.wait();
    }
    fn ends(&mut self) -> bool {
        // No short circuit: either may count its calls.
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
    fn before_end(&mut self) {
        self.0.before_end();
        self.1.before_end();
    }
}

/// Calls a closure after each tick.
#[derive(Clone, Copy, Debug)]
pub struct Observe<F>(pub F);

impl<F: FnMut(&TickRecord)> Hooks for Observe<F> {
    fn observe(&mut self, tick: &TickRecord<'_>) {
        (self.0)(tick);
    }
}
