use std::time::Duration;

use proptest::prelude::*;

use super::actuator::{Lag, Limit, Saturate};
use super::message::{Corrupt, Delay, Drop, Duplicate, Freeze, Ice, Reorder};
use super::sensor::{ContactNoise, Ill, Reading, Sensor, Stuck, StuckAt};
use super::*;
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_host::{Link, memory};

const TICKS: u64 = 2000;

fn sample(seq: u64) -> Sample {
    Sample {
        header: Header { version: WIRE_VERSION, seq, run_id: 1, ..Header::default() },
        vx_m_s: seq as f32,
        ..Sample::default()
    }
}

fn dice() -> Dice {
    Dice::new(7, 0)
}

/// What comes at each tick of what is sent at each.
fn through(stage: impl Stage<Sample> + 'static) -> (Vec<Option<Sample>>, u64) {
    through_in(Window::ALWAYS, stage)
}

fn through_in(window: Window, stage: impl Stage<Sample> + 'static) -> (Vec<Option<Sample>>, u64) {
    let mut plan = Plan::default();
    plan.samples.push(3, window, Box::new(stage));
    let came = (0..TICKS).map(|tick| plan.samples.pass(tick, Some(sample(tick)))).collect();
    assert_eq!(plan.count(2), 0, "another fault's");
    (came, plan.count(3))
}

fn seqs(came: &[Option<Sample>]) -> Vec<Option<u64>> {
    came.iter().map(|message| message.map(|message| message.header.seq)).collect()
}

#[test]
fn a_share_is_lost_and_what_comes_is_whole() {
    let (came, count) = through(Drop::new(0.1, dice()));
    let lost = came.iter().filter(|message| message.is_none()).count();
    assert_eq!(lost as u64, count);
    assert!((150..250).contains(&lost), "{lost} of {TICKS}");
    for (tick, message) in came.iter().enumerate() {
        assert!(message.is_none_or(|message| message == sample(tick as u64)));
    }
    assert_eq!(through(Drop::new(0.0, dice())).1, 0);
    assert_eq!(through(Drop::new(1.0, dice())).1, TICKS);
}

#[test]
fn a_fault_acts_in_its_window_only() {
    let (came, count) = through_in(Window { from: 100, until: 200 }, Drop::new(1.0, dice()));
    let lost: Vec<usize> = (0..came.len()).filter(|&tick| came[tick].is_none()).collect();
    assert_eq!(lost, (100..200).collect::<Vec<_>>());
    assert_eq!(count, 100);
}

#[test]
fn a_delay_is_so_many_ticks() {
    let (came, count) = through(Delay::new(3, 0, dice()));
    for (tick, seq) in seqs(&came).into_iter().enumerate() {
        assert_eq!(seq, (tick as u64).checked_sub(3));
    }
    assert_eq!(count, TICKS);
    // When it ends, what is under way and late comes no more: newer ones are before it.
    let (came, _) = through_in(Window { from: 0, until: 10 }, Delay::new(3, 0, dice()));
    let seqs = seqs(&came);
    assert_eq!(&seqs[8..14], [5, 6, 10, 11, 12, 13].map(Some));
}

#[test]
fn jitter_is_within_its_ticks_and_puts_messages_out_of_order() {
    let (came, _) = through(Delay::new(1, 4, dice()));
    let seqs = seqs(&came);
    let late = |(tick, seq): (usize, &Option<u64>)| seq.map(|seq| tick as u64 - seq);
    let late: Vec<u64> = seqs.iter().enumerate().filter_map(late).collect();
    assert!(late.iter().all(|late| (1..=5).contains(late)));
    assert!((1..=5).all(|ticks| late.contains(&ticks)), "each of them comes about");
    let came: Vec<u64> = seqs.into_iter().flatten().collect();
    assert!(came.windows(2).any(|pair| pair[0] > pair[1]), "some are overtaken");
}

