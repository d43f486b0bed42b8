//! What `cargo xtask budget` counts: each function called `measured_...` once or
//! more, of which the costliest call counts. The calls are those of the
//! shipped policy and of a leg that falls, bounces and falls again.
#![no_std]
#![no_main]

mod image;

use core::hint::black_box;
use cortex_m_rt::entry;
use leg_control::actor::{Action, Actor, Observation};
use leg_control::config::Config;
use leg_control::policy::{ParseError, Policy, SHIPPED};
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;

/// Exit status: the shipped policy is refused.
const NO_POLICY: i32 = 2;
/// Exit status: the leg did not do what is to be measured.
const NO_SUCH_TICK: i32 = 3;

#[inline(never)]
fn measured_parse(blob: &'static [u8]) -> Result<Policy<'static>, ParseError> {
    Policy::parse(blob)
}

#[inline(never)]
fn measured_inference(actor: &Actor<'_>, observation: Observation) -> Action {
    actor.act(observation)
}

#[inline(never)]
fn measured_inference_without_tanh(actor: &Actor<'_>, input: [f32; 3]) -> [f32; 2] {
    actor.sums(input)
}

#[inline(never)]
fn measured_inference_without_tanh_portable(actor: &Actor<'_>, input: [f32; 3]) -> [f32; 2] {
    actor.sums_portable(input)
}

// Functions that are alike would be merged into one: these differ in their arguments.

#[inline(never)]
fn measured_tick_in_flight(controller: &mut WireController<'_>, sample: &Sample) -> Command {
    controller.tick(Some(sample))
}

#[inline(never)]
fn measured_tick_in_stance(sample: &Sample, controller: &mut WireController<'_>) -> Command {
    controller.tick(Some(sample))
}

#[inline(never)]
fn measured_tick_at_apex(sample: Option<&Sample>, controller: &mut WireController<'_>) -> Command {
    controller.tick(sample)
}

#[entry]
fn main() -> ! {
    let Ok(policy) = measured_parse(black_box(SHIPPED)) else {
        semihosting::process::exit(NO_POLICY)
    };
    let actor = black_box(policy.actor());
    let input = black_box([0.3, 1.5, 0.4]);
    let [apex_vx_m_s, apex_y_m, density_ratio] = input;
    black_box(measured_inference(actor, Observation { apex_vx_m_s, apex_y_m, density_ratio }));
    black_box(measured_inference_without_tanh(actor, input));
    black_box(measured_inference_without_tanh_portable(actor, input));
    hop(&policy);
    semihosting::process::exit(0)
}

/// A leg that stands upright, 80 kg on 20,000 N/m, falls from 1.3 m in air; until
/// it has passed an apex and bounced anew.
fn hop(policy: &Policy<'static>) {
    let Ok(config) = Config::at_rate(1_000) else { semihosting::process::exit(NO_SUCH_TICK) };
    let mut controller = WireController::new(policy.clone(), config);
    let mut apexes = 0;
    let (mut y_m, mut vy_m_s) = (1.3_f32, 0.0_f32);
    for seq in 0..1_200 {
        let stance = y_m < 1.0;
        let spring_m_s2 = if stance { 20_000.0 / 80.0 * (1.0 - y_m) } else { 0.0 };
        vy_m_s += 1e-3 * (spring_m_s2 - 80.0 / 88.0 * 9.81);
        y_m += 1e-3 * vy_m_s;
        let contact = if stance { flags::IN_CONTACT } else { 0 };
        let sample = black_box(Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::CONTACT_SENSED | contact,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000,
            },
            set_point_m_s: 0.5,
            vx_m_s: 0.4,
            y_m,
            vy_m_s,
            ..Sample::default()
        });
        // A second controller on the same samples tells the kinds of tick apart.
        let at_apex = controller.clone().tick(Some(&sample)).apexes > apexes;
        let command = match (at_apex, stance) {
            (true, _) => measured_tick_at_apex(Some(&sample), black_box(&mut controller)),
            (false, true) => measured_tick_in_stance(&sample, black_box(&mut controller)),
            (false, false) => measured_tick_in_flight(black_box(&mut controller), &sample),
        };
        apexes = black_box(command).apexes;
    }
    // The start counts as one, and one must have been passed.
    if apexes < 2 {
        semihosting::process::exit(NO_SUCH_TICK)
    }
}
