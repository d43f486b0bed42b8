use std::time::Duration;

use proptest::prelude::*;

use super::message::{Corrupt, Delay, Duplicate, Freeze, FreezeMode, Loss, Reorder};
use super::*;
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_host::{Link, memory};

mod actuator;
mod sensor;

const TICKS: u64 = 2000;

fn sample(seq: u64) -> Sample {
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::STATE_SENSED | flags::LEG_LENGTH_SENSED,
            run_id: 1,
            seq,
            t_ns: 1_000_000 * seq,
        },
        vx_m_s: seq as f32,
        ..Sample::default()
    }
}

fn rng() -> FaultRng {
    FaultRng::new(7, 0)
}

/// Returns the message received in each tick, and the count of the fault.
fn through(stage: impl FaultStage<Sample> + 'static) -> (Vec<Option<Sample>>, u64) {
    through_in(Window::ALWAYS, stage)
}

fn through_in(
    window: Window,
    stage: impl FaultStage<Sample> + 'static,
) -> (Vec<Option<Sample>>, u64) {
    let mut plan = FaultPlan::default();
    plan.samples.push(3, window, Box::new(stage));
    let received = (0..TICKS).map(|tick| plan.samples.pass(tick, Some(sample(tick)))).collect();
    assert_eq!(plan.count(2), 0, "another fault's");
    (received, plan.count(3))
}

fn seqs(received: &[Option<Sample>]) -> Vec<Option<u64>> {
    received.iter().map(|message| message.map(|message| message.header.seq)).collect()
}

#[test]
fn drops_the_given_share_and_leaves_the_rest_unchanged() {
    let (received, count) = through(Loss::new(0.1, rng()));
    let lost = received.iter().filter(|message| message.is_none()).count();
    assert_eq!(lost as u64, count);
    assert!((150..250).contains(&lost), "{lost} of {TICKS}");
    for (tick, message) in received.iter().enumerate() {
        assert!(message.is_none_or(|message| message == sample(tick as u64)));
    }
    assert_eq!(through(Loss::new(0.0, rng())).1, 0);
    assert_eq!(through(Loss::new(1.0, rng())).1, TICKS);
}

#[test]
fn acts_only_within_its_window() {
    let (received, count) = through_in(Window { from: 100, until: 200 }, Loss::new(1.0, rng()));
    let lost: Vec<usize> = (0..received.len()).filter(|&tick| received[tick].is_none()).collect();
    assert_eq!(lost, (100..200).collect::<Vec<_>>());
    assert_eq!(count, 100);
}

#[test]
fn delays_by_the_given_number_of_ticks() {
    let (received, count) = through(Delay::new(3, 0, rng()));
    for (tick, seq) in seqs(&received).into_iter().enumerate() {
        assert_eq!(seq, (tick as u64).checked_sub(3));
    }
    assert_eq!(count, TICKS);
    // At the end of the window the delayed messages are older than new ones and are superseded.
    let (received, _) = through_in(Window { from: 0, until: 10 }, Delay::new(3, 0, rng()));
    let seqs = seqs(&received);
    assert_eq!(&seqs[8..14], [5, 6, 10, 11, 12, 13].map(Some));
}

#[test]
fn jitter_stays_within_its_range_and_reorders_messages() {
    let (received, _) = through(Delay::new(1, 4, rng()));
    let seqs = seqs(&received);
    let late = |(tick, seq): (usize, &Option<u64>)| seq.map(|seq| tick as u64 - seq);
    let late: Vec<u64> = seqs.iter().enumerate().filter_map(late).collect();
    assert!(late.iter().all(|late| (1..=5).contains(late)));
    assert!((1..=5).all(|ticks| late.contains(&ticks)), "every delay occurs");
    let received: Vec<u64> = seqs.into_iter().flatten().collect();
    assert!(received.windows(2).any(|pair| pair[0] > pair[1]), "some messages arrive out of order");
}

