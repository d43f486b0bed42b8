//! What `cargo xtask budget` counts: each function called `measured_...` once or
//! more, of which the costliest call counts. The calls are those of the
//! shipped policy and of a leg that falls, bounces and falls again.
#![no_std]
#![no_main]

mod image;

use core::hint::black_box;
use cortex_m_rt::entry;
use leg_control::actor::{Action, Activation, Activations, Actor, Observation};
use leg_control::config::{Config, Estimation};
use leg_control::estimator::{SensorNoise, StateNoise};
use leg_control::policy::{ParseError, Policy, SHIPPED};
use leg_control::wire::{Command, Header, Sample, SensorReadings, WIRE_VERSION, flags};
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

/// Defines functions that infer with other activations. Functions that are alike would be
/// merged into one: these differ in a number.
macro_rules! measured_activations {
    ($($name:ident: $number:literal $activation:expr),+ $(,)?) => {
        $(#[inline(never)]
        fn $name(actor: &Actor<'_>, observation: Observation) -> Action {
            black_box($number);
            actor.act(observation)
        })+

        /// Runs the shipped weights with each activation.
        fn infer_with_each(policy: &Policy<'static>, observation: Observation) {
            let manifest = policy.manifest();
            $(
                let activations = Activations { hidden: $activation, ..manifest.activations };
                let actor = Actor::new(
                    manifest.widths.clone(),
                    activations,
                    manifest.observation,
                    manifest.action,
                    policy.actor().weights(),
                );
                let Ok(actor) = actor else { semihosting::process::exit(NO_POLICY) };
                black_box($name(black_box(&actor), observation));
            )+
        }
    };
}

