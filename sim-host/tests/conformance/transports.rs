//! The transports, bare and behind fault injection.

use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use leg_control::wire::{Command, Sample};
use leg_host::memory::{self, MemoryLink};
use leg_host::serial::stream::over_unix;
use leg_host::serial::{SerialController, SerialLeg};
use leg_host::shm::{ShmController, ShmLeg};
use leg_host::{ControllerLink, Domain, LegLink, SessionParams};
use leg_process::Stop;
use sim_host::faults::stage::actuator::{
    Backlash, Bandwidth, DeadTime, Drive, Lag, Limit, Saturate,
};
use sim_host::faults::stage::message::{
    Corrupt, Delay, Duplicate, Freeze, FreezeMode, Loss, Reorder,
};
use sim_host::faults::stage::sensor::{
    Dead, FaultyReadings, Reading, ReadingFault, SensorTarget, Stuck, StuckSwitch,
};
use sim_host::faults::stage::{
    FaultPipeline, FaultPlan, FaultRng, FaultStage, FaultyLink, Window, WireMessage,
};
use tempfile::TempDir;

/// Timeout that no test should reach.
pub(crate) const LONG: Duration = Duration::from_secs(10);

/// Makes pairs of connected ends. Each end is created in the thread that uses it, because the
/// ends of a shared-memory link cannot move between threads.
pub(crate) trait Transport {
    type Leg: LegLink;
    type Controller: ControllerLink;

    fn pair(&self)
    -> (impl FnOnce() -> Self::Leg + Send, impl FnOnce() -> Self::Controller + Send);
}

/// A link within a process.
pub(crate) struct Memory;

impl Transport for Memory {
    type Leg = MemoryLink<Sample, Command>;
    type Controller = MemoryLink<Command, Sample>;

    fn pair(
        &self,
    ) -> (impl FnOnce() -> Self::Leg + Send, impl FnOnce() -> Self::Controller + Send) {
        let (leg, controller) = memory::pair();
        (move || leg, move || controller)
    }
}

/// A link over a stream of bytes.
pub(crate) struct Serial;

impl Transport for Serial {
    type Leg = SerialLeg;
    type Controller = SerialController;

    fn pair(
        &self,
    ) -> (impl FnOnce() -> Self::Leg + Send, impl FnOnce() -> Self::Controller + Send) {
        let (leg, controller) = UnixStream::pair().unwrap();
        let (leg, controller) = (over_unix(leg).unwrap(), over_unix(controller).unwrap());
        let pid = std::process::id();
        (move || SerialLeg::new(leg, pid), move || SerialController::new(controller, pid))
    }
}

/// A link over shared memory, in a domain of its own.
pub(crate) struct SharedMemory(TempDir);

impl SharedMemory {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Asserts that nothing is left of the domain.
    pub(crate) fn assert_clean(&self) {
        assert!(!self.0.path().join("base").exists(), "something is left of the domain");
    }
}

impl Transport for SharedMemory {
    type Leg = ShmLeg;
    type Controller = ShmController;

    fn pair(
        &self,
    ) -> (impl FnOnce() -> Self::Leg + Send, impl FnOnce() -> Self::Controller + Send) {
        let domain = || Domain::join_in(&self.0.path().join("base"), "conformance").unwrap();
        let (params, stop) = (SessionParams::at(1000), Stop::default());
        let (leg, controller): (Arc<_>, Arc<_>) = (domain(), domain());
        let stop_too = stop.clone();
        (
            move || ShmLeg::connect(&leg, params, LONG, &stop).unwrap(),
            move || ShmController::connect(&controller, params, LONG, &stop_too).unwrap(),
        )
    }
}

/// Another transport with both ends behind fault injection.
pub(crate) struct Faulty<T> {
    pub(crate) inner: T,
    pub(crate) plan: fn() -> FaultPlan,
}

impl<T: Transport> Transport for Faulty<T> {
    type Leg = FaultyLink<T::Leg>;
    type Controller = FaultyLink<T::Controller>;

    fn pair(
        &self,
    ) -> (impl FnOnce() -> Self::Leg + Send, impl FnOnce() -> Self::Controller + Send) {
        let (leg, controller) = self.inner.pair();
        let plan = self.plan;
        (
            move || FaultyLink::at_leg(leg(), plan()),
            move || FaultyLink::at_controller(controller(), plan()),
        )
    }
}

/// Creates a plan with every fault of messages and actuators, none of which acts: by its window or its values.
pub(crate) fn all_inactive() -> FaultPlan {
    fn put<M: WireMessage>(pipeline: &mut FaultPipeline<M>) {
        let later = Window { from: 1 << 40, until: u64::MAX };
        let rng = || FaultRng::new(1, 2);
        pipeline.push(0, later, Box::new(Loss::new(1.0, rng())));
        pipeline.push(1, later, Box::new(Delay::new(3, 4, rng())));
        pipeline.push(2, later, Box::new(Duplicate::new(1.0, rng())));
        pipeline.push(3, later, Box::new(Reorder::new(1.0, rng())));
        pipeline.push(4, later, Box::new(Corrupt::new(1.0, 9, rng())));
        pipeline.push(5, later, Box::new(Freeze::new(7, 1.0, FreezeMode::Nothing, rng())));
        pipeline.push(6, Window::ALWAYS, Box::new(Delay::new(0, 0, rng())));
        pipeline.push(7, Window::ALWAYS, Box::new(Loss::new(0.0, rng())));
    }
    let mut plan = FaultPlan::default();
    put(&mut plan.samples);
    put(&mut plan.commands);
    let later = Window { from: 1 << 40, until: u64::MAX };
    let rng = FaultRng::new(1, 2);
    let acceleration = &[Reading::ImpulseX, Reading::ImpulseY];
    let target = SensorTarget::Readings(acceleration);
    plan.samples.push(8, later, Box::new(Dead(target)));
    plan.samples.push(9, later, Box::new(StuckSwitch { is_closed: true }));
    let noise = FaultyReadings::new(acceleration, ReadingFault::Noise(1.0), rng.clone());
    plan.samples.push(10, later, Box::new(noise));
    plan.samples.push(11, later, Box::new(Stuck::new(target, 3, 1.0, rng)));
    let tick_s = 1e-3;
    let actuators: [(Window, Box<dyn FaultStage<Command>>); 8] = [
        (later, Box::new(Lag::new(0.1, tick_s))),
        (later, Box::new(Saturate::new(Limit::Angle(0.0), tick_s))),
        (later, Box::new(Bandwidth::new(1.0, tick_s))),
        (later, Box::new(DeadTime::new(5, tick_s))),
        (later, Box::new(Backlash::new(Drive::Angle, 1.0, tick_s))),
        (Window::ALWAYS, Box::new(DeadTime::new(0, tick_s))),
        (Window::ALWAYS, Box::new(Backlash::new(Drive::Angle, 0.0, tick_s))),
        (Window::ALWAYS, Box::new(Backlash::new(Drive::Elongation, 0.0, tick_s))),
    ];
    for (id, (window, stage)) in (12..).zip(actuators) {
        plan.commands.push(id, window, stage);
    }
    plan
}
