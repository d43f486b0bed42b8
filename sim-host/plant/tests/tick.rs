//! The tick-level plant: against the apex map under the equivalent command, and by itself.

mod common;

use common::{Case, GOLDEN, for_each_row};
use std::f64::consts::FRAC_PI_2;

use leg_plant::{
    Body, Event, EventKind, Flat, Hop, Leg, LegCommand, Medium, NextApex, Outcome, Phase, TickPlant,
};

/// End of a run of ticks.
#[derive(Debug)]
enum End {
    Apex(NextApex),
    Fall,
    SecondTouchdown,
}

/// Drives the tick plant by the command that is equivalent to the apex map's action: the angle is
/// held and the elongation passes 0 at touchdown.
fn drive(case: &Case, hop: &Hop, dt_s: f64) -> End {
    let start = Body { x_m: 0.0, vx_m_s: case.start.vx_m_s, y_m: case.start.y_m, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(case.leg, start);
    let touchdown_s = hop.touchdown.map_or(0.0, |t| t.t_s);
    let mut touchdowns = 0;
    for tick in 0.. {
        let from_s = f64::from(tick) * dt_s;
        let command = LegCommand {
            leg_angle_rad: case.action.touchdown_angle_rad,
            elongation_m: case.action.elongation_speed_m_s * (from_s - touchdown_s),
            elongation_rate_m_s: case.action.elongation_speed_m_s,
        };
        let in_stance = matches!(plant.phase(), Phase::Stance { .. });
        let mut down = in_stance;
        for &Event { kind, t_s, body } in &*plant.step(dt_s, command, case.medium, &Flat) {
            match kind {
                EventKind::Touchdown { foot_x_m, foot_y_m } => {
                    touchdowns += 1;
                    if touchdowns > 1 {
                        return End::SecondTouchdown;
                    }
                    down = true;
                    let expected = hop.touchdown.unwrap();
                    assert!((from_s + t_s - expected.t_s).abs() < 1e-9, "{}", case.line);
                    assert!((foot_x_m - expected.foot_x_m).abs() < 1e-9, "{}", case.line);
                    assert!(foot_y_m.abs() < 1e-12);
                }
                EventKind::LiftOff => {
                    down = false;
                    let expected_s = hop.liftoff_t_s.unwrap();
                    let error_s = from_s + t_s - expected_s;
                    assert!(error_s.abs() < 1e-9, "line {}: {error_s:e} s", case.line);
                }
                EventKind::Apex => {
                    return End::Apex(NextApex {
                        t_s: from_s + t_s,
                        x_m: body.x_m,
                        vx_m_s: body.vx_m_s,
                        y_m: body.y_m,
                        in_stance: down,
                    });
                }
                EventKind::Fall => return End::Fall,
            }
        }
        if from_s > 100.0 {
            return End::Fall;
        }
    }
    unreachable!()
}

#[test]
fn the_equivalent_command_reproduces_the_apex_map() {
    for (dt_s, every) in [(1e-3, 1), (2.5e-4, 4), (0.013, 1), (0.4, 1), (30.0, 1)] {
        let (mut worst, mut compared) = (0.0_f64, 0);
        for_each_row(GOLDEN, |row| {
            if row.line % every != 0 {
                return;
            }
            let case = Case::of(row);
            let hop = case.hop();
            match (drive(&case, &hop, dt_s), hop.outcome) {
                (End::Apex(ours), Outcome::Apex(map)) => {
                    assert_eq!(ours.in_stance, map.in_stance);
                    compared += 1;
                    for (a, b) in [
                        (ours.t_s, map.t_s),
                        (ours.x_m, map.x_m),
                        (ours.vx_m_s, map.vx_m_s),
                        (ours.y_m, map.y_m),
                    ] {
                        worst = worst.max((a - b).abs() / b.abs().max(1.0));
                    }
                }
                (End::Fall, Outcome::Fall) => compared += 1,
                (End::SecondTouchdown, _) if hop.stance_phases > 1 => {}
                (ours, map) => panic!("line {}: {ours:?}, map {map:?}", case.line),
            }
        });
        println!("dt {dt_s} s: {compared} hops, worst difference {worst:.1e}");
        assert!(compared >= 1100 / every);
        assert!(worst < 1e-8, "{worst:e}");
    }
}

#[test]
fn the_friction_of_a_hop_is_the_steepest_force_of_its_stance() {
    let mut compared = 0;
    for_each_row(GOLDEN, |row| {
        let case = Case::of(row);
        let (hop, dt_s) = (case.hop(), 1e-4);
        let friction = case.hopper().friction(case.start, case.action);
        assert_eq!(friction.is_some(), hop.outcome.next().is_some(), "line {}", case.line);
        let (Some(friction), Some(touchdown), 1) = (friction, hop.touchdown, hop.stance_phases)
        else {
            return;
        };
        let start = Body { x_m: 0.0, vx_m_s: case.start.vx_m_s, y_m: case.start.y_m, vy_m_s: 0.0 };
        let mut plant = TickPlant::new(case.leg, start);
        let steepness = |body: Body| (body.x_m - touchdown.foot_x_m).abs() / body.y_m;
        let mut steepest: f64 = 0.0;
        let mut landed = false;
        'hop: for tick in 0.. {
            let command = LegCommand {
                leg_angle_rad: case.action.touchdown_angle_rad,
                elongation_m: case.action.elongation_speed_m_s
                    * (f64::from(tick) * dt_s - touchdown.t_s),
                elongation_rate_m_s: case.action.elongation_speed_m_s,
            };
            for event in &*plant.step(dt_s, command, case.medium, &Flat) {
                landed |= matches!(event.kind, EventKind::Touchdown { .. });
                if landed {
                    steepest = steepest.max(steepness(event.body));
                }
                if landed && !matches!(event.kind, EventKind::Touchdown { .. }) {
                    break 'hop;
                }
            }
            if landed {
                steepest = steepest.max(steepness(plant.body()));
            }
        }
        compared += 1;
        let error = (friction - steepest).abs();
        assert!(error < 2e-3 * steepest.max(0.1), "line {}: {friction}, {steepest}", case.line);
    });
    assert!(compared >= 700, "{compared}");
}

