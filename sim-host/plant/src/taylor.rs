//! Taylor series of the stance, computed by recurrence.
//!
//! With the position `p` relative to the foot, the leg length `l = |p|`, the rest length `L` and
//! the spring's pull per leg length `s = k (L - l) / l`, the equations of the stance are
//!
//! ```text
//! p' = v        l l = p . p        l s = k (L - l)
//! v' = s p - c sign(v) v v - (0, g)
//! ```
//!
//! Every product is a convolution of coefficients, so each order follows from the lower ones.
//! The convolutions run two at a time: (x, y), (vx, vy) and (l, s), of `f64` each in a 128-bit
//! register. Each adds the newest coefficients last, so that the rest of the sum does not wait for
//! them.
//!
//! All is generic over [`Real`], so that vectors compute several stances at once.

use crate::elongation::Ramp;
use crate::pair::Pair;
use crate::real::{Mask, Real};

/// Number of coefficients. The work of a series grows with its square, and its reach more slowly:
/// 12 to 20 take about the same time at the golden tolerance, and fewer are better at looser ones.
const N: usize = 14;

/// The vector field of the stance: coefficients of the accelerations, per moving mass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Field<L = f64> {
    /// Spring stiffness per moving mass.
    pub(crate) spring_per_s2: L,
    /// Drag along x and y, per squared speed.
    pub(crate) drag_per_m: Pair<L>,
    /// Weight less buoyancy.
    pub(crate) net_gravity_m_s2: L,
}

/// Position of the mass relative to the foot, and its velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct State<L = f64> {
    pub(crate) position_m: Pair<L>,
    pub(crate) velocity_m_s: Pair<L>,
}

impl<L: Real> State<L> {
    #[inline(always)]
    pub(crate) fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            position_m: Pair::select(mask, yes.position_m, no.position_m),
            velocity_m_s: Pair::select(mask, yes.velocity_m_s, no.velocity_m_s),
        }
    }
}

/// The event function of lift-off with its rate, and the accelerations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rates<L = f64> {
    /// Leg length less rest length, 0 at lift-off.
    pub(crate) excess_m: L,
    pub(crate) excess_m_s: L,
    pub(crate) acceleration_m_s2: Pair<L>,
}

impl<L: Real> Field<L> {
    /// Returns true if there is any drag.
    #[inline(always)]
    pub(crate) fn has_drag(&self) -> L::Mask {
        let Pair([x, y]) = self.drag_per_m;
        let zero = x.splat(0.0);
        !(x.eq(zero) & y.eq(zero))
    }

    /// Returns the signed drag coefficients that hold just after a state. A velocity of 0 takes
    /// the sign of its acceleration.
    #[inline(always)]
    fn drag(&self, velocity_m_s: Pair<L>, free_m_s2: Pair<L>) -> Pair<L> {
        Pair([
            signed(self.drag_per_m[0], velocity_m_s[0], free_m_s2[0]),
            signed(self.drag_per_m[1], velocity_m_s[1], free_m_s2[1]),
        ])
    }

    /// Evaluates the right-hand side at one state.
    #[inline(always)]
    fn rates(&self, state: &State<L>, ramp: Ramp<L>, t_s: L) -> Rates<L> {
        let State { position_m, velocity_m_s } = *state;
        let rest_m = ramp.length_m + ramp.rate_m_s * t_s;
        let length_m = position_m.dot(position_m).sqrt();
        let per_length = t_s.splat(1.0) / length_m;
        let pull = self.spring_per_s2 * (rest_m - length_m) * per_length;
        let free = position_m.scaled(pull) - Pair([t_s.splat(0.0), self.net_gravity_m_s2]);
        let drag = self.drag(velocity_m_s, free);
        Rates {
            excess_m: length_m - rest_m,
            excess_m_s: position_m.dot(velocity_m_s) * per_length - ramp.rate_m_s,
            acceleration_m_s2: free - drag * velocity_m_s * velocity_m_s,
        }
    }
}

/// Returns `drag` with the sign of the velocity, or of the acceleration where that is 0.
#[inline(always)]
fn signed<L: Real>(drag: L, velocity_m_s: L, free_m_s2: L) -> L {
    drag.copysign(L::select(velocity_m_s.eq(drag.splat(0.0)), free_m_s2, velocity_m_s))
}

