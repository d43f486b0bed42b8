//! A node in memory for the tests: policies, flash, a hopping leg.

use crate::fixture::{manifest, weights};
use leg_control::policy::{self, GainPoint, GainSchedule};
use leg_control::serial::endpoint::RepeatFilter;
use leg_control::serial::handler::{DeviceInfo, RequestHandler};
use leg_control::serial::message::{
    Alarm, DeviceCounts, LineCounts, MAX_CHUNK, Mode, PolicyReport, Reply, Request, RequestError,
    RunCounts, Slot, SlotReport,
};
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::serial::slots::{FlashSlots, MappedFlash};
use leg_control::wire::{Command, Header, Sample, WIRE_VERSION, flags};
use leg_host::flash::{LockedNode, MemoryFlash};

/// Ticks from one apex of [`hopping`] to the next.
pub(super) const HOP_TICKS: u64 = 100;

pub(super) const DEVICE: DeviceInfo = DeviceInfo { name: "rig", firmware: "0.0.0" };

/// A small policy, unlike one of any other name.
pub(super) fn small_blob(name: &str) -> Vec<u8> {
    let mut manifest = manifest();
    let mark = name.bytes().fold(0.0, |sum, byte| sum + f32::from(byte));
    manifest.name = name;
    manifest.widths = heapless::Vec::from_slice(&[3, 24, 2]).unwrap();
    manifest.action.offset = [1.5 + 1e-4 * mark, 1.0];
    let gains = GainPoint { kp: 0.1, ki: 1e-4 * mark, limit_m_s: 2.0, ..GainPoint::default() };
    manifest.gains = GainSchedule::from_slice(&[gains]).unwrap();
    let mut buffer = vec![0_u32; 1024];
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut buffer);
    let len = policy::write(&manifest, &weights(&manifest.widths), buffer).unwrap();
    buffer[..len].to_vec()
}

pub(super) fn crc32_of(blob: &[u8]) -> u32 {
    u32::from_le_bytes(*blob.last_chunk().unwrap())
}

/// Flash with one factory policy, in A.
pub(super) fn factory(blob: &[u8]) -> MemoryFlash {
    MemoryFlash::with_slot_len(2048).loaded(Slot::A, blob)
}

/// A sample of a leg that hops, its apex at each multiple of [`HOP_TICKS`].
pub(super) fn hopping(tick: u64) -> Sample {
    let phase = core::f32::consts::TAU * (tick % HOP_TICKS) as f32 / HOP_TICKS as f32;
    let y_m = 1.05 + 0.15 * phase.cos();
    let contact = if y_m < 1.0 { flags::IN_CONTACT } else { 0 };
    Sample {
        header: Header {
            version: WIRE_VERSION,
            flags: flags::STATE_SENSED | flags::CONTACT_SENSED | flags::DENSITY_SENSED | contact,
            run_id: 1,
            seq: tick,
            t_ns: tick * 1_000_000,
        },
        set_point_m_s: 0.5,
        vx_m_s: 0.3,
        y_m,
        vy_m_s: -0.15 * core::f32::consts::TAU * 10.0 * phase.sin(),
        density_ratio: 0.25,
        ..Sample::default()
    }
}

pub(super) fn is_safe(command: &Command) -> bool {
    command.is_safe()
}

/// A powered board.
pub(super) struct Rig<F> {
    pub(super) node: LockedNode,
    pub(super) handler: RequestHandler<FlashSlots<F>>,
    pub(super) alarm: Option<Alarm>,
    filter: RepeatFilter,
    next_id: u32,
    tick: u64,
}

impl<F: MappedFlash> Rig<F> {
    pub(super) fn power_up(flash: F) -> Self {
        let node = LockedNode::new(ControlNode::new());
        let (handler, alarm) = RequestHandler::power_up(DEVICE, FlashSlots::new(flash), &node);
        Self { node, handler, alarm, filter: RepeatFilter::default(), next_id: 1, tick: 0 }
    }

    pub(super) fn flash(&self) -> &F {
        self.handler.store().flash()
    }

    pub(super) fn ask_as(&mut self, id: u32, request: &Request<'_>) -> Reply<'_> {
        let Self { node, handler, filter, .. } = self;
        let device = DeviceCounts::default();
        filter.answer(id, request, handler, node, &LineCounts::ZERO, &device)
    }

    pub(super) fn ask(&mut self, request: &Request<'_>) -> Reply<'_> {
        self.next_id += 1;
        self.ask_as(self.next_id, request)
    }

    pub(super) fn order(&mut self, request: &Request<'_>) -> Result<(), RequestError> {
        match self.ask(request) {
            Reply::Done => Ok(()),
            Reply::Refused(refusal) => Err(refusal),
            other => panic!("{other:?}"),
        }
    }

    pub(super) fn counts(&mut self) -> RunCounts {
        match self.ask(&Request::Status) {
            Reply::Status(status) => status.run.counts,
            other => panic!("{other:?}"),
        }
    }

    pub(super) fn slots(&mut self) -> [SlotReport<'_>; 2] {
        match self.ask(&Request::Slots) {
            Reply::Slots(slots) => slots,
            other => panic!("{other:?}"),
        }
    }

    pub(super) fn running(&self) -> Option<PolicyReport<'static>> {
        self.node.with(|node| node.report())
    }

    pub(super) fn name(&self) -> &'static str {
        self.running().map_or("", |report| report.name)
    }

    pub(super) fn begin(&mut self, blob: &[u8]) -> Result<(), RequestError> {
        self.order(&Request::Begin { length: blob.len() as u32, crc32: crc32_of(blob), origin: "" })
    }

    /// One chunk of the blob; the chunks are numbered from 0.
    pub(super) fn chunk(&mut self, blob: &[u8], number: usize) -> Result<(), RequestError> {
        let offset = (number * MAX_CHUNK) as u32;
        let bytes = blob.chunks(MAX_CHUNK).nth(number).unwrap();
        self.order(&Request::Chunk { offset, bytes })
    }

    pub(super) fn send(&mut self, blob: &[u8]) -> Result<(), RequestError> {
        self.begin(blob)?;
        (0..blob.len().div_ceil(MAX_CHUNK)).try_for_each(|number| self.chunk(blob, number))
    }

    pub(super) fn upload(&mut self, blob: &[u8]) -> Result<(), RequestError> {
        self.send(blob)?;
        self.order(&Request::Verify)?;
        self.order(&Request::Commit)
    }

    /// From here on in lock-step, in the middle of a hop.
    pub(super) fn hop(&mut self) {
        self.order(&Request::SetMode(Mode::LockStep)).unwrap();
        self.ticks(HOP_TICKS / 4);
    }

    /// The next tick of the hopping leg.
    pub(super) fn tick(&mut self) -> Command {
        self.tick += 1;
        let tick = self.tick;
        self.node.with(|node| node.sample(tick as u32, &hopping(tick - 1))).unwrap()
    }

    pub(super) fn ticks(&mut self, ticks: u64) -> Command {
        (0..ticks).map(|_| self.tick()).last().unwrap()
    }
}

impl<F: MappedFlash + Clone> Rig<F> {
    /// The power goes, and comes back.
    pub(super) fn power_cycled(&self) -> Self {
        Self::power_up(self.flash().clone())
    }
}
