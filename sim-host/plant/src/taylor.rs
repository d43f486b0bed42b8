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
//! The convolutions run two at a time, one in each lane of a 128-bit register: (x, y),
//! (vx, vy) and (l, s). Each adds the newest coefficients last, so that the rest of the sum does
//! not wait for them.

use libm::sqrt;

use crate::elongation::Ramp;
use crate::pair::Pair;

/// Number of coefficients. The work of a series grows with its square, and its reach more slowly:
/// 12 to 20 take about the same time at the golden tolerance, and fewer are better at looser ones.
const N: usize = 14;

/// The vector field of the stance: coefficients of the accelerations, per moving mass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Field {
    /// Spring stiffness per moving mass.
    pub(crate) spring_per_s2: f64,
    /// Drag along x and y, per squared speed.
    pub(crate) drag_per_m: Pair,
    /// Weight less buoyancy.
    pub(crate) net_gravity_m_s2: f64,
}

/// Position of the mass relative to the foot, and its velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct State {
    pub(crate) position_m: Pair,
    pub(crate) velocity_m_s: Pair,
}

/// The event function of lift-off with its rate, and the accelerations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rates {
    /// Leg length less rest length, 0 at lift-off.
    pub(crate) excess_m: f64,
    pub(crate) excess_m_s: f64,
    pub(crate) acceleration_m_s2: Pair,
}

impl Field {
    /// Returns true if there is any drag.
    pub(crate) fn has_drag(&self) -> bool {
        self.drag_per_m != Pair::ZERO
    }

    /// Returns the signed drag coefficients that hold just after a state. A velocity of 0 takes
    /// the sign of its acceleration.
    fn drag(&self, velocity_m_s: Pair, free_m_s2: Pair) -> Pair {
        let signed = |i: usize| {
            let sign = if velocity_m_s[i] == 0.0 { free_m_s2[i] } else { velocity_m_s[i] };
            self.drag_per_m[i].copysign(sign)
        };
        Pair([signed(0), signed(1)])
    }

    /// Evaluates the right-hand side at one state.
    fn rates(&self, state: &State, ramp: Ramp, t_s: f64) -> Rates {
        let State { position_m, velocity_m_s } = *state;
        let rest_m = ramp.length_m + ramp.rate_m_s * t_s;
        let length_m = sqrt(position_m.dot(position_m));
        let per_length = 1.0 / length_m;
        let pull = self.spring_per_s2 * (rest_m - length_m) * per_length;
        let free = position_m.scaled(pull) - Pair([0.0, self.net_gravity_m_s2]);
        let drag = self.drag(velocity_m_s, free);
        Rates {
            excess_m: length_m - rest_m,
            excess_m_s: position_m.dot(velocity_m_s) * per_length - ramp.rate_m_s,
            acceleration_m_s2: free - drag * velocity_m_s * velocity_m_s,
        }
    }
}

/// Taylor coefficients of a stance around one instant; the time is in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jet {
    pub(crate) position: [Pair; N],
    pub(crate) velocity: [Pair; N],
    /// Leg length `l` and pull `s`.
    length_pull: [Pair; N],
    /// Leg length in both lanes, as a factor of the convolutions.
    length: [Pair; N],
    /// Pull in both lanes.
    pull: [Pair; N],
    ramp: Ramp,
}

/// Values that all orders of a series use.
#[derive(Clone, Copy)]
struct Constants {
    position: Pair,
    twice_velocity: Pair,
    drag: Pair,
    pull: f64,
    per_length: f64,
    /// Derivative of the pull by the length, negated, in lane 1.
    stiffen: Pair,
}

/// A sum that does not start from 0: the compiler may not remove an addition to 0.
struct Sum(Option<Pair>);

impl Sum {
    const EMPTY: Self = Self(None);

    #[inline]
    fn add(&mut self, term: Pair) {
        self.0 = Some(match self.0 {
            Some(sum) => sum + term,
            None => term,
        });
    }

    #[inline]
    fn double(&mut self) {
        if let Some(sum) = self.0 {
            self.0 = Some(sum + sum);
        }
    }