#[test]
fn duplicates_come_a_tick_later_and_the_overtaken_after_their_successor() {
    let (came, count) = through(Duplicate::new(0.05, dice()));
    let seqs_of = |came: &[Option<Sample>]| seqs(came);
    let twice = seqs_of(&came).windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert_eq!(twice as u64, count);
    assert!((60..140).contains(&twice), "{twice}");

    let (came, count) = through(Reorder::new(0.05, dice()));
    let seqs = seqs(&came);
    let mut overtaken = 0;
    for tick in 0..seqs.len() - 2 {
        if seqs[tick].is_none() {
            overtaken += 1;
            let tick = tick as u64;
            assert_eq!(seqs[tick as usize + 1..][..2], [Some(tick + 1), Some(tick)]);
        }
    }
    assert!(overtaken > 50 && overtaken + 1 >= count, "{overtaken} of {count}");
}

#[test]
fn a_frozen_link_says_the_same_or_nothing() {
    for (ice, window) in [
        (Ice::Last, Window { from: 50, until: 51 }),
        (Ice::Nothing, Window { from: 50, until: 51 }),
    ] {
        let (came, count) = through_in(window, Freeze::new(20, 1.0, ice, dice()));
        let seqs = seqs(&came);
        let frozen = (ice == Ice::Last).then_some(49);
        assert_eq!(seqs[50..70], [frozen; 20]);
        assert_eq!((seqs[49], seqs[70], count), (Some(49), Some(70), 20));
    }
}

#[test]
fn sensors_are_noisy_biased_blind_and_stuck() {
    let values = |came: &[Option<Sample>]| -> Vec<f64> {
        let error = |(i, m): (usize, &Option<Sample>)| f64::from(m.unwrap().vx_m_s) - i as f64;
        came.iter().enumerate().map(error).collect()
    };
    let (came, count) = through(Sensor::new(&[Reading::Vx], Ill::Noise(0.25), dice()));
    let errors = values(&came);
    let mean = errors.iter().sum::<f64>() / TICKS as f64;
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / TICKS as f64).sqrt();
    assert!(mean.abs() < 0.02 && (deviation - 0.25).abs() < 0.02, "{mean} {deviation}");
    assert_eq!(count, TICKS);
    assert!(came.iter().flatten().all(|sample| sample.vy_m_s == 0.0), "another reading");

    let (came, _) = through(Sensor::new(&[Reading::Vx], Ill::Bias(-0.5), dice()));
    assert!(values(&came).iter().all(|&error| error == -0.5));

    let (came, count) = through(Sensor::new(Reading::MOTION, Ill::NotANumber(0.2), dice()));
    let blind = came.iter().flatten().filter(|sample| sample.vx_m_s.is_nan()).count();
    assert!(blind as u64 == count && (300..500).contains(&blind), "{blind}");

    let window = Window { from: 10, until: 11 };
    let stuck = Stuck::new(StuckAt::Readings(&[Reading::Vx]), 5, 1.0, dice());
    let (came, count) = through_in(window, stuck);
    let vx: Vec<f32> = came[9..16].iter().map(|sample| sample.unwrap().vx_m_s).collect();
    assert_eq!(vx, [9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 15.0]);
    assert_eq!((count, came[14].unwrap().header.seq), (5, 14), "only the reading is old");

    let (came, count) = through(ContactNoise::new(0.5, dice()));
    let turned = came.iter().flatten().filter(|s| s.header.flags == flags::IN_CONTACT).count();
    assert!(turned as u64 == count && (900..1100).contains(&turned));
}

fn command(seq: u64, angle_rad: f32, elongation_m: f32, rate_m_s: f32) -> Command {
    Command {
        header: Header { version: WIRE_VERSION, seq, run_id: 1, ..Header::default() },
        leg_angle_rad: angle_rad,
        elongation_m,
        elongation_rate_m_s: rate_m_s,
        ..Command::default()
    }
}

/// What becomes of commands, one a tick.
fn acted(
    stage: impl Stage<Command> + 'static,
    command: impl Fn(u64) -> Command,
    ticks: u64,
) -> Vec<Command> {
    let mut chain = Chain::default();
    chain.push(0, Window::ALWAYS, Box::new(stage));
    (0..ticks).filter_map(|tick| chain.pass(tick, Some(command(tick)))).collect()
}

