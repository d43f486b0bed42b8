//! Switches to another policy while the leg hops: it takes over at the next apex.
//!
//! A policy is one blob. `Policy::parse` checks it whole, its test vectors included;
//! a damaged one is refused and the policy in force goes on.
//!
//! `cargo run -p leg-control --example swap_policy`

use leg_control::command::Status;
use leg_control::config::Config;
use leg_control::control::Controller;
use leg_control::measurement::{Contact, Measurement, Sensors};
use leg_control::policy::{Policy, SHIPPED, write};

/// A leg that hops in place, with an apex every 500 ms.
fn hopping(tick: u64) -> Measurement {
    let phase = core::f32::consts::TAU * (tick % 500) as f32 / 500.0;
    let y_m = 1.2 + 0.25 * phase.cos();
    Measurement {
        t_ns: tick * 1_000_000,
        vx_m_s: 0.1,
        y_m,
        vy_m_s: -0.25 * 2.0 * core::f32::consts::TAU * phase.sin(),
        contact: Contact::Sensed(y_m < 0.99),
        density_ratio: Some(0.0),
        sensors: Sensors::default(),
    }
}

/// Returns the shipped policy under another name and with stronger cascade gains, written
/// to `buffer`: what a trainer or an upload would bring.
fn other_policy(buffer: &mut [u32]) -> Result<&[u8], Box<dyn std::error::Error>> {
    let shipped = Policy::parse(SHIPPED)?;
    let mut manifest = shipped.manifest().clone();
    manifest.name = "stronger";
    manifest.gains.iter_mut().for_each(|point| point.ki *= 1.5);
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(buffer);
    let length = write(&manifest, shipped.actor().weights(), buffer)?;
    Ok(&buffer[..length])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Words, so that the blob is aligned to 4 bytes.
    let mut buffer = vec![0_u32; 8 * 1024];
    let other = other_policy(&mut buffer)?;
    let mut controller = Controller::new(Policy::parse(SHIPPED)?, Config::at_rate(1_000)?);

    let mut taken_over = None;
    for tick in 0..2_000 {
        if tick == 1_200 {
            controller.swap(Policy::parse(other)?);
            println!("tick {tick}: the other policy waits for the next apex");
        }
        let was_pending = controller.swap_is_pending();
        let output = controller.step(Some(&hopping(tick)), 0.5);
        assert!(tick < 100 || output.status == Status::Running);
        if was_pending && !controller.swap_is_pending() {
            println!("tick {tick}: \"{}\" is in force", controller.policy().manifest().name);
            taken_over = Some(tick);
        }
    }
    assert_eq!(taken_over, Some(1_500), "the apex after the request");

    let mut damaged = other.to_vec();
    damaged[100] ^= 1;
    let error = Policy::parse(&damaged).map(drop).unwrap_err();
    println!("a damaged blob is refused: {error}");
    Ok(())
}
