//! Faults of actuators.

use crate::faults::stage::actuator::{Backlash, Bandwidth, DeadTime, Drive, Lag, Limit, Saturate};
use crate::faults::stage::{FaultPipeline, FaultPlan, FaultStage, Window};
use leg_control::wire::{Command, Header, WIRE_VERSION};

fn command(seq: u64, angle_rad: f32, elongation_m: f32, rate_m_s: f32) -> Command {
    Command {
        header: Header { version: WIRE_VERSION, seq, run_id: 1, ..Header::default() },
        leg_angle_rad: angle_rad,
        elongation_m,
        elongation_rate_m_s: rate_m_s,
        ..Command::default()
    }
}

/// Passes one command a tick through an actuator fault.
fn acted(
    stage: impl FaultStage<Command> + 'static,
    command: impl Fn(u64) -> Command,
    ticks: u64,
) -> Vec<Command> {
    let mut pipeline = FaultPipeline::default();
    pipeline.push(0, Window::ALWAYS, Box::new(stage));
    (0..ticks).filter_map(|tick| pipeline.pass(tick, Some(command(tick)))).collect()
}

#[test]
fn a_lag_reaches_63_percent_of_a_step_after_its_time_constant() {
    let step = |tick| command(tick, if tick == 0 { 1.0 } else { 2.0 }, 0.0, 0.0);
    let received = acted(Lag::new(0.02, 1e-3), step, 101);
    assert!(
        (received[20].leg_angle_rad - 1.632_120_6).abs() < 1e-5,
        "{}",
        received[20].leg_angle_rad
    );
    assert!((received[100].leg_angle_rad - 1.993_262).abs() < 1e-5);
    // The lag follows a ramp one time constant late, at the rate of the ramp.
    let ramp = |tick| command(tick, 1.0, 1e-3 * tick as f32, 1.0);
    let received = acted(Lag::new(0.02, 1e-3), ramp, 300);
    assert!((received[299].elongation_m - (0.299 - 0.02)).abs() < 1e-3, "{:?}", received[299]);
    assert!((received[299].elongation_rate_m_s - 1.0).abs() < 1e-3);
}

#[test]
fn a_saturated_actuator_never_exceeds_its_limit() {
    let wild = |tick: u64| {
        let swing = if tick.is_multiple_of(7) { 2.5 } else { 0.9 };
        command(tick, swing, 0.02 * (tick % 5) as f32 - 0.03, 30.0)
    };
    let angle = acted(Saturate::new(Limit::Angle(0.3), 1e-3), wild, 200);
    let upright = core::f32::consts::FRAC_PI_2;
    assert!(angle.iter().all(|c| (c.leg_angle_rad - upright).abs() <= 0.300_001));
    let rate = acted(Saturate::new(Limit::AngleRate(5.0), 1e-3), wild, 200);
    assert!(rate.windows(2).all(|p| (p[0].leg_angle_rad - p[1].leg_angle_rad).abs() < 5.001e-3));
    let push = acted(Saturate::new(Limit::ElongationRate(2.0), 1e-3), wild, 200);
    // Below 0 the elongation is 0: what counts is the way over each tick, and between two.
    let ends_m = |c: &Command| {
        let start_m = f64::from(c.elongation_m);
        [start_m, start_m + 1e-3 * f64::from(c.elongation_rate_m_s)].map(|m| m.max(0.0))
    };
    let ends: Vec<[f64; 2]> = push.iter().map(ends_m).collect();
    assert!(ends[1..].iter().all(|[start_m, end_m]| (end_m - start_m).abs() < 2.001e-3));
    assert!(ends.windows(2).all(|pair| (pair[1][0] - pair[0][0]).abs() < 2.001e-3));
    // A command within the limit is unchanged to the last bit.
    let calm = |tick| command(tick, 1.5, -0.01 + 1e-3 * tick as f32, 1.0);
    let received = acted(Saturate::new(Limit::ElongationRate(2.0), 1e-3), calm, 50);
    assert!(received.iter().enumerate().all(|(tick, c)| *c == calm(tick as u64)));
}

/// Returns what the stages make of commands that neither move nor are late.
fn at_rest(stages: Vec<Box<dyn FaultStage<Command>>>) -> u64 {
    let still = |tick| command(tick, 1.5, -0.02, 0.0);
    let mut plan = FaultPlan::default();
    for stage in stages {
        plan.commands.push(0, Window::ALWAYS, stage);
    }
    for tick in 0..50 {
        assert_eq!(plan.commands.pass(tick, Some(still(tick))), Some(still(tick)));
    }
    plan.count(0)
}

#[test]
fn actuators_without_dead_time_or_play_change_no_bit_and_none_moves_a_leg_at_rest() {
    let moving = |tick: u64| {
        command(tick, 1.0 + 0.37 * (tick % 9) as f32, 0.013 * (tick % 7) as f32 - 0.04, 0.7)
    };
    let unchanged = |received: Vec<Command>| {
        received.iter().enumerate().all(|(tick, c)| *c == moving(tick as u64))
    };
    assert!(unchanged(acted(DeadTime::new(0, 1e-3), moving, 200)));
    assert!(unchanged(acted(Backlash::new(Drive::Angle, 0.0, 1e-3), moving, 200)));
    assert!(unchanged(acted(Backlash::new(Drive::Elongation, 0.0, 1e-3), moving, 200)));
    let touched = at_rest(vec![
        Box::new(DeadTime::new(5, 1e-3)),
        Box::new(Backlash::new(Drive::Angle, 0.1, 1e-3)),
        Box::new(Backlash::new(Drive::Elongation, 0.1, 1e-3)),
    ]);
    assert_eq!(touched, 0);
}