/// Creates a leg at rest above the ground.
fn at_rest(y_m: f64) -> TickPlant {
    let body = Body { x_m: 0.0, vx_m_s: 0.0, y_m, vy_m_s: 0.0 };
    TickPlant::new(Leg::human(), body)
}

fn hold(leg_angle_rad: f64) -> LegCommand {
    LegCommand { leg_angle_rad, elongation_m: 0.0, elongation_rate_m_s: 0.0 }
}

#[test]
fn a_hop_within_one_tick_has_all_its_events_in_order() {
    let events = at_rest(2.0).step(1.2, hold(FRAC_PI_2), Medium::AIR, &Flat);
    let kinds: Vec<_> = events.iter().map(|e| e.kind).collect();
    assert!(matches!(
        kinds[..],
        [EventKind::Touchdown { .. }, EventKind::LiftOff, EventKind::Apex]
    ));
    assert!((events[2].body.y_m - 2.0).abs() < 1e-9);
}

#[test]
fn the_ground_stops_a_swing() {
    // Flat out, the foot is clear; swung down, it would be 0.1 m deep.
    let mut plant = at_rest(0.9);
    assert!(plant.step(0.01, hold(0.1), Medium::AIR, &Flat).is_empty());
    let events = plant.step(0.01, hold(FRAC_PI_2), Medium::AIR, &Flat);
    let EventKind::Touchdown { foot_x_m, foot_y_m } = events[0].kind else { panic!("{events:?}") };
    assert!(foot_y_m.abs() < 1e-12 && foot_x_m < -0.1);
    assert!(events[0].t_s == 0.0);
    let leg_length_m = (events[0].body.x_m - foot_x_m).hypot(events[0].body.y_m);
    assert!((leg_length_m - 1.0).abs() < 1e-12);
}

#[test]
fn a_foot_below_the_ground_carries_no_load() {
    // As in the apex map: too low for the leg, so it falls.
    let mut plant = at_rest(0.9);
    let events = plant.step(1.0, hold(FRAC_PI_2), Medium::AIR, &Flat);
    assert!(matches!(events[..], [Event { kind: EventKind::Fall, .. }]));
    // The added mass moves along, in air too.
    let gravity_m_s2: f64 = 9.81 * 80.0 / 88.0;
    assert!((events[0].t_s - (2.0 * 0.9 / gravity_m_s2).sqrt()).abs() < 1e-12);
    assert_eq!(plant.phase(), Phase::Fallen);
    let fallen = plant.body();
    assert!(plant.step(1.0, hold(0.1), Medium::AIR, &Flat).is_empty());
    assert_eq!(plant.body(), fallen);
}

#[test]
fn the_foot_lands_on_a_slope() {
    let slope = |x_m: f64| 0.2 + 0.1 * x_m;
    let mut plant = at_rest(2.0);
    let events = plant.step(0.6, hold(2.0), Medium::AIR, &slope);
    let EventKind::Touchdown { foot_x_m, foot_y_m } = events[0].kind else { panic!("{events:?}") };
    assert!((foot_y_m - slope(foot_x_m)).abs() < 1e-12);
}

#[test]
fn a_floating_leg_rises_for_ever() {
    let brine = Medium::new(2.0, 9.81).unwrap();
    let mut plant = at_rest(1.5);
    for _ in 0..1000 {
        assert!(plant.step(0.01, hold(1.5), brine, &Flat).is_empty());
    }
    assert!(plant.body().y_m > 10.0);
}

#[test]
fn no_input_panics_or_hangs() {
    let odd = [f64::NAN, f64::INFINITY, -1e300, 1e300, 0.0, -0.0, 1e-310];
    for a in odd {
        for b in odd {
            let mut plant = at_rest(1.2);
            let command = LegCommand { leg_angle_rad: a, elongation_m: b, elongation_rate_m_s: a };
            for dt_s in [0.0, f64::NAN, 0.05, 0.3, 1e9] {
                plant.step(dt_s, command, Medium::WATER, &Flat);
            }
            let mut plant =
                TickPlant::new(Leg::human(), Body { x_m: a, vx_m_s: b, y_m: 1.2, vy_m_s: b });
            plant.step(0.3, hold(1.5), Medium::WATER, &Flat);
        }
    }
}
