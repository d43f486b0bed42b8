//! The warm loops in real time do not allocate, neither the leg's nor the
//! controller's.
//!
//! iceoryx2 0.10 does: each loan of a message allocates one block of 48 bytes and
//! frees it in the same call. The C library serves it from a cache of the thread,
//! without a lock or a system call. The tests allow exactly that.
//!
//! The crate `allocation-counter` replaces this program's allocator and counts the
//! allocations of each thread.

use std::sync::Barrier;
use std::thread;
use std::time::Duration;

use allocation_counter::{AllocationInfo, measure};
use leg_control::config::Config;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;
use leg_host::realtime::{
    Control, ControllerTask, DEFAULT_SPIN, Direct, ExitOn, LoopCounters, MonotonicClock,
    StatsWriter, Task, TickSchedule, run_ticks,
};
use leg_host::shm::{ShmController, ShmLeg};
use leg_host::{ControllerLink, Domain, LegLink, Role, TimeMode, memory};
use leg_process::Stop;
use leg_process::policy_file::PolicyFile;
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::real_time::{LegTask, Options};
use sim_host::session::{Ending, Hooks, Leg, TickRecord};

const RATE_HZ: u32 = 1000;
/// Ticks after which a loop is warm.
const WARM: u64 = 200;

/// Raises its stop flag when the loop is warm; optionally allocates at every tick.
#[derive(Default)]
struct Warm {
    stop: Stop,
    ticks: u64,
    wasteful: bool,
}

impl Warm {
    fn tick(&mut self) {
        self.ticks += 1;
        if self.ticks == WARM {
            self.stop.raise();
        }
        if self.wasteful {
            std::hint::black_box(Box::new(self.ticks));
        }
    }
}

impl Hooks for Warm {
    fn steer(&mut self, _leg: &mut Leg<'_>) {
        self.tick();
    }

    fn observe(&mut self, tick: &TickRecord<'_>) {
        std::hint::black_box(tick);
    }
}

struct WarmLaw<'a>(Warm, Direct<'a>);

impl Control for WarmLaw<'_> {
    fn tick(&mut self, sample: Option<&Sample>) -> Command {
        self.0.tick();
        self.1.tick(sample)
    }

    fn reset(&mut self) {}
}

/// Messages that a loop must receive when it is warm. On a busy machine it misses ticks.
const ENOUGH: u64 = 500;
/// Runs until both loops have received enough.
const MOST_RUNS: u32 = 50;

/// A leg with every sensor, of which some send late or not at every tick.
const SCENARIO: &str = "
    duration_s = 2.0
    set_point_m_s = 0.5

    [sensor]
    contact-latency = 0.001
    contact-jitter = 0.002
    contact-bounce = 0.005
    leg-length-latency = 0.005
    leg-angle-rate = 1000
    accelerometer-rate = 1600
    accelerometer-latency = 0.002
    gyro-rate = 300
    pitch-rate = 100
    velocity-rate = 10
    velocity-min-density = 0
    height-rate = 100
    height-min-density = 0
    pressure-rate = 50
    sample-latency = 0.003
";

/// What a warm loop has allocated.
#[derive(Debug)]
struct Measured {
    allocations: AllocationInfo,
    received: u64,
    counters: LoopCounters,
}

/// Repeats a run until both of its loops have received enough.
fn until_enough(mut run: impl FnMut() -> [Measured; 2]) -> [AllocationInfo; 2] {
    for _ in 0..MOST_RUNS {
        let both = run();
        if both.iter().all(|measured| measured.received > ENOUGH) {
            return both.map(|measured| measured.allocations);
        }
        println!("too few messages: {both:?}");
    }
    panic!("too few messages in each of {MOST_RUNS} runs");
}