#[test]
fn an_actuator_passes_its_bandwidth_with_3_decibel_less_and_does_not_overshoot() {
    // 20 Hz in ticks of 0.1 ms, so that holding the command over a tick hardly counts.
    let amplitude = |hz: f64| {
        let sine = |tick: u64| {
            let t_s = 1e-4 * tick as f64;
            command(
                tick,
                (1.5 + 0.1 * libm::sin(core::f64::consts::TAU * hz * t_s)) as f32,
                0.0,
                0.0,
            )
        };
        let received = acted(Bandwidth::new(20.0, 1e-4), sine, 20_000);
        let angles = received[10_000..].iter().map(|c| f64::from(c.leg_angle_rad) - 1.5);
        angles.fold(0.0, f64::max) / 0.1
    };
    assert!((amplitude(20.0) - 0.5_f64.sqrt()).abs() < 2e-3, "{}", amplitude(20.0));
    assert!(amplitude(1.0) > 0.998 && amplitude(200.0) < 0.03);

    let step = |tick| command(tick, if tick == 0 { 1.0 } else { 2.0 }, 0.0, 0.0);
    let received = acted(Bandwidth::new(20.0, 1e-3), step, 100);
    let angles: Vec<f32> = received.iter().map(|c| c.leg_angle_rad).collect();
    assert!(angles.is_sorted() && angles.iter().all(|&angle| angle <= 2.0), "{angles:?}");
    // 1 - (1 + w t) exp(-w t) with w = 2 pi 20 / 0.6436.
    let after_10_ms = 2.0 - (1.0 + 1.952_55) * (-1.952_55_f64).exp();
    assert!((f64::from(angles[10]) - after_10_ms).abs() < 1e-4, "{} {after_10_ms}", angles[10]);
    // A ramp is followed two time constants late, at its rate.
    let ramp = |tick| command(tick, 1.0, 1e-3 * tick as f32, 1.0);
    let last = acted(Bandwidth::new(20.0, 1e-3), ramp, 300)[299];
    assert!((last.elongation_m - (0.299 - 2.0 / 195.255)).abs() < 2e-3, "{last:?}");
    assert!((last.elongation_rate_m_s - 1.0).abs() < 1e-3, "{last:?}");
}

#[test]
fn dead_time_delays_the_set_points_and_not_the_stamp() {
    let moving = |tick| command(tick, 1.0 + 0.01 * tick as f32, 0.002 * tick as f32, 2.0);
    for (tick, c) in acted(DeadTime::new(5, 1e-3), moving, 50).iter().enumerate() {
        let old = moving((tick as u64).saturating_sub(5));
        assert_eq!(c.header.seq, tick as u64);
        assert_eq!(c.leg_angle_rad, old.leg_angle_rad);
        assert_eq!((c.elongation_m, c.elongation_rate_m_s), (old.elongation_m, 2.0));
    }
    // While messages are lost, the ramp of the last one goes on.
    let mut pipeline = FaultPipeline::default();
    pipeline.push(0, Window::ALWAYS, Box::new(DeadTime::new(2, 1e-3)));
    let received = [0, 1, 8].map(|tick| pipeline.pass(tick, Some(moving(tick))).unwrap());
    let expected_m = 0.002 + 2.0 * 5e-3;
    assert!((received[2].elongation_m - expected_m).abs() < 1e-6, "{received:?}");
}

#[test]
fn backlash_follows_half_a_gap_behind_and_holds_where_the_drive_turns() {
    let there_and_back = |tick: u64| {
        let out = if tick < 100 { tick } else { 200 - tick };
        command(
            tick,
            1.0 + 0.01 * out as f32,
            1e-3 * out as f32,
            if tick < 100 { 1.0 } else { -1.0 },
        )
    };
    let angles = acted(Backlash::new(Drive::Angle, 0.1, 1e-3), there_and_back, 200);
    assert_eq!(angles[4].leg_angle_rad, 1.0, "within the gap");
    assert!((angles[100].leg_angle_rad - 1.95).abs() < 1e-6);
    assert_eq!(angles[109].leg_angle_rad, angles[100].leg_angle_rad, "crosses the gap back");
    assert!((angles[150].leg_angle_rad - 1.55).abs() < 1e-6);
    assert!(
        angles
            .iter()
            .enumerate()
            .all(|(t, c)| c.elongation_m == there_and_back(t as u64).elongation_m)
    );
    let pushes = acted(Backlash::new(Drive::Elongation, 0.02, 1e-3), there_and_back, 200);
    assert!((pushes[50].elongation_m - 0.04).abs() < 1e-6, "{:?}", pushes[50]);
    assert!((pushes[50].elongation_rate_m_s - 1.0).abs() < 1e-3);
    assert_eq!(pushes[110].elongation_rate_m_s, 0.0, "{:?}", pushes[110]);
}
