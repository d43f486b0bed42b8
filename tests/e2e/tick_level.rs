//! The controller at a fixed rate with the tick-level plant, compared with the actor on the
//! apex map: the difference vanishes as the rate grows.

use leg_control::actor::Observation;
use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_control::wire_controller::WireController;
use leg_plant::{
    Action, Apex, Body, EventKind, Flat, Hopper, Leg, LegCommand, Medium, Phase, TickPlant,
};

/// Error of a hop's velocity from the rounding of samples to f32 alone, m/s.
const F32_FLOOR_M_S: f64 = 5e-6;
/// Duration of each run, s.
const RUN_S: u64 = 16;

/// Parameters of a run.
#[derive(Clone, Copy, Debug)]
struct Run {
    rate_hz: u32,
    density_ratio: f64,
    /// Flags of the sensors that the leg has.
    senses: u16,
}

impl Run {
    fn medium(&self) -> Medium {
        Medium::new(self.density_ratio, 9.81).unwrap()
    }

    fn sample(&self, seq: u64, plant: &TickPlant) -> Sample {
        let body = plant.body();
        let contact = if plant.phase() == Phase::Flight { 0 } else { flags::IN_CONTACT };
        Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::STATE_SENSED | self.senses | contact,
                run_id: 1,
                seq,
                t_ns: seq * 1_000_000_000 / u64::from(self.rate_hz),
            },
            set_point_m_s: 0.5,
            vx_m_s: body.vx_m_s as f32,
            y_m: body.y_m as f32,
            vy_m_s: body.vy_m_s as f32,
            leg_length_m: plant.leg_length_m() as f32,
            density_ratio: self.density_ratio as f32,
            ..Sample::default()
        }
    }

    /// Returns the next apex on the apex map under the actor's action at this one, observed
    /// with the velocity offset of the cascade.
    fn on_the_map(&self, policy: &Policy<'_>, apex: Apex, offset_m_s: f32) -> Option<Apex> {
        let action = policy.actor().act(Observation {
            apex_vx_m_s: apex.vx_m_s as f32 - offset_m_s,
            apex_y_m: apex.y_m as f32,
            density_ratio: self.density_ratio as f32,
        });
        let action = Action {
            touchdown_angle_rad: action.touchdown_angle_rad.into(),
            elongation_speed_m_s: action.elongation_speed_m_s.into(),
        };
        Hopper::new(&Leg::human(), self.medium()).hop(apex, action).outcome.next()
    }

    /// Returns for each hop of a run the difference of the apex velocity from the apex map,
    /// m/s; infinite where only one of the two falls.
    fn differences(&self, policy: &Policy<'_>, start: Apex) -> Vec<f64> {
        let config = Config::at_rate(self.rate_hz).unwrap();
        let mut controller = WireController::new(policy.clone(), config);
        let body = Body { x_m: 0.0, vx_m_s: start.vx_m_s, y_m: start.y_m, vy_m_s: 0.0 };
        let mut plant = TickPlant::new(Leg::human(), body);
        let mut apex = start;
        let mut found = Vec::new();
        for seq in 0..u64::from(self.rate_hz) * RUN_S {
            let command = controller.tick(Some(&self.sample(seq, &plant)));
            let dt_s = 1.0 / f64::from(self.rate_hz);
            for event in plant.step(dt_s, as_leg_command(&command), self.medium(), &Flat).iter() {
                let reached = match event.kind {
                    EventKind::Fall => None,
                    EventKind::Apex => {
                        Some(Apex { vx_m_s: event.body.vx_m_s, y_m: event.body.y_m })
                    }
                    EventKind::Touchdown { .. } | EventKind::LiftOff => continue,
                };
                let expected = self.on_the_map(policy, apex, command.velocity_offset_m_s);
                found.push(match (expected, reached) {
                    (Some(expected), Some(reached)) => (expected.vx_m_s - reached.vx_m_s).abs(),
                    (None, None) => 0.0,
                    _ => f64::INFINITY,
                });
                let Some(reached) = reached else { return found };
                apex = reached;
            }
        }
        found
    }

    /// Returns hops, median difference and largest difference in m/s over many starts.
    fn differences_over_starts(&self) -> (usize, f64, f64) {
        let policy = Policy::parse(SHIPPED).unwrap();
        let mut all = Vec::new();
        for vx_m_s in [-2.5, -1.0, -0.2, 0.4, 1.3, 3.0] {
            for y_m in [1.4, 2.0, 3.5] {
                all.extend(self.differences(&policy, Apex { vx_m_s, y_m }));
            }
        }
        all.sort_by(f64::total_cmp);
        (all.len(), all[all.len() / 2], all[all.len() - 1])
    }
}

fn as_leg_command(command: &Command) -> LegCommand {
    LegCommand {
        leg_angle_rad: command.leg_angle_rad.into(),
        elongation_m: command.elongation_m.into(),
        elongation_rate_m_s: command.elongation_rate_m_s.into(),
    }
}

fn compare(density_ratio: f64, senses: u16) -> [f64; 3] {
    [1_000, 2_000, 4_000].map(|rate_hz| {
        let run = Run { rate_hz, density_ratio, senses };
        let (hops, median, worst) = run.differences_over_starts();
        println!("{run:?}: {hops} hops, median {median:.1e} m/s, worst {worst:.1e}");
        assert!(hops > 100, "only {hops} hops");
        assert!(worst.is_finite(), "the loop and the map do not agree on a fall");
        assert!(median <= 0.005, "{median} m/s");
        median
    })
}

#[test]
fn the_loop_converges_to_the_apex_map_as_the_rate_grows() {
    for density_ratio in [0.0, 0.3, 1.0] {
        let [coarse, middle, fine] = compare(density_ratio, flags::CONTACT_SENSED);
        let converges = fine < middle && middle < coarse;
        // In air the density estimate changes no bit of the action.
        assert!(converges || coarse < F32_FLOOR_M_S, "{coarse} {middle} {fine}");
    }
}

#[test]
fn with_a_measured_density_the_loop_is_exact_to_the_rounding_of_samples() {
    for density_ratio in [0.0, 0.3, 1.0] {
        let medians = compare(density_ratio, flags::CONTACT_SENSED | flags::DENSITY_SENSED);
        assert!(medians.iter().all(|&m| m < F32_FLOOR_M_S), "{medians:?}");
    }
}

#[test]
fn detects_contact_from_the_leg_length_without_a_contact_sensor() {
    for density_ratio in [0.0, 0.3, 1.0] {
        compare(density_ratio, flags::LEG_LENGTH_SENSED);
    }
}
