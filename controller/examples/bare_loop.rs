//! The bare control loop, without any message or transport: measurements in, commands out.
//!
//! The leg is simulated here by `leg-plant`; on a robot, `measure` reads the sensors and
//! `actuate` drives the hip and the spring. Prints every apex. The run starts in water,
//! and the controller estimates that by itself.
//!
//! `cargo run -p leg-control --example bare_loop`

use leg_control::command::LegCommand;
use leg_control::config::Config;
use leg_control::control::Controller;
use leg_control::measurement::{Contact, Measurement};
use leg_control::policy::{Policy, SHIPPED};
use leg_plant::{Body, Flat, Leg, Medium, Phase, TickPlant};

const RATE_HZ: u32 = 1_000;
const SET_POINT_M_S: f32 = 0.5;

/// Returns what the sensors read.
fn measure(plant: &TickPlant, tick: u64) -> Measurement {
    let Body { vx_m_s, y_m, vy_m_s, .. } = plant.body();
    Measurement {
        t_ns: tick * 1_000_000_000 / u64::from(RATE_HZ),
        vx_m_s: vx_m_s as f32,
        y_m: y_m as f32,
        vy_m_s: vy_m_s as f32,
        contact: Contact::Sensed(matches!(plant.phase(), Phase::Stance { .. })),
        density_ratio: None,
    }
}

/// Drives the leg until the next tick.
fn actuate(plant: &mut TickPlant, command: LegCommand) {
    let command = leg_plant::LegCommand {
        leg_angle_rad: command.leg_angle_rad.into(),
        elongation_m: command.elongation_m.into(),
        elongation_rate_m_s: command.elongation_rate_m_s.into(),
    };
    plant.step(1.0 / f64::from(RATE_HZ), command, Medium::WATER, &Flat);
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let policy = Policy::parse(SHIPPED)?;
    let mut controller = Controller::new(policy, Config::at_rate(RATE_HZ)?);
    let start = Body { x_m: 0.0, vx_m_s: 0.0, y_m: 2.0, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(Leg::human(), start);

    let mut apexes = 0;
    for tick in 0..30_000 {
        let measurement = measure(&plant, tick);
        let output = controller.step(Some(&measurement), SET_POINT_M_S);
        actuate(&mut plant, output.command);
        let telemetry = output.telemetry;
        if telemetry.apexes > apexes {
            apexes = telemetry.apexes;
            println!(
                "{:6.3} s  apex {apexes:2}: {:6.3} m/s at {:.3} m, density ratio {:.3}",
                1e-9 * measurement.t_ns as f64,
                telemetry.apex_vx_m_s,
                telemetry.apex_y_m,
                telemetry.density_ratio.unwrap_or_default(),
            );
        }
    }
    let speed_m_s = plant.body().x_m / 30.0;
    println!("{apexes} hops in 30 s, {speed_m_s:.3} m/s on average");
    assert!(plant.phase() != Phase::Fallen, "the leg fell");
    assert!((speed_m_s - f64::from(SET_POINT_M_S)).abs() < 0.1, "{speed_m_s} m/s");
    Ok(())
}
