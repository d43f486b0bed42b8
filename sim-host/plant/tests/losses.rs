//! Damping, the mass of the foot, and friction: against an independent integration, and by what
//! must hold for any of them.

use std::f64::consts::FRAC_PI_2;

use leg_plant::{Body, EventKind, Flat, Leg, LegCommand, Losses, Medium, Phase, TickPlant};
use proptest::prelude::*;

fn losses(damping_n_s_m: f64, foot_mass_kg: f64, friction: Option<f64>) -> Losses {
    let losses = Losses::NONE.with_damping(damping_n_s_m).unwrap();
    let losses = losses.with_foot_mass(foot_mass_kg).unwrap();
    friction.map_or(losses, |friction| losses.with_friction(friction).unwrap())
}

fn command(leg_angle_rad: f64) -> LegCommand {
    LegCommand { leg_angle_rad, elongation_m: 0.0, elongation_rate_m_s: 0.0 }
}

/// A leg that falls from rest or from a moving apex onto level ground.
#[derive(Clone, Copy, Debug)]
struct Drop {
    losses: Losses,
    density_ratio: f64,
    vx_m_s: f64,
    y_m: f64,
    angle_rad: f64,
    /// Rate at which the leg elongates, from the start of the run on.
    rate_m_s: f64,
}

impl Drop {
    fn medium(&self) -> Medium {
        Medium::new(self.density_ratio, 9.81).unwrap()
    }

    /// Plays until the first lift-off; returns the bodies at touchdown and lift-off with their
    /// times, and how far the foot has slid.
    fn play(&self, dt_s: f64) -> Option<Played> {
        let start = Body { x_m: 0.0, vx_m_s: self.vx_m_s, y_m: self.y_m, vy_m_s: 0.0 };
        let mut plant = TickPlant::new(Leg::human(), start).with_losses(self.losses);
        let mut down = None;
        for tick in 0..(5.0 / dt_s) as u32 {
            let from_s = f64::from(tick) * dt_s;
            let command = LegCommand {
                elongation_m: self.rate_m_s * from_s,
                elongation_rate_m_s: self.rate_m_s,
                ..command(self.angle_rad)
            };
            let events = plant.step(dt_s, command, self.medium(), &Flat);
            for event in events.iter() {
                let at = (from_s + event.t_s, event.body);
                match event.kind {
                    EventKind::Touchdown { .. } => down = Some(at),
                    EventKind::LiftOff => {
                        return Some(Played { down: down?, up: at, slid_m: plant.slid_m() });
                    }
                    EventKind::Apex => {}
                    EventKind::Fall => return None,
                }
            }
        }
        None
    }

