//! Taylor series of the stance, by recurrence.
//!
//! With the place `p` seen from the foot, the leg length `l = |p|` and the spring's pull
//! `s = k (L - l) / l` along the leg, the equations of the stance are
//!
//! ```text
//! p' = v        l l = p . p        l s = k (L - l)
//! v' = s p - c sign(v) v v - (0, g)
//! ```
//!
//! Every product is a convolution of coefficients, so each order follows from the lower ones.
//! The convolutions run two at a time, one in each lane of a 128-bit register: (x, y),
//! (vx, vy) and (l, s). In each the newest coefficients are added last, so that the rest of
//! the sum is out of the way before they are known.

use super::elongation::Ramp;
use super::pair::Pair;

/// Coefficients of a series. The work for one grows with the square, its reach ever more
/// slowly: 12 to 20 cost about the same at the golden tolerance, and at looser ones fewer win.
const N: usize = 14;

/// Accelerations in stance, per moving mass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    /// Spring stiffness per moving mass.
    pub(super) spring_per_s2: f64,
    /// Drag along x and y.
    pub(super) drag_per_m: Pair,
    /// Weight less buoyancy.
    pub(super) net_gravity_m_s2: f64,
}

/// Place of the mass as seen from the foot, and its velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct State {
    pub(super) place_m: Pair,
    pub(super) velocity_m_s: Pair,
}

/// What changes over a stretch of stance, with the rates at which it does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates {
    /// Leg length less rest length: 0 at lift-off.
    pub(super) excess_m: f64,
    pub(super) excess_m_s: f64,
    pub(super) acceleration_m_s2: Pair,
}

impl Field {
    /// Whether there is any drag.
    pub(super) fn drags(&self) -> bool {
        self.drag_per_m != Pair::ZERO
    }

    /// The signed drag coefficients that hold just after this state: a velocity that starts
    /// at 0 takes the sign of its acceleration.
    fn drag(&self, velocity_m_s: Pair, free_m_s2: Pair) -> Pair {
        let signed = |i: usize| {
            let sense = if velocity_m_s[i] == 0.0 { free_m_s2[i] } else { velocity_m_s[i] };
            self.drag_per_m[i].copysign(sense)
        };
        Pair([signed(0), signed(1)])
    }

    /// The right-hand side at one state.
    fn rates(&self, state: &State, ramp: Ramp, t_s: f64) -> Rates {
        let State { place_m, velocity_m_s } = *state;
        let rest_m = ramp.length_m + ramp.rate_m_s * t_s;
        let length_m = place_m.dot(place_m).sqrt();
        let per_length = 1.0 / length_m;
        let pull = self.spring_per_s2 * (rest_m - length_m) * per_length;
        let free = place_m.scaled(pull) - Pair([0.0, self.net_gravity_m_s2]);
        let drag = self.drag(velocity_m_s, free);
        Rates {
            excess_m: length_m - rest_m,
            excess_m_s: place_m.dot(velocity_m_s) * per_length - ramp.rate_m_s,
            acceleration_m_s2: free - drag * velocity_m_s * velocity_m_s,
        }
    }
}

/// Coefficients of a stance around one instant, powers of the time in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet {
    pub(super) place: [Pair; N],
    pub(super) velocity: [Pair; N],
    /// Leg length and pull.
    length_pull: [Pair; N],
    /// The same, each in both lanes: factors of the convolutions.
    length: [Pair; N],
    pull: [Pair; N],
    ramp: Ramp,
}

/// What all orders of a series share.
#[derive(Clone, Copy)]
struct Constants {
    place: Pair,
    twice_velocity: Pair,
    drag: Pair,
    pull: f64,
    per_length: f64,
    /// How fast the pull falls with the length.
    stiffen: Pair,
}

/// A sum that does not begin with an addition to 0, which the compiler may not leave out.
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

/// `1 / n`, for divisions are slow.
const PER: [f64; N] = {
    let mut table = [0.0; N];
    let mut n = 1;
    while n < N {
        table[n] = 1.0 / n as f64;
        n += 1;
    }
    table
};

impl Jet {
    /// Room for a series.
    pub(super) fn new() -> Self {
        Self {
            place: [Pair::ZERO; N],
            velocity: [Pair::ZERO; N],
            length_pull: [Pair::ZERO; N],
            length: [Pair::ZERO; N],
            pull: [Pair::ZERO; N],
            ramp: Ramp { length_m: 0.0, rate_m_s: 0.0 },
        }
    }

    /// Expands the motion around `state`.
    pub(super) fn expand(&mut self, field: &Field, state: &State, ramp: Ramp) {
        if field.drags() {
            self.recur::<true>(field, state, ramp);
        } else {
            self.recur::<false>(field, state, ramp);
        }
    }

