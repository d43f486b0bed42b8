//! Taylor series of the stance, by recurrence.

use super::elongation::Ramp;

/// Accelerations in stance, per moving mass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    /// Spring stiffness per moving mass.
    pub(super) spring_per_s2: f64,
    /// Drag along x and y.
    pub(super) drag_per_m: [f64; 2],
    /// Weight less buoyancy.
    pub(super) net_gravity_m_s2: f64,
}

/// Place of the mass as seen from the foot, and its velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct State {
    pub(super) place_m: [f64; 2],
    pub(super) velocity_m_s: [f64; 2],
}

/// Coefficients of a stance around one instant, powers of the time in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet<const N: usize> {
    pub(super) x: [f64; N],
    pub(super) y: [f64; N],
    pub(super) vx: [f64; N],
    pub(super) vy: [f64; N],
    /// Squared leg length less squared rest length: rises through 0 at lift-off.
    pub(super) excess: [f64; N],
}

impl<const N: usize> Jet<N> {
    /// Expands the motion around `state`.
    ///
    /// With `q = x^2 + y^2`, `w = q^(-1/2)` and the spring's pull `s = k (L w - 1)` along the
    /// leg, the next coefficients of the velocity are those of
    /// `s (x, y) - c sign(v) v^2 - (0, g)`; those of `w` come from `2 q w' = -q' w`.
    pub(super) fn expand(field: &Field, state: &State, ramp: Ramp) -> Self {
        let (mut x, mut y, mut vx, mut vy) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
        let (mut q, mut w, mut s) = ([0.0; N], [0.0; N], [0.0; N]);
        [x[0], y[0]] = state.place_m;
        [vx[0], vy[0]] = state.velocity_m_s;
        q[0] = x[0] * x[0] + y[0] * y[0];
        w[0] = q[0].sqrt().recip();
        let per_q0 = q[0].recip();
        let k = field.spring_per_s2;
        s[0] = k * (ramp.length_m * w[0] - 1.0);
        let start = [s[0] * x[0], s[0] * y[0] - field.net_gravity_m_s2];
        let drag = [
            field.drag_per_m[0] * direction(vx[0], start[0]),
            field.drag_per_m[1] * direction(vy[0], start[1]),
        ];
        for n in 0..N {
            if n > 0 {
                let per_n = 1.0 / n as f64;
                x[n] = vx[n - 1] * per_n;
                y[n] = vy[n - 1] * per_n;
                let (mut qn, mut wn) = (0.0, 0.0);
                for i in 0..=n {
                    qn += x[i] * x[n - i] + y[i] * y[n - i];
                }
                q[n] = qn;
                for i in 1..=n {
                    wn += (0.5 * i as f64 - n as f64) * q[i] * w[n - i];
                }
                w[n] = wn * per_n * per_q0;
                s[n] = k * (ramp.length_m * w[n] + ramp.rate_m_s * w[n - 1]);
            }
            if n + 1 < N {
                let (mut ax, mut ay) = (0.0, 0.0);
                for i in 0..=n {
                    ax += s[i] * x[n - i] - drag[0] * vx[i] * vx[n - i];
                    ay += s[i] * y[n - i] - drag[1] * vy[i] * vy[n - i];
                }
                if n == 0 {
                    ay -= field.net_gravity_m_s2;
                }
                let per = 1.0 / (n + 1) as f64;
                vx[n + 1] = ax * per;
                vy[n + 1] = ay * per;
            }
        }
        let mut excess = q;
        excess[0] -= ramp.length_m * ramp.length_m;
        excess[1] -= 2.0 * ramp.length_m * ramp.rate_m_s;
        excess[2] -= ramp.rate_m_s * ramp.rate_m_s;
        Self {
            x,
            y,
            vx,
            vy,
            excess,
        }
    }

    /// Longest step whose last terms stay below `tolerance_m_s`.
    pub(super) fn reach_s(&self, tolerance_m_s: f64) -> f64 {
        let size = |n: usize| self.vx[n].abs().max(self.vy[n].abs());
        let reach = |n: usize| (tolerance_m_s / size(n)).powf(1.0 / n as f64);
        reach(N - 1).min(reach(N - 2))
    }

    /// The state `t_s` later.
    pub(super) fn at(&self, t_s: f64) -> State {
        use super::roots::value;
        State {
            place_m: [value(&self.x, t_s), value(&self.y, t_s)],
            velocity_m_s: [value(&self.vx, t_s), value(&self.vy, t_s)],
        }
    }
}

/// Sign of a velocity just after this instant.
fn direction(velocity: f64, acceleration: f64) -> f64 {
    if velocity == 0.0 {
        acceleration.signum()
    } else {
        velocity.signum()
    }
}