measured_activations! {
    measured_inference_leaky_relu: 0_u32 Activation::LeakyRelu(0.01),
    measured_inference_elu: 1_u32 Activation::Elu(1.0),
    measured_inference_hidden_tanh: 2_u32 Activation::Tanh,
    measured_inference_silu: 3_u32 Activation::Silu,
    measured_inference_gelu_tanh: 4_u32 Activation::GeluTanh,
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

/// A tick of a law on an estimate.
type EstimatedTick = fn(&mut WireController<'_>, &Sample, f32) -> Command;

#[inline(never)]
fn measured_estimated_tick_in_flight(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(0_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[inline(never)]
fn measured_estimated_tick_in_stance(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(1_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[inline(never)]
fn measured_estimated_tick_with_an_action(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(2_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[inline(never)]
fn measured_inertial_tick_in_flight(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(3_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[inline(never)]
fn measured_inertial_tick_in_stance(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(4_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[inline(never)]
fn measured_inertial_tick_with_an_action(
    controller: &mut WireController<'_>,
    sample: &Sample,
    set_point_m_s: f32,
) -> Command {
    // Functions that are alike would be merged into one.
    black_box(5_u8);
    controller.tick_at(Some(sample), Some(set_point_m_s))
}

#[entry]
fn main() -> ! {
    let Ok(policy) = measured_parse(black_box(SHIPPED)) else {
        semihosting::process::exit(NO_POLICY)
    };
    let actor = black_box(policy.actor());
    let input = black_box([0.3, 1.5, 0.4]);
    let [apex_vx_m_s, apex_y_m, density_ratio] = input;
    let observation = Observation { apex_vx_m_s, apex_y_m, density_ratio };
    black_box(measured_inference(actor, observation));
    infer_with_each(&policy, observation);
    black_box(measured_inference_without_tanh(actor, input));
    black_box(measured_inference_without_tanh_portable(actor, input));
    hop(&policy);
    hop_estimated(
        &policy,
        Estimation::StateChannels(StateNoise::default()),
        [
            measured_estimated_tick_in_flight,
            measured_estimated_tick_in_stance,
            measured_estimated_tick_with_an_action,
        ],
    );
    hop_estimated(
        &policy,
        Estimation::Inertial(SensorNoise::default()),
        [
            measured_inertial_tick_in_flight,
            measured_inertial_tick_in_stance,
            measured_inertial_tick_with_an_action,
        ],
    );
    semihosting::process::exit(0)
}

/// A leg that stands upright, 80 kg on 20,000 N/m, and falls from 1.3 m in air.
struct Bouncer {
    seq: u64,
    y_m: f32,
    vy_m_s: f32,
    /// Specific impulse along y, 2^-16 m/s.
    impulse: i32,
}

impl Bouncer {
    const fn new() -> Self {
        Self { seq: 0, y_m: 1.3, vy_m_s: 0.0, impulse: 0 }
    }

    /// Returns the sample of the next tick, with the readings of these flags beside contact, and
    /// whether the leg is in stance.
    fn tick(&mut self, sensed: u16) -> (Sample, bool) {
        let stance = self.y_m < 1.0;
        let spring_m_s2 = if stance { 20_000.0 / 80.0 * (1.0 - self.y_m) } else { 0.0 };
        let ay_m_s2 = spring_m_s2 - 80.0 / 88.0 * 9.81;
        self.vy_m_s += 1e-3 * ay_m_s2;
        self.impulse += (65.536 * (ay_m_s2 + 9.81)) as i32;
        self.y_m += 1e-3 * self.vy_m_s;
        let contact = if stance { flags::IN_CONTACT } else { 0 };
        let sample = Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::CONTACT_SENSED | sensed | contact,
                run_id: 1,
                seq: self.seq,
                t_ns: self.seq * 1_000_000,
            },
            set_point_m_s: 0.5,
            vx_m_s: 0.4,
            y_m: self.y_m,
            vy_m_s: self.vy_m_s,
            leg_length_m: if stance { self.y_m } else { 1.0 },
            density_ratio: 0.0,
            sensors: SensorReadings {
                leg_angle_rad: core::f32::consts::FRAC_PI_2,
                impulse: [0, self.impulse],
                ..SensorReadings::default()
            },
        };
        self.seq += 1;
        (black_box(sample), stance)
    }
}

/// What a leg with raw sensors senses.
const RAW_SENSED: u16 = flags::LEG_LENGTH_SENSED
    | flags::LEG_ANGLE_SENSED
    | flags::IMPULSE_SENSED
    | flags::PITCH_SENSED
    | flags::PITCH_RATE_SENSED;

/// Until the leg has passed an apex and bounced anew.
const TICKS: u32 = 1_200;

/// The law on the readings.
fn hop(policy: &Policy<'static>) {
    let Ok(config) = Config::at_rate(1_000) else { semihosting::process::exit(NO_SUCH_TICK) };
    let mut controller = WireController::new(policy.clone(), config);
    let mut leg = Bouncer::new();
    let mut apexes = 0;
    for _ in 0..TICKS {
        let (sample, stance) = leg.tick(flags::STATE_SENSED);
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

/// The law on an estimate; `ticks` are those in flight, in stance, and with an action.
fn hop_estimated(policy: &Policy<'static>, estimation: Estimation, ticks: [EstimatedTick; 3]) {
    let config = Config::at_rate(1_000).and_then(|config| config.with_estimation(estimation));
    let Ok(config) = config else { semihosting::process::exit(NO_SUCH_TICK) };
    let mut controller = WireController::new(policy.clone(), config);
    let [in_flight, in_stance, with_an_action] = ticks;
    let sensed = match estimation {
        Estimation::Inertial(_) => RAW_SENSED,
        _ => flags::STATE_SENSED,
    };
    let mut leg = Bouncer::new();
    let (mut apexes, mut actions, mut angle_rad) = (0, 0, 0.0);
    for tick in 0..TICKS {
        let (sample, is_loaded) = leg.tick(sensed);
        // Another set-point at each tick, so that each action is another one.
        let set_point_m_s = 1e-3 * (tick % 1_000) as f32;
        let mut other = controller.clone();
        let ahead = other.tick_at(Some(&sample), Some(set_point_m_s));
        let stands = other.estimate().is_some_and(|estimate| estimate.in_stance);
        let computes = !stands && ahead.leg_angle_rad != angle_rad || ahead.apexes > apexes;
        let tick = match (computes, is_loaded) {
            (true, _) => with_an_action,
            (false, true) => in_stance,
            (false, false) => in_flight,
        };
        let command = tick(black_box(&mut controller), &sample, set_point_m_s);
        actions += u32::from(computes);
        (apexes, angle_rad) = (black_box(command).apexes, command.leg_angle_rad);
    }
    if apexes < 2 || actions < 20 {
        semihosting::process::exit(NO_SUCH_TICK)
    }
}