/// Taylor coefficients of a stance around one instant; the time is in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jet<L = f64> {
    pub(crate) position: [Pair<L>; N],
    pub(crate) velocity: [Pair<L>; N],
    /// Leg length `l` and pull `s`.
    length_pull: [Pair<L>; N],
    /// Leg length in both components, as a factor of the convolutions.
    length: [Pair<L>; N],
    /// Pull in both components.
    pull: [Pair<L>; N],
    ramp: Ramp<L>,
}

/// Values that all orders of a series use.
#[derive(Clone, Copy)]
struct Constants<L: Real> {
    position: Pair<L>,
    twice_velocity: Pair<L>,
    has_drag: L::Mask,
    drag: Pair<L>,
    pull: L,
    per_length: L,
    /// Derivative of the pull by the length, negated, in component 1.
    stiffen: Pair<L>,
}

/// A sum that does not start from 0: the compiler may not remove an addition to 0.
struct Sum<L>(Option<Pair<L>>);

impl<L: Real> Sum<L> {
    const EMPTY: Self = Self(None);

    #[inline(always)]
    fn add(&mut self, term: Pair<L>) {
        self.0 = Some(match self.0 {
            Some(sum) => sum + term,
            None => term,
        });
    }

    #[inline(always)]
    fn double(&mut self) {
        if let Some(sum) = self.0 {
            self.0 = Some(sum + sum);
        }
    }

    #[inline(always)]
    fn total(self, zero: L) -> Pair<L> {
        match self.0 {
            Some(sum) => sum,
            None => Pair([zero; 2]),
        }
    }
}

/// Reciprocals `1 / n`; a division is slower than a product.
const RECIPROCAL: [f64; N] = {
    let mut table = [0.0; N];
    let mut n = 1;
    while n < N {
        table[n] = 1.0 / n as f64;
        n += 1;
    }
    table
};

impl<L: Real> Jet<L> {
    /// Creates an empty series.
    pub(crate) fn new(zero: L) -> Self {
        let none = [Pair([zero; 2]); N];
        Self {
            position: none,
            velocity: none,
            length_pull: none,
            length: none,
            pull: none,
            ramp: Ramp { length_m: zero, rate_m_s: zero },
        }
    }

    /// Expands the motion around `state` under `ramp`.
    #[inline(always)]
    pub(crate) fn expand(&mut self, field: &Field<L>, state: &State<L>, ramp: Ramp<L>) {
        if field.has_drag().any() {
            self.recur::<true>(field, state, ramp);
        } else {
            self.recur::<false>(field, state, ramp);
        }
    }

    #[inline(always)]
    fn recur<const DRAG: bool>(&mut self, field: &Field<L>, state: &State<L>, ramp: Ramp<L>) {
        let (position, velocity) = (state.position_m, state.velocity_m_s);
        let stiffness = field.spring_per_s2;
        let zero = stiffness.splat(0.0);
        let length = position.dot(position).sqrt();
        let per_length = stiffness.splat(1.0) / length;
        let pull = stiffness * (ramp.length_m - length) * per_length;
        let free = position.scaled(pull) - Pair([zero, field.net_gravity_m_s2]);
        let drag = field.drag(velocity, free);
        self.ramp = ramp;
        self.position[0] = position;
        self.velocity[0] = velocity;
        self.set_length_pull(0, length, pull);
        self.position[1] = velocity;
        self.velocity[1] = free - drag * velocity * velocity;

        let c = Constants {
            position,
            twice_velocity: velocity + velocity,
            has_drag: field.has_drag(),
            drag,
            pull,
            per_length,
            stiffen: Pair([zero, (stiffness + pull) * per_length]),
        };
        let none = Pair([zero; 2]);
        let mut last = self.order::<DRAG, 1>(&c, none, stiffness * ramp.rate_m_s);
        // The orders are constants, because a loop over them mispredicts the end of each sum.
        macro_rules! orders {
            ($($n:literal)*) => {
                $(last = self.order::<DRAG, $n>(&c, last, zero);)*
            };
        }
        orders!(2 3 4 5 6 7 8 9 10 11 12);
        const { assert!(N == 14, "the list of orders ends at N - 2") };
        let _ = last;
    }

