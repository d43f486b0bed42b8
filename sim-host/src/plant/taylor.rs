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
            let sense = if velocity_m_s[i] == 0.0 {
                free_m_s2[i]
            } else {
                velocity_m_s[i]
            };
            self.drag_per_m[i].copysign(sense)
        };
        Pair([signed(0), signed(1)])
    }

    /// The right-hand side at one state.
    fn rates(&self, state: &State, ramp: Ramp, t_s: f64) -> Rates {
        let State {
            place_m,
            velocity_m_s,
        } = *state;
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
pub(super) struct Jet<const N: usize> {
    pub(super) place: [Pair; N],
    pub(super) velocity: [Pair; N],
    /// Leg length and pull.
    length_pull: [Pair; N],
    /// The same, each in both lanes: factors of the convolutions.
    length: [Pair; N],
    pull: [Pair; N],
    ramp: Ramp,
}

/// `1 / n`, for divisions are slow.
const fn reciprocals<const N: usize>() -> [f64; N] {
    let mut table = [0.0; N];
    let mut n = 1;
    while n < N {
        table[n] = 1.0 / n as f64;
        n += 1;
    }
    table
}

impl<const N: usize> Jet<N> {
    const PER: [f64; N] = reciprocals();

    /// Room for a series.
    pub(super) fn new() -> Self {
        Self {
            place: [Pair::ZERO; N],
            velocity: [Pair::ZERO; N],
            length_pull: [Pair::ZERO; N],
            length: [Pair::ZERO; N],
            pull: [Pair::ZERO; N],
            ramp: Ramp {
                length_m: 0.0,
                rate_m_s: 0.0,
            },
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

        let stiffen = (stiffness + pull) * per_length;
        let half_per_length = 0.5 * per_length;
        let mut pushed = stiffness * ramp.rate_m_s;
        for n in 1..N - 1 {
            let (mut lengths_pulls, mut pulled) = (Pair::ZERO, Pair::ZERO);
            for i in 1..n {
                lengths_pulls = lengths_pulls + self.length[i] * self.length_pull[n - i];
                pulled = pulled + self.pull[i] * self.place[n - i];
            }
            let (mut squares, mut dragged) = (Pair::ZERO, Pair::ZERO);
            for i in 1..n.div_ceil(2) {
                squares = squares + self.place[i] * self.place[n - i];
                if DRAG {
                    dragged = dragged + self.velocity[i] * self.velocity[n - i];
                }
            }
            squares = squares + squares;
            dragged = dragged + dragged;
            if n % 2 == 0 {
                squares = squares + self.place[n / 2] * self.place[n / 2];
                dragged = dragged + self.velocity[n / 2] * self.velocity[n / 2];
            }
            let newest = self.place[n];
            let older = squares[0] + squares[1] - lengths_pulls[0];
            let length_n = older * half_per_length + place.dot(newest) * per_length;
            let pull_n = (pushed - lengths_pulls[1]) * per_length - length_n * stiffen;
            pushed = 0.0;
            self.set_length_pull(n, length_n, pull_n);
            let mut force = pulled + newest.scaled(pull) + place.scaled(pull_n);
            if DRAG {
                let newest = velocity * self.velocity[n];
                force = force - drag * (dragged + newest + newest);
            }
            let next = force.scaled(Self::PER[n + 1]);
            self.velocity[n + 1] = next;
            self.place[n + 1] = self.velocity[n].scaled(Self::PER[n + 1]);
        }
    }

    fn set_length_pull(&mut self, n: usize, length: f64, pull: f64) {
        self.length_pull[n] = Pair([length, pull]);
        self.length[n] = Pair([length, length]);
        self.pull[n] = Pair([pull, pull]);
    }

    /// The rates at the start.
    pub(super) fn start(&self) -> Rates {
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
        let reach = |n: usize| (tolerance_m_s / size(n)).powf(1.0 / n as f64);
        reach(N - 1).min(reach(N - 2))
    }

    /// The state `t_s` later.
    pub(super) fn at(&self, t_s: f64) -> State {
        State {
            place_m: value(&self.place, t_s),
            velocity_m_s: value(&self.velocity, t_s),
        }
    }

    /// Leg length less rest length, and its rate.
    pub(super) fn excess(&self, t_s: f64) -> (f64, f64) {
        let (value, slope) = value_and_slope(self.length_pull.iter().map(|c| c[0]), t_s);
        (
            value - (self.ramp.length_m + self.ramp.rate_m_s * t_s),
            slope - self.ramp.rate_m_s,
        )
    }

    /// A velocity and its rate.
    pub(super) fn speed(&self, axis: usize, t_s: f64) -> (f64, f64) {
        value_and_slope(self.velocity.iter().map(|c| c[axis]), t_s)
    }
}

/// Value of the polynomials: even and odd powers in chains of their own, for each waits on its
/// last product.
fn value(p: &[Pair], t: f64) -> Pair {
    let square = t * t;
    let (mut even, mut odd) = (Pair::ZERO, Pair::ZERO);
    let (twos, last) = p.as_chunks::<2>();
    for &last in last {
        even = last;
    }
    for &[a, b] in twos.iter().rev() {
        even = even.scaled(square) + a;
        odd = odd.scaled(square) + b;
    }
    even + odd.scaled(t)
}

/// Value and slope of the polynomial whose coefficients rise with the power.
fn value_and_slope(p: impl DoubleEndedIterator<Item = f64>, t: f64) -> (f64, f64) {
    p.rev()
        .fold((0.0, 0.0), |(sum, slope), c| (sum * t + c, slope * t + sum))
}
