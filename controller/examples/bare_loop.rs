//! The bare control loop, without any message or transport: measurements in, commands out.
//!
//! On a robot, `Leg::measure` reads the sensors and `Leg::actuate` drives hip and spring.
//! Here they act on a spring-mass leg on land, integrated in small steps, so that the loop
//! is closed. Prints every apex. (The package `leg-plant` has the exact plant, in any
//! medium.)
//!
//! `cargo run -p leg-control --example bare_loop`

use leg_control::command::LegCommand;
use leg_control::config::Config;
use leg_control::control::Controller;
use leg_control::leg::LegModel;
use leg_control::measurement::{Contact, Measurement, Sensors};
use leg_control::policy::{Policy, SHIPPED};

const RATE_HZ: u32 = 1_000;
const SET_POINT_M_S: f32 = 0.5;
const DURATION_S: u32 = 20;
/// Integration steps in a tick.
const STEPS: u32 = 100;

/// A point mass on a massless spring leg, in air.
struct Leg {
    model: LegModel,
    t_ns: u64,
    x_m: f32,
    y_m: f32,
    vx_m_s: f32,
    vy_m_s: f32,
    /// Where the foot stands; none in flight.
    foot_x_m: Option<f32>,
}

impl Leg {
    /// Returns what the sensors read.
    fn measure(&self) -> Measurement {
        Measurement {
            t_ns: self.t_ns,
            vx_m_s: self.vx_m_s,
            y_m: self.y_m,
            vy_m_s: self.vy_m_s,
            contact: Contact::Sensed(self.foot_x_m.is_some()),
            density_ratio: None,
            sensors: Sensors::default(),
        }
    }

    /// Drives the leg until the next tick.
    fn actuate(&mut self, command: LegCommand) {
        let dt_s = 1.0 / (RATE_HZ * STEPS) as f32;
        for step in 0..STEPS {
            let ramp_m = command.elongation_m + command.elongation_rate_m_s * dt_s * step as f32;
            self.integrate(command.leg_angle_rad, ramp_m.clamp(0.0, 0.2), dt_s);
        }
        self.t_ns += 1_000_000_000 / u64::from(RATE_HZ);
    }

    fn integrate(&mut self, leg_angle_rad: f32, elongation_m: f32, dt_s: f32) {
        let LegModel { mass_kg, added_mass_kg, stiffness_n_m, rest_length_m, .. } = self.model;
        let (sine, cosine) = leg_angle_rad.sin_cos();
        if self.foot_x_m.is_none() && self.vy_m_s < 0.0 && self.y_m <= rest_length_m * sine {
            self.foot_x_m = Some(self.x_m - rest_length_m * cosine);
        }
        let (mut force_x_n, mut force_y_n) = (0.0, -mass_kg * 9.81);
        if let Some(foot_x_m) = self.foot_x_m {
            let (dx_m, length_m) = (self.x_m - foot_x_m, (self.x_m - foot_x_m).hypot(self.y_m));
            let compression_m = rest_length_m + elongation_m - length_m;
            if compression_m > 0.0 {
                let force_n = stiffness_n_m * compression_m;
                force_x_n += force_n * dx_m / length_m;
                force_y_n += force_n * self.y_m / length_m;
            } else {
                self.foot_x_m = None;
            }
        }
        let moving_kg = mass_kg + added_mass_kg;
        self.vx_m_s += force_x_n / moving_kg * dt_s;
        self.vy_m_s += force_y_n / moving_kg * dt_s;
        self.x_m += self.vx_m_s * dt_s;
        self.y_m += self.vy_m_s * dt_s;
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let policy = Policy::parse(SHIPPED)?;
    let model = policy.manifest().leg;
    let mut controller = Controller::new(policy, Config::at_rate(RATE_HZ)?);
    let mut leg =
        Leg { model, t_ns: 0, x_m: 0.0, y_m: 2.0, vx_m_s: 0.0, vy_m_s: 0.0, foot_x_m: None };

    let (mut apexes, mut last_m_s) = (0, 0.0);
    for _ in 0..RATE_HZ * DURATION_S {
        let measurement = leg.measure();
        let output = controller.step(Some(&measurement), SET_POINT_M_S);
        leg.actuate(output.command);
        let telemetry = output.telemetry;
        if telemetry.apexes > apexes {
            (apexes, last_m_s) = (telemetry.apexes, telemetry.apex_vx_m_s);
            println!(
                "{:6.3} s  apex {apexes:2}: {last_m_s:6.3} m/s at {:.3} m, density ratio {:.3}",
                1e-9 * measurement.t_ns as f64,
                telemetry.apex_y_m,
                telemetry.density_ratio.unwrap_or_default(),
            );
        }
    }
    println!("{apexes} hops in {DURATION_S} s, {:.1} m, {last_m_s:.3} m/s at the end", leg.x_m);
    assert!((last_m_s - SET_POINT_M_S).abs() < 0.05, "{last_m_s} m/s");
    Ok(())
}