    #[inline]
    fn total(self) -> Pair {
        self.0.unwrap_or(Pair::ZERO)
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

impl Jet {
    /// Creates an empty series.
    pub(crate) fn new() -> Self {
        Self {
            position: [Pair::ZERO; N],
            velocity: [Pair::ZERO; N],
            length_pull: [Pair::ZERO; N],
            length: [Pair::ZERO; N],
            pull: [Pair::ZERO; N],
            ramp: Ramp { length_m: 0.0, rate_m_s: 0.0 },
        }
    }

    /// Expands the motion around `state` under `ramp`.
    pub(crate) fn expand(&mut self, field: &Field, state: &State, ramp: Ramp) {
        if field.has_drag() {
            self.recur::<true>(field, state, ramp);
        } else {
            self.recur::<false>(field, state, ramp);
        }
    }

    fn recur<const DRAG: bool>(&mut self, field: &Field, state: &State, ramp: Ramp) {
        let (position, velocity) = (state.position_m, state.velocity_m_s);
        let stiffness = field.spring_per_s2;
        let length = sqrt(position.dot(position));
        let per_length = 1.0 / length;
        let pull = stiffness * (ramp.length_m - length) * per_length;
        let free = position.scaled(pull) - Pair([0.0, field.net_gravity_m_s2]);
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
            drag,
            pull,
            per_length,
            stiffen: Pair([0.0, (stiffness + pull) * per_length]),
        };
        let mut last = self.order::<DRAG, 1>(&c, Pair::ZERO, stiffness * ramp.rate_m_s);
        // The orders are constants, because a loop over them mispredicts the end of each sum.
        macro_rules! orders {
            ($($n:literal)*) => {
                $(last = self.order::<DRAG, $n>(&c, last, 0.0);)*
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
    #[expect(clippy::inline_always, reason = "each order becomes straight-line code")]
    #[inline(always)]
    fn order<const DRAG: bool, const ORDER: usize>(
        &mut self,
        c: &Constants,
        last: Pair,
        pushed: f64,
    ) -> Pair {
        let n = ORDER;
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
        let (lengths_pulls, squares) = (lengths_pulls.total(), squares.total());
        let newest = self.position[n];
        let stretched = c.position * newest + squares.scaled(0.5);
        let sum = Pair([stretched[0] + stretched[1], pushed]) - lengths_pulls * Pair([0.5, 1.0]);
        let sum = sum.scaled(c.per_length);
        let length_pull = sum - c.stiffen.scaled(sum[0]);
        let [length, pull] = length_pull.0;
        self.length_pull[n] = length_pull;
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
        pulled.add(newest.scaled(c.pull));
        let mut force = pulled.total() + c.position.scaled(pull);
        if DRAG {
            dragged.add(c.twice_velocity * self.velocity[n]);
            force = force - c.drag * dragged.total();
        }
        let next = force.scaled(RECIPROCAL[n + 1]);
        self.velocity[n + 1] = next;
        self.position[n + 1] = self.velocity[n].scaled(RECIPROCAL[n + 1]);
        length_pull
    }

    fn set_length_pull(&mut self, n: usize, length: f64, pull: f64) {
        self.length_pull[n] = Pair([length, pull]);
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
    }

    /// Returns the rates at the start.
    pub(crate) fn start_rates(&self) -> Rates {
        Rates {
            excess_m: self.length_pull[0][0] - self.ramp.length_m,
            excess_m_s: self.length_pull[1][0] - self.ramp.rate_m_s,
            acceleration_m_s2: self.velocity[1],
        }
    }

    /// Evaluates the rates at `state`, which is `t_s` after the start.
    pub(crate) fn rates(&self, field: &Field, state: &State, t_s: f64) -> Rates {
        field.rates(state, self.ramp, t_s)
    }

    /// Returns the longest step whose last terms stay below `tolerance_m_s`, s.
    pub(crate) fn reach_s(&self, tolerance_m_s: f64) -> f64 {
        let size = |n: usize| self.velocity[n][0].abs().max(self.velocity[n][1].abs());
        let reach = |n: usize| rough_root(tolerance_m_s / size(n), n);
        reach(N - 1).min(reach(N - 2))
    }

    /// Evaluates the state `t_s` after the start.
    pub(crate) fn at(&self, t_s: f64) -> State {
        State { position_m: value(&self.position, t_s), velocity_m_s: value(&self.velocity, t_s) }
    }
}

/// Estimates the `n`-th root of a positive number to a few percent, from the fact that the bits of
/// a float are nearly its logarithm. Unlike `powf` it gives the same bits on every machine.
#[inline]
fn rough_root(x: f64, n: usize) -> f64 {
    const ONE: i64 = 1.0_f64.to_bits().cast_signed();
    let over_one = x.to_bits().cast_signed() - ONE;
    f64::from_bits((ONE + over_one / n.cast_signed() as i64).cast_unsigned())
}

/// Evaluates both polynomials at `t`. Even and odd powers form separate dependency chains.
fn value(p: &[Pair; N], t: f64) -> Pair {
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
