//! A leg that hops, integrated in small steps in f64, apart from the filter's own equations.

use core::f64::consts::FRAC_PI_2;

use super::{FOOT_AHEAD, TICK_NS};
use crate::estimator::random::Random;
use crate::leg::LegModel;
use crate::measurement::{Contact, LegPosture, Measurement, Sensors, SpecificImpulse};

const STEPS_A_TICK: u32 = 20;
const GRAVITY: f64 = 9.81;

/// What the sensors of the leg are wrong by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    pub(super) bias_m_s2: [f64; 2],
    pub(super) acceleration_m_s2: f64,
    pub(super) tilt_rad: f64,
    pub(super) length_m: f64,
    pub(super) angle_rad: f64,
    pub(super) contact_late_ticks: usize,
}

impl Errors {
    pub(super) const NONE: Self = Self {
        bias_m_s2: [0.0; 2],
        acceleration_m_s2: 0.0,
        tilt_rad: 0.0,
        length_m: 0.0,
        angle_rad: 0.0,
        contact_late_ticks: 0,
    };
    pub(super) const COMMON: Self = Self {
        bias_m_s2: [0.15, -0.2],
        acceleration_m_s2: 0.05,
        tilt_rad: 0.02,
        length_m: 1e-3,
        angle_rad: 3e-4,
        contact_late_ticks: 2,
    };
}

/// A leg that hops, with a foot put where the velocity stays as it is.
pub(super) struct Hopper {
    pub(super) leg: LegModel,
    pub(super) density_ratio: f64,
    pub(super) position: [f64; 2],
    pub(super) velocity: [f64; 2],
    pub(super) foot: Option<[f64; 2]>,
    /// Rest length beyond that at touchdown, m, in the second half of a stance: makes up for
    /// what drag takes.
    pub(super) extension_m: f64,
    pub(super) impulse: [f64; 2],
    pub(super) contacts: [bool; 8],
    pub(super) tick: u64,
    pub(super) errors: Errors,
    pub(super) random: Random,
}

impl Hopper {
    pub(super) fn new(density_ratio: f64, errors: Errors) -> Self {
        Self {
            leg: LegModel::HUMAN,
            density_ratio,
            position: [0.0, 1.6],
            velocity: [0.4, 0.0],
            foot: None,
            extension_m: 0.0,
            impulse: [30_000.0, -2_000.0],
            contacts: [false; 8],
            tick: 0,
            errors,
            random: Random::new(),
        }
    }

    pub(super) fn angle_rad(&self) -> f64 {
        match self.foot {
            Some([x, y]) => libm::atan2(self.position[1] - y, self.position[0] - x),
            None => FRAC_PI_2 + FOOT_AHEAD * self.velocity[0],
        }
    }

    pub(super) fn length_m(&self) -> f64 {
        let foot = self.foot.map(|[x, y]| [self.position[0] - x, self.position[1] - y]);
        foot.map_or(f64::from(self.leg.rest_length_m), |[x, y]| libm::hypot(x, y))
    }

    /// Returns the acceleration, m/s2.
    pub(super) fn acceleration(&self) -> [f64; 2] {
        let leg = &self.leg;
        let [vx, vy] = self.velocity;
        let mass = f64::from(leg.mass_kg + leg.added_mass_kg);
        let drag = |area: f32, factor: f32, v: f64| {
            0.5 * 1000.0 * self.density_ratio * f64::from(area * factor) * v * v.abs()
        };
        let buoyancy = 1000.0 * self.density_ratio * f64::from(leg.volume_m3) * GRAVITY;
        let mut force = [
            -drag(leg.area_x_m2, leg.drag_x, vx),
            buoyancy - f64::from(leg.mass_kg) * GRAVITY - drag(leg.area_y_m2, leg.drag_y, vy),
        ];
        if self.foot.is_some() {
            let rest = f64::from(leg.rest_length_m) + self.extension_m;
            let spring = f64::from(leg.stiffness_n_m) * (rest - self.length_m());
            let angle = self.angle_rad();
            force[0] += spring * libm::cos(angle);
            force[1] += spring * libm::sin(angle);
        }
        force.map(|force| force / mass)
    }

    pub(super) fn step(&mut self) {
        let dt = 1e-9 * TICK_NS as f64 / f64::from(STEPS_A_TICK);
        let before = self.velocity;
        for _ in 0..STEPS_A_TICK {
            let [ax, ay] = self.acceleration();
            self.velocity[0] += dt * ax;
            self.velocity[1] += dt * ay;
            self.position[0] += dt * self.velocity[0];
            self.position[1] += dt * self.velocity[1];
            let rest = f64::from(self.leg.rest_length_m);
            let angle = self.angle_rad();
            match self.foot {
                None if self.velocity[1] < 0.0 && self.position[1] <= rest * libm::sin(angle) => {
                    self.foot = Some([self.position[0] - rest * libm::cos(angle), 0.0]);
                    self.extension_m = 0.0;
                }
                Some(_) if self.length_m() >= rest + self.extension_m => self.foot = None,
                Some(_) if self.velocity[1] > 0.0 && self.density_ratio > 0.0 => {
                    self.extension_m = 0.04 * self.density_ratio.clamp(0.3, 1.0);
                }
                _ => {}
            }
        }
        self.impulse[0] += self.velocity[0] - before[0];
        self.impulse[1] += self.velocity[1] - before[1] + 1e-9 * TICK_NS as f64 * GRAVITY;
        self.contacts.rotate_right(1);
        self.contacts[0] = self.foot.is_some();
        self.tick += 1;
    }

    pub(super) fn read(&mut self) -> Measurement {
        let errors = self.errors;
        let dt = 1e-9 * TICK_NS as f64;
        let mut noise = |deviation: f64| deviation * f64::from(self.random.normal());
        self.impulse[0] += dt * (errors.bias_m_s2[0] + noise(errors.acceleration_m_s2));
        self.impulse[1] += dt * (errors.bias_m_s2[1] + noise(errors.acceleration_m_s2));
        let (length_off, angle_off) = (noise(errors.length_m), noise(errors.angle_rad));
        let (sine, cosine) = (libm::sin(errors.tilt_rad), libm::cos(errors.tilt_rad));
        let [x, y] = self.impulse;
        // What is read is turned back by the error of the orientation.
        let turned = [cosine * x + sine * y, cosine * y - sine * x];
        let count = |x: f64| (libm::round(x * 65_536.0) as i64) as i32;
        Measurement {
            t_ns: self.tick * TICK_NS,
            vx_m_s: f32::NAN,
            y_m: f32::NAN,
            vy_m_s: f32::NAN,
            contact: Contact::Sensed(self.contacts[errors.contact_late_ticks]),
            density_ratio: None,
            sensors: Sensors {
                impulse: Some(SpecificImpulse(turned.map(count))),
                posture: Some(LegPosture {
                    length_m: (self.length_m() + length_off) as f32,
                    angle_rad: (self.angle_rad() + angle_off - errors.tilt_rad) as f32,
                }),
                ..Sensors::default()
            },
        }
    }
}