    fn recur<const DRAG: bool>(&mut self, field: &Field, state: &State, ramp: Ramp) {
        let (place, velocity) = (state.place_m, state.velocity_m_s);
        let stiffness = field.spring_per_s2;
        let length = place.dot(place).sqrt();
        let per_length = 1.0 / length;
        let pull = stiffness * (ramp.length_m - length) * per_length;
        let free = place.scaled(pull) - Pair([0.0, field.net_gravity_m_s2]);
        let drag = field.drag(velocity, free);
        self.ramp = ramp;
        self.place[0] = place;
        self.velocity[0] = velocity;
        self.set_length_pull(0, length, pull);
        self.place[1] = velocity;
        self.velocity[1] = free - drag * velocity * velocity;

        let c = Constants {
            place,
            twice_velocity: velocity + velocity,
            drag,
            pull,
            per_length,
            stiffen: Pair([0.0, (stiffness + pull) * per_length]),
        };
        let mut last = self.order::<DRAG, 1>(&c, Pair::ZERO, stiffness * ramp.rate_m_s);
        // Orders known at compile time: a loop over them mispredicts the end of each sum.
        macro_rules! orders {
            ($($n:literal)*) => {
                $(last = self.order::<DRAG, $n>(&c, last, 0.0);)*
            };
        }
        orders!(2 3 4 5 6 7 8 9 10 11 12);
        const { assert!(N == 14, "the list of orders ends at N - 2") };
        let _ = last;
    }

    /// From the coefficients up to `n` of place and velocity to length and pull of order `n`,
    /// which it returns, and place and velocity of order `n + 1`.
    ///
    /// `last` are length and pull of order `n - 1`; they come in registers, for what was just
    /// stored in halves is slow to load as a pair.
    #[expect(clippy::inline_always, reason = "each order is a piece of straight code")]
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
            pulled.add(self.pull[i] * self.place[n - i]);
            i += 1;
        }
        let (mut squares, mut dragged) = (Sum::EMPTY, Sum::EMPTY);
        let mut i = 1;
        while 2 * i < n {
            squares.add(self.place[i] * self.place[n - i]);
            if DRAG {
                dragged.add(self.velocity[i] * self.velocity[n - i]);
            }
            i += 1;
        }
        squares.double();
        dragged.double();
        if n.is_multiple_of(2) {
            squares.add(self.place[n / 2] * self.place[n / 2]);
            if DRAG {
                dragged.add(self.velocity[n / 2] * self.velocity[n / 2]);
            }
        }
        if n > 2 {
            lengths_pulls.add(self.length[1] * last);
        }
        if n > 1 {
            lengths_pulls.add(self.length_pull[1].scaled(last[0]));
            pulled.add(self.place[1].scaled(last[1]));
        }
        let (lengths_pulls, squares) = (lengths_pulls.total(), squares.total());
        let newest = self.place[n];
        let stretched = c.place * newest + squares.scaled(0.5);
        let sum = Pair([stretched[0] + stretched[1], pushed]) - lengths_pulls * Pair([0.5, 1.0]);
        let sum = sum.scaled(c.per_length);
        let length_pull = sum - c.stiffen.scaled(sum[0]);
        let [length, pull] = length_pull.0;
        self.length_pull[n] = length_pull;
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
        pulled.add(newest.scaled(c.pull));
        let mut force = pulled.total() + c.place.scaled(pull);
        if DRAG {
            dragged.add(c.twice_velocity * self.velocity[n]);
            force = force - c.drag * dragged.total();
        }
        let next = force.scaled(PER[n + 1]);
        self.velocity[n + 1] = next;
        self.place[n + 1] = self.velocity[n].scaled(PER[n + 1]);
        length_pull
    }

    fn set_length_pull(&mut self, n: usize, length: f64, pull: f64) {
        self.length_pull[n] = Pair([length, pull]);
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
    }

    /// The rates at the start.
    pub(super) fn start_rates(&self) -> Rates {
        Rates {
            excess_m: self.length_pull[0][0] - self.ramp.length_m,
            excess_m_s: self.length_pull[1][0] - self.ramp.rate_m_s,
            acceleration_m_s2: self.velocity[1],
        }
    }

    /// The rates at the state `t_s` later.
    pub(super) fn rates(&self, field: &Field, state: &State, t_s: f64) -> Rates {
        field.rates(state, self.ramp, t_s)
    }

    /// Longest step whose last terms stay below `tolerance_m_s`.
    pub(super) fn reach_s(&self, tolerance_m_s: f64) -> f64 {
        let size = |n: usize| self.velocity[n][0].abs().max(self.velocity[n][1].abs());
        let reach = |n: usize| rough_root(tolerance_m_s / size(n), n);
        reach(N - 1).min(reach(N - 2))
    }

    /// The state `t_s` later.
    pub(super) fn at(&self, t_s: f64) -> State {
        State { place_m: value(&self.place, t_s), velocity_m_s: value(&self.velocity, t_s) }
    }
}

/// The `n`-th root of a positive number to a few percent: the bits of a float are nearly its
/// logarithm. The same on every machine, which `powf` is not, and far quicker.
#[inline]
fn rough_root(x: f64, n: usize) -> f64 {
    const ONE: i64 = 1.0_f64.to_bits().cast_signed();
    let over_one = x.to_bits().cast_signed() - ONE;
    f64::from_bits((ONE + over_one / n.cast_signed() as i64).cast_unsigned())
}

/// Value of the polynomials: even and odd powers in chains of their own, for each waits on its
/// last product.
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