#[test]
fn a_lag_has_done_63_percent_of_a_step_after_its_time_constant() {
    let step = |tick| command(tick, if tick == 0 { 1.0 } else { 2.0 }, 0.0, 0.0);
    let came = acted(Lag::new(0.02, 1e-3), step, 101);
    assert!((came[20].leg_angle_rad - 1.632_120_6).abs() < 1e-5, "{}", came[20].leg_angle_rad);
    assert!((came[100].leg_angle_rad - 1.993_262).abs() < 1e-5);
    // A ramp is followed a time constant behind, and continued at its own rate.
    let ramp = |tick| command(tick, 1.0, 1e-3 * tick as f32, 1.0);
    let came = acted(Lag::new(0.02, 1e-3), ramp, 300);
    assert!((came[299].elongation_m - (0.299 - 0.02)).abs() < 1e-3, "{:?}", came[299]);
    assert!((came[299].elongation_rate_m_s - 1.0).abs() < 1e-3);
}

#[test]
fn a_limit_is_never_exceeded() {
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
    // What is within the limit is left alone, to the last bit.
    let calm = |tick| command(tick, 1.5, -0.01 + 1e-3 * tick as f32, 1.0);
    let came = acted(Saturate::new(Limit::ElongationRate(2.0), 1e-3), calm, 50);
    assert!(came.iter().enumerate().all(|(tick, c)| *c == calm(tick as u64)));
}

fn bits_apart(a: &Sample, b: &Sample) -> u32 {
    let bytes = |s: &Sample| {
        let h = s.header;
        let figures = [s.set_point_m_s, s.vx_m_s, s.y_m, s.vy_m_s, s.leg_length_m, s.density_ratio];
        let mut words = vec![u64::from(h.version) << 16 | u64::from(h.flags)];
        words.extend([u64::from(h.run_id), h.seq, h.t_ns]);
        words.extend(figures.map(|figure| u64::from(figure.to_bits())));
        words
    };
    bytes(a).into_iter().zip(bytes(b)).map(|(a, b)| (a ^ b).count_ones()).sum()
}

#[test]
fn corruption_reaches_every_bit_and_turns_over_as_many_as_told() {
    let (came, count) = through(Corrupt::new(0.5, 1, dice()));
    let hits = |(tick, m): (usize, &Option<Sample>)| bits_apart(&m.unwrap(), &sample(tick as u64));
    let apart: Vec<u32> = came.iter().enumerate().map(hits).collect();
    assert!(apart.iter().all(|&bits| bits <= 1));
    assert_eq!(apart.iter().map(|&bits| u64::from(bits)).sum::<u64>(), count);
    for bit in 0..Sample::BITS {
        let mut flipped = sample(0);
        flipped.flip(bit);
        assert_eq!(bits_apart(&flipped, &sample(0)), 1, "bit {bit}");
        flipped.flip(bit);
        assert_eq!(flipped, sample(0), "bit {bit}, turned back");
    }
    for bit in 0..Command::BITS {
        let mut flipped = Command::default();
        flipped.flip(bit);
        let changed = format!("{flipped:?}") != format!("{:?}", Command::default());
        assert!(changed, "bit {bit}");
    }
}

/// A plan of everything at once.
fn storm(seed: u64) -> Plan {
    let mut plan = Plan::default();
    let dice = |i| Dice::new(seed, i);
    let samples: [Box<dyn Stage<Sample>>; 6] = [
        Box::new(Drop::new(0.1, dice(0))),
        Box::new(Delay::new(0, 3, dice(1))),
        Box::new(Duplicate::new(0.1, dice(2))),
        Box::new(Reorder::new(0.1, dice(3))),
        Box::new(Corrupt::new(0.1, 2, dice(4))),
        Box::new(Freeze::new(4, 0.01, Ice::Last, dice(5))),
    ];
    for (tag, stage) in samples.into_iter().enumerate() {
        plan.samples.push(tag, Window::ALWAYS, stage);
    }
    plan.commands.push(6, Window::ALWAYS, Box::new(Drop::new(0.3, dice(6))));
    plan
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_same_seed_gives_the_same_faults_and_another_one_others(seed in any::<u64>()) {
        let run = |seed| {
            let mut plan = storm(seed);
            let bits = |m: Option<Sample>| m.map(|m| format!("{m:?}"));
            let pass = |tick| bits(plan.samples.pass(tick, Some(sample(tick))));
            (0..300).map(pass).collect::<Vec<_>>()
        };
        prop_assert_eq!(run(seed), run(seed));
        prop_assert_ne!(run(seed), run(seed ^ 1));
    }

    #[test]
    fn no_run_of_sends_and_silences_breaks_a_chain(
        seed in any::<u64>(),
        ticks in prop::collection::vec((0_u64..3, any::<bool>()), 1..200)
    ) {
        let mut plan = storm(seed);
        let mut now = 0;
        for (step, is_there) in ticks {
            now += step;
            plan.samples.pass(now, is_there.then(|| sample(now)));
        }
    }
}