/// Drives a task until it is warm, and then to its end; measures the second part.
fn measured<T: Task>(task: &mut T, role: Role, warm: &Stop) -> Measured
where
    T::Error: std::fmt::Debug,
{
    let grid = TickSchedule::of(role, RATE_HZ);
    let clock = MonotonicClock::new(DEFAULT_SPIN, grid.tick_ns());
    let (mut log, _rows) = StatsWriter::new(RATE_HZ);
    run_ticks(&clock, grid, task, &mut log, warm).expect("a link");
    assert!(warm.is_raised(), "the run ended before the loop was warm");
    let before = log.counters();
    let never = Stop::default();
    let allocations = measure(|| run_ticks(&clock, grid, task, &mut log, &never).expect("a link"));
    let counters = log.counters();
    Measured { allocations, received: counters.received - before.received, counters }
}

/// Plays both loops, each in its own thread, which creates its end of the link.
fn play<L: LegLink, C: ControllerLink>(
    leg_end: impl FnOnce() -> L,
    controllers_end: impl FnOnce() -> C + Send,
    wasteful: bool,
) -> [Measured; 2] {
    let scenario = Settings::from_toml(SCENARIO).expect("TOML");
    let scenario = Scenario::from_settings(&scenario).expect("a scenario");
    let blob = PolicyFile::load(None).expect("the shipped policy");
    let policy = blob.policy().expect("the shipped policy");
    let connected = Barrier::new(2);
    thread::scope(|scope| {
        let controlling = scope.spawn(|| {
            let end = controllers_end();
            connected.wait();
            let config = Config::at_rate(RATE_HZ).expect("a rate");
            let warm = Warm { wasteful, ..Warm::default() };
            let stop = warm.stop.clone();
            let direct = Direct { controller: WireController::new(policy, config), config };
            let law = WarmLaw(warm, direct);
            let mut task = ControllerTask::new(end, law, RATE_HZ, ExitOn::EndOfRun);
            let measured = measured(&mut task, Role::Controller, &stop);
            assert!(task.last_command().apexes > 0, "the actor has acted");
            measured
        });
        let mut link = leg_end();
        connected.wait();
        let mut warm = Warm { wasteful, ..Warm::default() };
        let stop = warm.stop.clone();
        let mut task = LegTask::new(&scenario, &mut link, Options::default(), &mut warm);
        let measured = measured(&mut task, Role::Leg, &stop);
        let (leg, ending) = task.finish();
        let counters = measured.counters;
        assert_eq!((ending, leg.ticks()), (Some(Ending::Duration), 2000), "{counters:?}");
        [measured, controlling.join().expect("the controller's loop")]
    })
}

#[test]
fn a_warm_loop_over_memory_does_not_allocate() {
    let [leg, controller] = until_enough(|| {
        let (leg, controller) = memory::pair();
        play(|| leg, || controller, false)
    });
    assert_eq!((leg.count_total, controller.count_total), (0, 0));
}

#[test]
fn the_counter_counts_allocations_of_a_loop() {
    let [leg, controller] = until_enough(|| {
        let (leg, controller) = memory::pair();
        play(|| leg, || controller, true)
    });
    assert!(leg.count_total > ENOUGH, "{leg:?}");
    assert!(controller.count_total > ENOUGH, "{controller:?}");
}

#[test]
fn over_shared_memory_each_send_allocates_and_frees_one_block() {
    const LONG: Duration = Duration::from_secs(20);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let base = dir.path().join("base");
    let join = || Domain::join_in(&base, "warm").expect("a domain");
    let params = leg_host::SessionParams::at(RATE_HZ).with_time_mode(TimeMode::RealTime);
    let [leg, controller] = until_enough(|| {
        play(
            || ShmLeg::connect(&join(), params, LONG, &Stop::default()).expect("a controller"),
            || ShmController::connect(&join(), params, LONG, &Stop::default()).expect("a leg"),
            false,
        )
    });
    for info in [leg, controller] {
        // Ticks of the second part: 2000 - WARM, or a few more that were idle.
        assert!(info.count_total <= 2100 - WARM, "more than one a tick: {info:?}");
        assert_eq!((info.count_max, info.count_current, info.bytes_current), (1, 0, 0), "{info:?}");
        assert!(info.bytes_max <= 64, "{info:?}");
    }
    assert!(!base.exists(), "nothing is left of the domain");
}
