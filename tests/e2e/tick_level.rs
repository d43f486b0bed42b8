//! The controller at a fixed rate against the tick-level plant does what the
//! actor does on the apex map, ever more closely as the rate grows.

use controller::control::{Config, Controller};
use controller::policy::{self, Policy};
use controller::wire::{Header, Sample, WIRE_VERSION, flags};
use sim_host::plant::{
    Action, Apex, Body, EventKind, Flat, Hopper, Leg, LegCommand, Medium, TickPlant,
};

/// What f32 samples alone make of a hop's velocity, m/s.
const F32_FLOOR_M_S: f64 = 5e-6;

/// One run: starts at an apex, hops for `seconds`; returns per hop the
/// difference of the apex velocity from what the apex map gives for the same
/// start and the actor's own action there, m/s.
fn differences(
    policy: &Policy<'_>,
    rate_hz: u32,
    start: Apex,
    medium: Medium,
    told: bool,
) -> Vec<f64> {
    let config = Config::at_rate(rate_hz).unwrap();
    let tick_s = 1.0 / f64::from(rate_hz);
    let mut controller = Controller::new(policy.clone(), config);
    let body = Body { x_m: 0.0, vx_m_s: start.vx_m_s, y_m: start.y_m, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(Leg::human(), body);
    let hopper = Hopper::new(&Leg::human(), medium);
    let mut apex = start;
    let mut found = Vec::new();
    for seq in 0..u64::from(rate_hz) * 16 {
        let body = plant.body();
        let in_flight = plant.phase() == sim_host::plant::Phase::Flight;
        let contact = if in_flight { 0 } else { flags::IN_CONTACT };
        let density = if told { flags::DENSITY_SENSED } else { 0 };
        let sample = Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::CONTACT_SENSED | contact | density,
                epoch: 1,
                seq,
                t_ns: seq * config.tick_ns,
            },
            set_point_m_s: 0.5,
            vx_m_s: body.vx_m_s as f32,
            y_m: body.y_m as f32,
            vy_m_s: body.vy_m_s as f32,
            leg_length_m: 0.0,
            density_ratio: medium.density_ratio() as f32,
        };
        let command = controller.tick(Some(&sample));
        let leg_command = LegCommand {
            leg_angle_rad: command.leg_angle_rad.into(),
            elongation_m: command.elongation_m.into(),
            elongation_rate_m_s: command.elongation_rate_m_s.into(),
        };
        for event in plant.step(tick_s, leg_command, medium, &Flat).iter() {
            match event.kind {
                EventKind::Fall => return found,
                EventKind::Apex => {
                    let seen = controller::actor::Observation {
                        apex_vx_m_s: apex.vx_m_s as f32 - command.velocity_offset_m_s,
                        apex_y_m: apex.y_m as f32,
                        density_ratio: medium.density_ratio() as f32,
                    };
                    let action = policy.actor().act(seen);
                    let on_map = hopper.hop(
                        apex,
                        Action {
                            alpha_rad: action.touchdown_angle_rad.into(),
                            rs_m_s: action.elongation_speed_m_s.into(),
                        },
                    );
                    // An apex in stance is no start of a hop on the map.
                    let Some(next) = on_map.outcome.next() else { return found };
                    found.push((next.vx_m_s - event.body.vx_m_s).abs());
                    apex = Apex { vx_m_s: event.body.vx_m_s, y_m: event.body.y_m };
                }
                _ => {}
            }
        }
    }
    found
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn the_loop_reproduces_the_apex_map_and_closes_in_on_it_as_the_rate_grows() {
    let policy = Policy::parse(policy::SHIPPED).unwrap();
    for density_ratio in [0.0, 0.3, 1.0] {
        let medium = Medium::new(density_ratio, 9.81).unwrap();
        for told in [true, false] {
            let at_rate = |rate_hz| {
                let mut all = Vec::new();
                for vx_m_s in [-2.5, -1.0, -0.2, 0.4, 1.3, 3.0] {
                    for y_m in [1.4, 2.0, 3.5] {
                        let start = Apex { vx_m_s, y_m };
                        all.extend(differences(&policy, rate_hz, start, medium, told));
                    }
                }
                (all.len(), median(all))
            };
            let found = [1_000, 2_000, 4_000].map(at_rate);
            println!(
                "density {density_ratio} (told: {told}): hops and median difference {found:?}"
            );
            let [(hops, coarse), (_, middle), (_, fine)] = found;
            assert!(hops > 100, "only {hops} hops");
            assert!(coarse <= 0.005, "{coarse} m/s at 1 kHz");
            // Told the density, the loop is exact up to the rounding of its f32 samples.
            let closes_in = fine < middle && middle < coarse;
            assert!(closes_in || coarse < F32_FLOOR_M_S, "{found:?}");
        }
    }
}