    /// Computes length and pull of order `n` (and returns them) and position and velocity
    /// of order `n + 1` from the lower orders.
    ///
    /// `last` holds length and pull of order `n - 1`. They are passed in registers, because
    /// a pair that was just stored in halves is slow to load.
    #[inline(always)]
    fn order<const DRAG: bool, const ORDER: usize>(
        &mut self,
        c: &Constants<L>,
        last: Pair<L>,
        pushed: L,
    ) -> Pair<L> {
        let n = ORDER;
        let (zero, half) = (pushed.splat(0.0), pushed.splat(0.5));
        let part = pushed.splat(RECIPROCAL[n + 1]);
        let (mut lengths_pulls, mut pulled) = (Sum::EMPTY, Sum::EMPTY);
        let mut i = 1;
        while i + 1 < n {
            if i > 1 {
                lengths_pulls.add(self.length[i] * self.length_pull[n - i]);
            }
            pulled.add(self.pull[i] * self.position[n - i]);
            i += 1;
        }
        let (mut squares, mut dragged) = (Sum::EMPTY, Sum::EMPTY);
        let mut i = 1;
        while 2 * i < n {
            squares.add(self.position[i] * self.position[n - i]);
            if DRAG {
                dragged.add(self.velocity[i] * self.velocity[n - i]);
            }
            i += 1;
        }
        squares.double();
        dragged.double();
        if n.is_multiple_of(2) {
            squares.add(self.position[n / 2] * self.position[n / 2]);
            if DRAG {
                dragged.add(self.velocity[n / 2] * self.velocity[n / 2]);
            }
        }
        if n > 2 {
            lengths_pulls.add(self.length[1] * last);
        }
        if n > 1 {
            lengths_pulls.add(self.length_pull[1].scaled(last[0]));
            pulled.add(self.position[1].scaled(last[1]));
        }
        let (lengths_pulls, squares) = (lengths_pulls.total(zero), squares.total(zero));
        let newest = self.position[n];
        let stretched = c.position * newest + squares.scaled(half);
        let halved = lengths_pulls * Pair([half, pushed.splat(1.0)]);
        let sum = Pair([stretched[0] + stretched[1], pushed]) - halved;
        let sum = sum.scaled(c.per_length);
        let length_pull = sum - c.stiffen.scaled(sum[0]);
        let [length, pull] = length_pull.0;
        self.length_pull[n] = length_pull;
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
        pulled.add(newest.scaled(c.pull));
        let mut force = pulled.total(zero) + c.position.scaled(pull);
        if DRAG {
            dragged.add(c.twice_velocity * self.velocity[n]);
            let slowed = force - c.drag * dragged.total(zero);
            force = Pair::select(c.has_drag, slowed, force);
        }
        let next = force.scaled(part);
        self.velocity[n + 1] = next;
        self.position[n + 1] = self.velocity[n].scaled(part);
        length_pull
    }

    #[inline(always)]
    fn set_length_pull(&mut self, n: usize, length: L, pull: L) {
        self.length_pull[n] = Pair([length, pull]);
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
    }

    /// Returns the rates at the start.
    #[inline(always)]
    pub(crate) fn start_rates(&self) -> Rates<L> {
        Rates {
            excess_m: self.length_pull[0][0] - self.ramp.length_m,
            excess_m_s: self.length_pull[1][0] - self.ramp.rate_m_s,
            acceleration_m_s2: self.velocity[1],
        }
    }

    /// Evaluates the rates at `state`, which is `t_s` after the start.
    #[inline(always)]
    pub(crate) fn rates(&self, field: &Field<L>, state: &State<L>, t_s: L) -> Rates<L> {
        field.rates(state, self.ramp, t_s)
    }

    /// Returns the longest step whose last terms stay below `tolerance_m_s`, s.
    #[inline(always)]
    pub(crate) fn reach_s(&self, tolerance_m_s: L) -> L {
        let [last, before] = [&self.velocity[N - 1], &self.velocity[N - 2]];
        let size = last[0].abs().max(last[1].abs());
        let reach = (tolerance_m_s / size).rough_root::<{ N - 1 }>();
        let size = before[0].abs().max(before[1].abs());
        reach.min((tolerance_m_s / size).rough_root::<{ N - 2 }>())
    }

    /// Evaluates the state `t_s` after the start.
    #[inline(always)]
    pub(crate) fn at(&self, t_s: L) -> State<L> {
        State { position_m: value(&self.position, t_s), velocity_m_s: value(&self.velocity, t_s) }
    }
}

/// Evaluates both polynomials at `t`. Even and odd powers form separate dependency chains.
#[inline(always)]
fn value<L: Real>(p: &[Pair<L>; N], t: L) -> Pair<L> {
    const { assert!(N.is_multiple_of(2)) };
    let square = t * t;
    let (mut even, mut odd) = (p[N - 2], p[N - 1]);
    let mut i = N - 2;
    while i > 0 {
        i -= 2;
        even = even.scaled(square) + p[i];
        odd = odd.scaled(square) + p[i + 1];
    }
    even + odd.scaled(t)
}