#[test]
fn duplicates_arrive_a_tick_later_and_reordered_messages_after_their_successor() {
    let (received, count) = through(Duplicate::new(0.05, rng()));
    let seqs_of = |received: &[Option<Sample>]| seqs(received);
    let twice = seqs_of(&received).windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert_eq!(twice as u64, count);
    assert!((60..140).contains(&twice), "{twice}");

    let (received, count) = through(Reorder::new(0.05, rng()));
    let seqs = seqs(&received);
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
fn a_frozen_link_repeats_the_last_message_or_sends_none() {
    for (mode, window) in [
        (FreezeMode::Last, Window { from: 50, until: 51 }),
        (FreezeMode::Nothing, Window { from: 50, until: 51 }),
    ] {
        let (received, count) = through_in(window, Freeze::new(20, 1.0, mode, rng()));
        let seqs = seqs(&received);
        let frozen = (mode == FreezeMode::Last).then_some(49);
        assert_eq!(seqs[50..70], [frozen; 20]);
        assert_eq!((seqs[49], seqs[70], count), (Some(49), Some(70), 20));
    }
}

fn bits_apart<M: WireMessage>(a: &M, b: &M) -> u32 {
    let bytes = bytemuck::bytes_of(a).iter().zip(bytemuck::bytes_of(b));
    bytes.map(|(a, b)| (a ^ b).count_ones()).sum()
}

#[test]
fn corruption_inverts_the_given_number_of_bits() {
    let (received, count) = through(Corrupt::new(0.5, 1, rng()));
    let hits = |(tick, m): (usize, &Option<Sample>)| bits_apart(&m.unwrap(), &sample(tick as u64));
    let apart: Vec<u32> = received.iter().enumerate().map(hits).collect();
    assert!(apart.iter().all(|&bits| bits <= 1));
    assert_eq!(apart.iter().map(|&bits| u64::from(bits)).sum::<u64>(), count);
}

#[test]
fn every_bit_of_a_message_can_be_inverted_and_no_other() {
    fn check<M: WireMessage + Default>() {
        for bit in 0..M::BITS {
            let mut message = M::default();
            message.flip(bit);
            assert_eq!(bits_apart(&message, &M::default()), 1, "bit {bit}");
        }
        let mut message = M::default();
        message.flip(M::BITS);
        assert_eq!(bits_apart(&message, &M::default()), 0);
    }
    check::<Sample>();
    check::<Command>();
    assert_eq!((Sample::BITS, Command::BITS), (768, 512));
}

/// The numbering decides what a seed damages, so it must not change.
#[test]
fn bits_are_numbered_through_the_fields_in_their_order() {
    let flipped = |bit| {
        let mut sample = Sample::default();
        sample.flip(bit);
        sample
    };
    assert_eq!(flipped(3).header.version, 1 << 3);
    assert_eq!(flipped(16 + 9).header.flags, 1 << 9);
    assert_eq!(flipped(32 + 31).header.run_id, 1 << 31);
    assert_eq!(flipped(64 + 40).header.seq, 1 << 40);
    assert_eq!(flipped(128 + 63).header.t_ns, 1 << 63);
    assert_eq!(flipped(192 + 5).set_point_m_s.to_bits(), 1 << 5);
    assert_eq!(flipped(352 + 30).density_ratio.to_bits(), 1 << 30);
    assert_eq!(flipped(384 + 7).sensors.pitch_rad.to_bits(), 1 << 7);
    assert_eq!(flipped(480 + 31).sensors.impulse[0], i32::MIN);
    assert_eq!(flipped(736 + 3).sensors.pressure_age_ns, 1 << 3);
    let flipped = |bit| {
        let mut command = Command::default();
        command.flip(bit);
        command
    };
    assert_eq!(flipped(192 + 12).leg_angle_rad.to_bits(), 1 << 12);
    assert_eq!(flipped(384 + 31).velocity_offset_m_s.to_bits(), 1 << 31);
    assert_eq!(flipped(416 + 1).apexes, 1 << 1);
    assert_eq!(flipped(480 + 31).set_points_refused, 1 << 31);
}

/// Creates a plan with all faults of messages.
fn all_faults(seed: u64) -> FaultPlan {
    let mut plan = FaultPlan::default();
    let rng = |i| FaultRng::new(seed, i);
    let samples: [Box<dyn FaultStage<Sample>>; 6] = [
        Box::new(Loss::new(0.1, rng(0))),
        Box::new(Delay::new(0, 3, rng(1))),
        Box::new(Duplicate::new(0.1, rng(2))),
        Box::new(Reorder::new(0.1, rng(3))),
        Box::new(Corrupt::new(0.1, 2, rng(4))),
        Box::new(Freeze::new(4, 0.01, FreezeMode::Last, rng(5))),
    ];
    for (id, stage) in samples.into_iter().enumerate() {
        plan.samples.push(id, Window::ALWAYS, stage);
    }
    plan.commands.push(6, Window::ALWAYS, Box::new(Loss::new(0.3, rng(6))));
    plan
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_same_seed_gives_the_same_faults_and_another_seed_other_faults(seed in any::<u64>()) {
        let run = |seed| {
            let mut plan = all_faults(seed);
            let bits = |m: Option<Sample>| m.map(|m| format!("{m:?}"));
            let pass = |tick| bits(plan.samples.pass(tick, Some(sample(tick))));
            (0..300).map(pass).collect::<Vec<_>>()
        };
        prop_assert_eq!(run(seed), run(seed));
        prop_assert_ne!(run(seed), run(seed ^ 1));
    }

    #[test]
    fn no_sequence_of_messages_and_gaps_panics(
        seed in any::<u64>(),
        ticks in prop::collection::vec((0_u64..3, any::<bool>()), 1..200)
    ) {
        let mut plan = all_faults(seed);
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

/// Runs lock-step over two threads with faults at the leg's end. Returns the sequence number
/// received in each tick, and the number of dropped samples.
fn lock_step(seed: u64) -> (Vec<Option<u64>>, u64) {
    let (leg, mut controller) = memory::pair();
    let mut plan = FaultPlan::default();
    plan.samples.push(0, Window::ALWAYS, Box::new(Loss::new(0.3, FaultRng::new(seed, 0))));
    plan.samples.push(1, Window::ALWAYS, Box::new(Corrupt::new(0.2, 3, FaultRng::new(seed, 1))));
    plan.commands.push(2, Window::ALWAYS, Box::new(Delay::new(2, 0, FaultRng::new(seed, 2))));
    let mut leg = FaultyLink::at_leg(leg, plan).in_lock_step();
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
        let mut received = Vec::new();
        for tick in 0..300 {
            leg.send(&sample(tick)).unwrap();
            received.push(leg.receive(long).unwrap().map(|command| command.header.seq));
            assert!(leg.expects_no_reply(), "after every tick");
        }
        let (mut link, plan) = leg.into_parts();
        link.send(&Sample::default()).unwrap();
        assert_eq!(
            serving.join().unwrap(),
            300 - plan.count(0),
            "each message that was sent, once"
        );
        (received, plan.count(0))
    })
}

#[test]
fn lock_step_with_faults_never_blocks_and_is_reproducible() {
    let (received, lost) = lock_step(5);
    assert!((50..130).contains(&lost), "{lost}");
    assert_eq!(received[..2], [None, None], "two ticks late");
    assert_eq!(received, lock_step(5).0);
    assert_ne!(received, lock_step(6).0);
}

#[test]
fn a_stepped_law_sees_missing_ticks_and_its_replies_can_be_dropped() {
    let mut seen = Vec::new();
    let mut plan = FaultPlan::default();
    let window = Window { from: 3, until: 5 };
    plan.samples.push(0, window, Box::new(Loss::new(1.0, rng())));
    plan.commands.push(1, Window { from: 6, until: 7 }, Box::new(Loss::new(1.0, rng())));
    let mut last = sample(0);
    let law = |sample: Option<&Sample>| {
        seen.push(sample.map(|sample| sample.header.seq));
        last = sample.copied().unwrap_or(last);
        answer(&last)
    };
    let mut leg = SteppedLink::new(law, plan);
    let mut received = Vec::new();
    for tick in 0..8 {
        leg.send(&sample(tick)).unwrap();
        received.push(leg.receive(Duration::ZERO).unwrap().map(|command| command.header.seq));
    }
    drop(leg);
    assert_eq!(seen, [Some(0), Some(1), Some(2), None, None, Some(5), Some(6), Some(7)]);
    assert_eq!(received, [Some(0), Some(1), Some(2), Some(2), Some(2), Some(5), None, Some(7)]);
}

#[test]
fn a_new_run_continues_the_tick_count() {
    let (leg, _controller) = memory::pair();
    let mut plan = FaultPlan::default();
    let window = Window { from: 0, until: 100 };
    plan.samples.push(0, window, Box::new(Loss::new(1.0, rng())));
    let mut leg = FaultyLink::at_leg(leg, plan);
    for seq in [0, 50, 99, 150] {
        leg.send(&sample(seq)).unwrap();
    }
    // The new run numbers its ticks from 0, but the window of the fault has passed.
    let mut again = sample(0);
    again.header.run_id = 2;
    leg.send(&again).unwrap();
    assert_eq!(leg.into_parts().1.count(0), 3);
}