fn answer(sample: &Sample) -> Command {
    Command { header: sample.header, apexes: 1, ..Command::default() }
}

/// Lock-step over two threads with faults at the leg's end: what came at each tick.
fn lock_step(seed: u64) -> (Vec<Option<u64>>, u64) {
    let (leg, mut controller) = memory::pair();
    let mut plan = Plan::default();
    plan.samples.push(0, Window::ALWAYS, Box::new(Drop::new(0.3, Dice::new(seed, 0))));
    plan.samples.push(1, Window::ALWAYS, Box::new(Corrupt::new(0.2, 3, Dice::new(seed, 1))));
    plan.commands.push(2, Window::ALWAYS, Box::new(Delay::new(2, 0, Dice::new(seed, 2))));
    let mut leg = Faulty::at_leg(leg, plan).in_lock_step();
    let long = Duration::from_secs(10);
    std::thread::scope(|scope| {
        let serving = scope.spawn(move || {
            let mut answered = 0;
            while let Ok(Some(sample)) = controller.receive(long) {
                if sample == Sample::default() {
                    break;
                }
                controller.send(&answer(&sample)).unwrap();
                answered += 1;
            }
            answered
        });
        let mut came = Vec::new();
        for tick in 0..300 {
            leg.send(&sample(tick)).unwrap();
            came.push(leg.receive(long).unwrap().map(|command| command.header.seq));
            assert!(leg.expects_no_reply(), "whatever came");
        }
        let (mut link, plan) = leg.into_parts();
        link.send(&Sample::default()).unwrap();
        assert_eq!(serving.join().unwrap(), 300 - plan.count(0), "each that was sent, once");
        (came, plan.count(0))
    })
}

#[test]
fn lock_step_with_faults_waits_for_nobody_and_is_the_same_again() {
    let (came, lost) = lock_step(5);
    assert!((50..130).contains(&lost), "{lost}");
    assert_eq!(came[..2], [None, None], "two ticks late");
    assert_eq!(came, lock_step(5).0);
    assert_ne!(came, lock_step(6).0);
}

#[test]
fn a_stepped_law_sees_missing_ticks_and_its_answers_may_be_lost() {
    let mut seen = Vec::new();
    let mut plan = Plan::default();
    let window = Window { from: 3, until: 5 };
    plan.samples.push(0, window, Box::new(Drop::new(1.0, dice())));
    plan.commands.push(1, Window { from: 6, until: 7 }, Box::new(Drop::new(1.0, dice())));
    let mut last = sample(0);
    let law = |sample: Option<&Sample>| {
        seen.push(sample.map(|sample| sample.header.seq));
        last = sample.copied().unwrap_or(last);
        answer(&last)
    };
    let mut leg = Stepped::new(law, plan);
    let mut came = Vec::new();
    for tick in 0..8 {
        leg.send(&sample(tick)).unwrap();
        came.push(leg.receive(Duration::ZERO).unwrap().map(|command| command.header.seq));
    }
    drop(leg);
    assert_eq!(seen, [Some(0), Some(1), Some(2), None, None, Some(5), Some(6), Some(7)]);
    assert_eq!(came, [Some(0), Some(1), Some(2), Some(2), Some(2), Some(5), None, Some(7)]);
}

#[test]
fn a_run_that_begins_anew_is_later_not_earlier() {
    let (leg, _controller) = memory::pair();
    let mut plan = Plan::default();
    let window = Window { from: 0, until: 100 };
    plan.samples.push(0, window, Box::new(Drop::new(1.0, dice())));
    let mut leg = Faulty::at_leg(leg, plan);
    for seq in [0, 50, 99, 150] {
        leg.send(&sample(seq)).unwrap();
    }
    // Restarted: ticks from 0 again, but the fault's time is over.
    let mut again = sample(0);
    again.header.run_id = 2;
    leg.send(&again).unwrap();
    assert_eq!(leg.into_parts().1.count(0), 3);
}