    /// Integrates the same stance from its touchdown by many small Runge-Kutta steps, in units of
    /// force; returns duration, body and slide.
    fn integrate(&self, (down_s, down): (f64, Body), h: f64) -> (f64, Body, f64) {
        let p = *Leg::human().parameters();
        let (moving_kg, density) = (p.mass_kg + p.added_mass_kg, 1000.0 * self.density_ratio);
        let (foot_kg, c) = (self.losses.foot_mass_kg(), self.losses.damping_n_s_m());
        let mu = self.losses.friction().unwrap_or(f64::INFINITY);
        let elongation = |t: f64| (self.rate_m_s * (down_s + t)).min(p.max_elongation_m);
        let rate = |t: f64| {
            if self.rate_m_s * (down_s + t) < p.max_elongation_m { self.rate_m_s } else { 0.0 }
        };
        // x, y, vx, vy, foot x, foot vx.
        let push = |s: &[f64; 6], t: f64| {
            let (dx, dy) = (s[0] - s[4], s[1]);
            let l = dx.hypot(dy);
            let dl = (dx * (s[2] - s[5]) + dy * s[3]) / l;
            let f = p.stiffness_n_m * (p.rest_length_m + elongation(t) - l) + c * (rate(t) - dl);
            (f, [f * dx / l, f * dy / l])
        };
        let slope = |s: &[f64; 6], t: f64, slides: f64| {
            let (_, [fx, fy]) = push(s, t);
            let drag_x = 0.5 * density * p.area_x_m2 * p.drag_x * s[2] * s[2].abs();
            let drag_y = 0.5 * density * p.area_y_m2 * p.drag_y * s[3] * s[3].abs();
            let weight = 9.81 * (p.mass_kg - density * p.volume_m3);
            let foot = if slides == 0.0 {
                0.0
            } else {
                (-fx - slides * mu * (fy + foot_kg * 9.81)) / foot_kg
            };
            let (ax, ay) = ((fx - drag_x) / moving_kg, (fy - drag_y - weight) / moving_kg);
            [s[2], s[3], ax, ay, s[5], foot]
        };
        let foot_vx = if foot_kg > 0.0 {
            (down.vx_m_s.abs() - mu * down.vy_m_s.abs()).max(0.0).copysign(down.vx_m_s)
        } else {
            0.0
        };
        let foot_x = down.x_m - p.rest_length_m * self.angle_rad.cos();
        let mut s = [down.x_m, down.y_m, down.vx_m_s, down.vy_m_s, foot_x, foot_vx];
        let (mut slides, mut slid, mut t) =
            (if foot_vx == 0.0 { 0.0 } else { foot_vx.signum() }, 0.0, 0.0);
        loop {
            let add = |k: &[f64; 6], by: f64| {
                let mut at = s;
                at.iter_mut().zip(k).for_each(|(a, k)| *a += by * k);
                at
            };
            let k1 = slope(&s, t, slides);
            let k2 = slope(&add(&k1, 0.5 * h), t + 0.5 * h, slides);
            let k3 = slope(&add(&k2, 0.5 * h), t + 0.5 * h, slides);
            let k4 = slope(&add(&k3, h), t + h, slides);
            let mut next = s;
            for (i, n) in next.iter_mut().enumerate() {
                *n += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
            let (before, (after, [fx, fy])) = (push(&s, t).0, push(&next, t + h));
            slid += (next[4] - s[4]).abs();
            if after <= 0.0 && t > 0.0 {
                let part = before / (before - after);
                let body = Body {
                    x_m: s[0] + part * (next[0] - s[0]),
                    y_m: s[1] + part * (next[1] - s[1]),
                    vx_m_s: s[2] + part * (next[2] - s[2]),
                    vy_m_s: s[3] + part * (next[3] - s[3]),
                };
                let both = moving_kg + foot_kg;
                let foot = foot_kg * (s[5] + part * (next[5] - s[5]));
                let vx_m_s = (moving_kg * body.vx_m_s + foot) / both;
                let vy_m_s = moving_kg * body.vy_m_s / both;
                return (t + part * h, Body { vx_m_s, vy_m_s, ..body }, slid);
            }
            (s, t) = (next, t + h);
            let holds = fx.abs() <= mu * (fy + foot_kg * 9.81);
            if slides == 0.0 && !holds {
                slides = -fx.signum();
            } else if slides != 0.0 && s[5] * slides < 0.0 {
                s[5] = 0.0;
                slides = if holds { 0.0 } else { -fx.signum() };
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Played {
    down: (f64, Body),
    up: (f64, Body),
    slid_m: f64,
}

fn distance(a: &Body, b: &Body) -> f64 {
    let pairs = [(a.x_m, b.x_m), (a.y_m, b.y_m), (a.vx_m_s, b.vx_m_s), (a.vy_m_s, b.vy_m_s)];
    pairs.iter().fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()))
}

#[test]
fn a_stance_with_losses_agrees_with_an_independent_integration() {
    let drop = |losses, density_ratio, vx_m_s, angle_rad, rate_m_s| Drop {
        losses,
        density_ratio,
        vx_m_s,
        y_m: 2.0,
        angle_rad,
        rate_m_s,
    };
    for (case, slides) in [
        (drop(losses(50.0, 0.0, None), 0.0, 0.5, 1.62, 0.0), false),
        (drop(losses(1000.0, 0.0, None), 1.0, -1.0, 1.5, 0.0), false),
        (drop(losses(300.0, 2.0, None), 0.5, 2.0, 1.7, 0.2), false),
        // The foot slides behind the body, before it, and from the touchdown on.
        (drop(losses(0.0, 2.0, Some(0.2)), 0.0, 1.5, 1.6, 0.0), true),
        (drop(losses(50.0, 5.0, Some(0.25)), 0.0, 0.5, 1.85, 0.0), true),
        (drop(losses(50.0, 2.0, Some(0.3)), 1.0, -6.0, 1.4, 0.1), true),
    ] {
        for dt_s in [1e-3, 2.5e-4, 0.013, 5.0] {
            let played = case.play(dt_s).unwrap_or_else(|| panic!("{case:?} falls"));
            let (t_s, body, slid_m) = case.integrate(played.down, 1e-6);
            let late_s = played.up.0 - played.down.0 - t_s;
            let off = distance(&played.up.1, &body);
            // Where a foot begins or ceases to slide, the other method is off by up to a step.
            let tolerance = if slides { 1e-7 } else { 1e-9 };
            println!("dt {dt_s}: {off:.1e}, {late_s:.1e} s, slid {slid_m:.4} m");
            assert!(off < tolerance && late_s.abs() < tolerance, "{case:?}: {off:e} {late_s:e}");
            // The other method counts the whole of its last step.
            assert!((played.slid_m - slid_m).abs() < 2e-5, "{case:?}: {played:?} {slid_m}");
            assert_eq!(slid_m > 1e-4, slides, "{case:?}: {slid_m}");
        }
    }
}

/// Plays a hopping run and returns every number of it.
fn trace(losses: Losses, density_ratio: f64) -> Vec<u64> {
    let medium = Medium::new(density_ratio, 9.81).unwrap();
    let start = Body { x_m: 0.0, vx_m_s: 0.4, y_m: 2.0, vy_m_s: 0.0 };
    let mut plant = TickPlant::new(Leg::human(), start).with_losses(losses);
    let mut all = Vec::new();
    for tick in 0..4000 {
        let phase = f64::from(tick % 100) / 100.0;
        let command = LegCommand {
            elongation_m: 0.1 * phase,
            elongation_rate_m_s: 1.0,
            ..command(FRAC_PI_2 + 0.04 * phase)
        };
        for event in plant.step(1e-3, command, medium, &Flat).iter() {
            all.push(event.t_s.to_bits());
        }
        let Body { x_m, vx_m_s, y_m, vy_m_s } = plant.body();
        all.extend([x_m, vx_m_s, y_m, vy_m_s, plant.leg_length_m()].map(f64::to_bits));
    }
    all
}

#[test]
fn friction_that_holds_changes_no_bit() {
    for density_ratio in [0.0, 1.0] {
        let plain = trace(Losses::NONE, density_ratio);
        assert_eq!(trace(losses(0.0, 0.0, Some(2.0)), density_ratio), plain);
        assert_ne!(trace(losses(1.0, 0.0, None), density_ratio), plain);
        assert_ne!(trace(losses(0.0, 0.1, None), density_ratio), plain);
        // A foot with a mass slides no more under the same coefficient.
        let heavy = trace(losses(0.0, 1.0, None), density_ratio);
        assert_eq!(trace(losses(0.0, 1.0, Some(2.0)), density_ratio), heavy);
    }
}

#[test]
fn less_friction_slides_further() {
    // The leg stands 0.23 rad off the vertical, and is compressed for some 30 ms.
    let slid_m = |friction: f64| {
        let start = Body { x_m: 0.0, vx_m_s: 0.0, y_m: 1.8, vy_m_s: 0.0 };
        let losses = losses(20.0, 2.0, Some(friction));
        let mut plant = TickPlant::new(Leg::human(), start).with_losses(losses);
        plant.step(0.46, command(1.8), Medium::AIR, &Flat);
        assert!(matches!(plant.phase(), Phase::Stance { .. }), "{friction}: {plant:?}");
        plant.slid_m()
    };
    let slid: Vec<f64> = (1..=40).map(|i| slid_m(0.05 * f64::from(i))).collect();
    assert!(slid.windows(2).all(|pair| pair[0] >= pair[1]), "{slid:?}");
    assert!(slid[0] > 0.03 && slid[1] < slid[0] && slid[39] == 0.0, "{slid:?}");
}

#[test]
fn a_foot_whose_mass_goes_to_0_slides_as_a_massless_one_loses_its_load() {
    let up = |foot_mass_kg: f64| {
        let drop = Drop {
            losses: losses(0.0, foot_mass_kg, Some(0.1)),
            density_ratio: 0.0,
            vx_m_s: 1.2,
            y_m: 2.0,
            angle_rad: 1.6,
            rate_m_s: 0.0,
        };
        drop.play(1e-3).unwrap()
    };
    let massless = up(0.0);
    assert!(massless.up.1.vy_m_s < -1.0, "it loses its load while the leg is being compressed");
    let off: Vec<f64> = [0.1, 0.01, 0.001].map(|kg| distance(&up(kg).up.1, &massless.up.1)).into();
    assert!(off[0] > 2.0 * off[1] && off[1] > 2.0 * off[2] && off[2] < 0.2, "{off:?}");
}

#[test]
fn a_massless_foot_outside_the_cone_carries_nothing() {
    let lands = |friction: f64, angle_rad: f64| Drop {
        losses: losses(0.0, 0.0, Some(friction)),
        density_ratio: 0.0,
        vx_m_s: 0.0,
        y_m: 1.5,
        angle_rad,
        rate_m_s: 0.0,
    };
    // The edge of the cone is at atan 0.5 = 0.4636 rad from the vertical.
    let played = lands(0.5, FRAC_PI_2 + 0.47).play(1e-3).unwrap();
    assert_eq!(played.up, played.down);
    let played = lands(0.5, FRAC_PI_2 + 0.4).play(1e-3).unwrap();
    assert!(played.up.0 > played.down.0 + 0.01);
}

#[test]
fn a_lift_off_shares_the_momentum_with_the_foot() {
    let drop = |foot_mass_kg| Drop {
        losses: losses(0.0, foot_mass_kg, None),
        density_ratio: 0.0,
        vx_m_s: 0.0,
        y_m: 2.0,
        angle_rad: FRAC_PI_2,
        rate_m_s: 0.0,
    };
    // Both fall equally fast but for the added mass, which moves along and weighs nothing.
    let fallen_m_s = |kg: f64| (2.0 * 9.81 * (80.0 + kg) / (88.0 + kg)).sqrt();
    for foot_mass_kg in [0.0, 2.0, 10.0] {
        let played = drop(foot_mass_kg).play(1e-3).unwrap();
        let down_m_s = fallen_m_s(foot_mass_kg);
        assert!((played.down.1.vy_m_s + down_m_s).abs() < 1e-12);
        let up_m_s = down_m_s * 88.0 / (88.0 + foot_mass_kg);
        assert!((played.up.1.vy_m_s - up_m_s).abs() < 1e-9, "{played:?}");
    }
}

#[test]
fn a_drive_stands_still_above_its_force_and_goes_on_below_it() {
    let lengths_m = |limit_n: Option<f64>| {
        let start = Body { x_m: 0.0, vx_m_s: 0.0, y_m: 1.5, vy_m_s: 0.0 };
        let losses =
            limit_n.map_or(Losses::NONE, |limit_n| Losses::NONE.with_drive_force(limit_n).unwrap());
        let mut plant = TickPlant::new(Leg::human(), start).with_losses(losses);
        let (mut down_tick, mut forces_n, mut rests_m) = (None, Vec::new(), Vec::new());
        for tick in 0..900 {
            let since_s = down_tick.map_or(-1.0, |down| 1e-3 * f64::from(tick - down));
            let command = LegCommand {
                elongation_m: 0.5 * since_s,
                elongation_rate_m_s: 0.5,
                ..command(FRAC_PI_2)
            };
            let before = plant.clone();
            plant.step(1e-3, command, Medium::AIR, &Flat);
            if let (Phase::Stance { .. }, Phase::Stance { .. }) = (before.phase(), plant.phase()) {
                down_tick = down_tick.or(Some(tick));
                // The spring's force follows from the acceleration; of the body only gravity acts.
                let fall_m_s = plant.body().vy_m_s - before.body().vy_m_s;
                forces_n.push(88.0 * fall_m_s / 1e-3 + 9.81 * 80.0);
                rests_m.push(forces_n[forces_n.len() - 1] / 20_000.0 + plant.leg_length_m());
            }
        }
        (forces_n, rests_m, plant.body())
    };
    let (_, free, highest) = lengths_m(None);
    let (forces_n, limited, lower) = lengths_m(Some(2000.0));
    assert_eq!(lengths_m(Some(1e5)).1, free, "a limit that is not reached changes no bit");
    assert!(free.iter().zip(&limited).any(|(free, limited)| free > &(limited + 0.02)));
    for (force, pair) in forces_n.iter().zip(limited.windows(2)) {
        let grown_m = pair[1] - pair[0];
        // The force was found as a mean over a tick.
        if *force > 2200.0 {
            assert!(grown_m.abs() < 1e-4, "{force} N: {grown_m} m");
        }
    }
    assert!(lower != highest);
}

/// Returns the energy of body and foot, J. In stance the weight of the foot does no work.
fn energy_j(plant: &TickPlant, medium: Medium) -> f64 {
    let p = plant.leg().parameters();
    let Body { vx_m_s, vy_m_s, y_m, .. } = plant.body();
    let (moving_kg, foot_kg) = (p.mass_kg + p.added_mass_kg, plant.losses().foot_mass_kg());
    let weight_kg = p.mass_kg - 1000.0 * medium.density_ratio() * p.volume_m3;
    let g = medium.gravity_m_s2();
    let squared = vx_m_s * vx_m_s + vy_m_s * vy_m_s;
    let body_j = 0.5 * moving_kg * squared + weight_kg * g * y_m;
    if matches!(plant.phase(), Phase::Stance { .. }) {
        let short_m = p.rest_length_m - plant.leg_length_m();
        let foot_j = 0.5 * foot_kg * plant.foot_vx_m_s() * plant.foot_vx_m_s();
        body_j + 0.5 * p.stiffness_n_m * short_m * short_m + foot_j
    } else {
        body_j + 0.5 * foot_kg * squared + foot_kg * g * y_m
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_loss_adds_energy(
        damping in prop_oneof![Just(0.0), 0.0..1000.0],
        foot_kg in prop_oneof![Just(0.0), 0.001..10.0],
        friction in prop_oneof![Just(None), (0.05..2.0).prop_map(Some)],
        vx in -6.0..6.0, y in 1.1..5.0, tilt in -0.5..0.5, rho in prop_oneof![Just(0.0), 0.0..1.0],
    ) {
        let medium = Medium::new(rho, 9.81).unwrap();
        let start = Body { x_m: 0.0, vx_m_s: vx, y_m: y, vy_m_s: 0.0 };
        let mut plant =
            TickPlant::new(Leg::human(), start).with_losses(losses(damping, foot_kg, friction));
        let mut before_j = energy_j(&plant, medium);
        for _ in 0..3000 {
            // A swing takes no work in this model, so the foot has the height of the body in
            // flight, and that of the ground in stance.
            let mut lifted_m = 0.0;
            for event in plant.step(1e-3, command(FRAC_PI_2 + tilt), medium, &Flat).iter() {
                match event.kind {
                    EventKind::LiftOff => lifted_m += event.body.y_m,
                    EventKind::Touchdown { .. } => lifted_m -= event.body.y_m,
                    EventKind::Apex | EventKind::Fall => {}
                }
            }
            if plant.phase() == Phase::Fallen {
                break;
            }
            let after_j = energy_j(&plant, medium);
            let most_j = before_j + 9.81 * foot_kg * lifted_m + 1e-6;
            prop_assert!(after_j <= most_j, "{after_j} J after {before_j} J");
            before_j = after_j;
        }
    }

    #[test]
    fn no_leg_with_losses_panics_or_hangs(
        damping in 0.0..=1000.0, foot_kg in prop_oneof![Just(0.0), Just(0.001), 0.001..=10.0],
        friction in prop_oneof![Just(None), (0.05..=2.0).prop_map(Some)],
        vx in any::<f64>(), vy in any::<f64>(), y in any::<f64>(), alpha in any::<f64>(),
        rate in any::<f64>(), dt in any::<f64>(), tame in any::<[bool; 6]>(),
    ) {
        let or = |tame: bool, value: f64, by: f64| if tame { value } else { by };
        let body = Body {
            x_m: 0.0,
            vx_m_s: or(tame[0], 1.0, vx),
            y_m: or(tame[1], 1.5, y),
            vy_m_s: or(tame[2], 0.0, vy),
        };
        let losses = losses(damping, foot_kg, friction);
        let mut plant = TickPlant::new(Leg::human(), body).with_losses(losses);
        let rate_m_s = or(tame[4], 0.5, rate);
        let command = LegCommand {
            leg_angle_rad: or(tame[3], 1.6, alpha),
            elongation_m: -rate_m_s,
            elongation_rate_m_s: rate_m_s,
        };
        for dt_s in [0.4, or(tame[5], 1e-3, dt), 0.4, 1e-3] {
            plant.step(dt_s, command, Medium::WATER, &Flat);
        }
    }
}

#[test]
fn a_loss_out_of_its_range_is_refused_by_name() {
    for (refused, message) in [
        (
            Losses::NONE.with_damping(-1.0),
            "damping_n_s_m is -1; it must be a number from 0 to 1000",
        ),
        (Losses::NONE.with_damping(f64::NAN), "damping_n_s_m is NaN; it must be a number from 0"),
        (
            Losses::NONE.with_foot_mass(11.0),
            "foot_mass_kg is 11; it must be a number from 0.001 to",
        ),
        (Losses::NONE.with_foot_mass(1e-9), "foot_mass_kg is 0.000000001; it must be"),
        (
            Losses::NONE.with_drive_force(1e6),
            "drive_force_n is 1000000; it must be a number from 0",
        ),
        (Losses::NONE.with_friction(0.0), "friction is 0; it must be a number from 0.05 to 2"),
    ] {
        let refusal = refused.unwrap_err().to_string();
        assert!(refusal.contains(message), "{refusal}");
    }
    assert_eq!(Losses::default(), losses(0.0, 0.0, None));
}
