//! Answers requests, and keeps an upload until it is committed.

use super::error::RequestError;
use super::message::{
    Alarm, DeviceCounts, Identity, LineCounts, MAX_CHUNK, Mode, Reply, Request, Slot, SlotError,
    SlotReport, Status, cut,
};
use super::node::{NodeChange, NodeHandle, check_set_point};
use super::store::{PolicyStore, StoreError};
use crate::wire::WIRE_VERSION;

/// The device that runs the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Its name, such as `mps2-an386`.
    pub name: &'static str,
    /// Version of the firmware.
    pub firmware: &'static str,
}

/// An upload under way.
#[derive(Clone, Copy, Debug)]
struct Upload {
    slot: Slot,
    length: u32,
    crc32: u32,
    /// Bytes that are in the slot.
    received: u32,
}

/// What carrying out a request came to.
pub(super) type Outcome = Result<(), RequestError>;

impl From<StoreError> for RequestError {
    fn from(StoreError: StoreError) -> Self {
        Self::Flash
    }
}

/// Answers requests to a node, and keeps its policies in a store.
///
/// It reaches the node through [`NodeHandle`] for moments only. Whatever takes
/// long (writing flash, checking a blob) happens outside, so ticks go on.
///
/// Rare work stands behind a call (`inline(never)`): inlined, each use would
/// be a copy, and the stack of all of them would add up in the one frame under
/// every sample.
#[derive(Clone, Debug)]
pub struct RequestHandler<S> {
    store: S,
    device: DeviceInfo,
    upload: Option<Upload>,
}

impl<S: PolicyStore> RequestHandler<S> {
    /// Has the node run the newest policy that passes every check. When no slot
    /// holds one, it returns the alarm to send.
    pub fn power_up(device: DeviceInfo, store: S, node: &impl NodeHandle) -> (Self, Option<Alarm>) {
        let handler = Self { store, device, upload: None };
        let alarm = handler.choose(node).err().map(|[a, b]| Alarm::NoPolicy { a, b });
        (handler, alarm)
    }

    /// Has the node run the newest policy that passes every check, or returns why
    /// neither slot's does, A's reason first.
    #[inline(never)]
    fn choose(&self, node: &impl NodeHandle) -> Result<(), [SlotError; 2]> {
        let newest = self.store.newest();
        let Err(error) = self.run(newest, node).map(drop) else { return Ok(()) };
        let Err(other) = self.run(newest.other(), node).map(drop) else { return Ok(()) };
        Err(if newest == Slot::A { [error, other] } else { [other, error] })
    }

    /// Returns the policy store.
    #[must_use]
    pub fn store(&self) -> &S {
        &self.store
    }

    /// Carries out a request and returns the reply. `line` is what came over the
    /// line of the host that sent it.
    pub fn answer(
        &mut self,
        request: &Request<'_>,
        node: &impl NodeHandle,
        line: &LineCounts,
        device: &DeviceCounts,
    ) -> Reply<'_> {
        let outcome = match *request {
            Request::Identify => return self.identity(node),
            Request::Status => {
                let run = node.status().run;
                return Reply::Status(Status { run, line: *line, device: *device });
            }
            Request::Slots => return self.slots(node),
            Request::Read { crc32, offset } => return self.read(crc32, offset),
            // For the program around the node, if there is one.
            Request::Report { .. } => Err(RequestError::Unsupported),
            Request::Reset { session, params } => node.change(NodeChange::Reset(session, params)),
            Request::SetMode(mode) => node.change(NodeChange::SetMode(mode)),
            Request::SetPoint(set_point_m_s) => set_point(set_point_m_s, node),
            Request::Begin { length, crc32, origin } => self.begin(length, crc32, origin, node),
            Request::Chunk { offset, bytes } => self.chunk(offset, bytes),
            Request::Verify => self.verify().map(|_| ()),
            Request::Commit => self.commit(node),
            Request::RollBack => self.roll_back(node),
        };
        done(outcome)
    }

    #[inline(never)]
    fn identity(&self, node: &impl NodeHandle) -> Reply<'static> {
        let status = node.status();
        Reply::Identity(Identity {
            wire_version: WIRE_VERSION,
            board: cut(self.device.name),
            firmware: cut(self.device.firmware),
            session: status.session,
            mode: status.mode,
            rate_hz: status.params.rate_hz,
            gravity_m_s2: status.params.gravity_m_s2,
            policy: status.policy,
        })
    }

    #[inline(never)]
    fn slots(&self, node: &impl NodeHandle) -> Reply<'static> {
        let running = running(node).0;
        Reply::Slots(Slot::ALL.map(|slot| SlotReport {
            sequence: self.store.sequence(slot),
            running: running == Some(slot),
            content: self.content(slot),
        }))
    }

    #[inline(never)]
    fn read(&self, crc32: u32, offset: u32) -> Reply<'_> {
        let rest = self.store.blob(crc32).and_then(|blob| blob.get(offset as usize..));
        match rest {
            Some(rest) => Reply::Bytes(rest.get(..MAX_CHUNK).unwrap_or(rest)),
            None => Reply::Refused(RequestError::NotFound),
        }
    }

    /// Returns name and checksum of the policy in a slot, once it has passed
    /// every check.
    #[inline(never)]
    fn content(&self, slot: Slot) -> Result<(&'static str, u32), SlotError> {
        self.store.policy(slot, |policy| (cut(policy.manifest().name), policy.crc32()))
    }

    #[inline(never)]
    fn begin(&mut self, length: u32, crc32: u32, origin: &str, node: &impl NodeHandle) -> Outcome {
        let (running, pending, mode) = running(node);
        if pending && S::OVERWRITES {
            return Err(RequestError::SwapPending);
        }
        let room = self.store.capacity();
        if length as usize > room {
            return Err(RequestError::TooLong { room: room as u32 });
        }
        if S::BEGIN_STALLS && mode == Mode::Live {
            return Err(RequestError::EraseWouldStall);
        }
        let slot = running.map_or(Slot::A, Slot::other);
        self.upload = None;
        self.store.begin(slot, length as usize, origin)?;
        self.upload = Some(Upload { slot, length, crc32, received: 0 });
        Ok(())
    }

    #[inline(never)]
    fn chunk(&mut self, offset: u32, bytes: &[u8]) -> Outcome {
        let upload = self.upload.as_mut().ok_or(RequestError::NotBegun)?;
        let expected = upload.received;
        let is_a_chunk = !bytes.is_empty() && bytes.len() <= MAX_CHUNK && offset.is_multiple_of(4);
        let end = offset.saturating_add(bytes.len() as u32);
        if is_a_chunk && end <= expected {
            return Ok(());
        }
        let fits = end == upload.length || (end < upload.length && end.is_multiple_of(4));
        if !is_a_chunk || offset != expected || !fits {
            return Err(RequestError::Offset { expected });
        }
        let slot = upload.slot;
        upload.received = end;
        self.store.write(slot, offset, bytes).map_err(|error| {
            // The content of the slot is unknown now.
            self.upload = None;
            error.into()
        })
    }

    #[inline(never)]
    fn verify(&self) -> Result<Upload, RequestError> {
        let upload = self.upload.ok_or(RequestError::NotBegun)?;
        let Upload { slot, length, crc32, received } = upload;
        if received < length {
            return Err(RequestError::Incomplete { received, length });
        }
        match self.store.check(slot, length as usize).map_err(RequestError::Blob)? {
            found if found == crc32 => Ok(upload),
            found => Err(RequestError::WrongBlob { crc32: found }),
        }
    }

    #[inline(never)]
    fn commit(&mut self, node: &impl NodeHandle) -> Outcome {
        let Upload { slot, length, crc32, .. } = self.verify()?;
        self.upload = None;
        self.store.commit(slot, length, crc32)?;
        self.run(slot, node).map_err(|_| RequestError::Flash)?
    }

    #[inline(never)]
    fn roll_back(&mut self, node: &impl NodeHandle) -> Outcome {
        let (running, pending, _) = running(node);
        if pending {
            return Err(RequestError::SwapPending);
        }
        let running = running.ok_or(RequestError::NoPolicy)?;
        let other = running.other();
        self.content(other).map_err(RequestError::NothingToRollBackTo)?;
        self.store.revoke(running)?;
        self.run(other, node).map_err(|_| RequestError::Flash)?
    }

    /// Reads the slot as it is after all writing, and has the node run it.
    #[inline(never)]
    fn run(&self, slot: Slot, node: &impl NodeHandle) -> Result<Outcome, SlotError> {
        self.store.policy(slot, |policy| node.change(NodeChange::RunPolicy(slot, policy)))
    }
}

/// Returns the slot that runs, whether a policy waits for an apex, and the mode.
#[inline(never)]
fn running(node: &impl NodeHandle) -> (Option<Slot>, bool, Mode) {
    let status = node.status();
    (status.policy.map(|policy| policy.slot), status.run.pending.is_some(), status.mode)
}

fn set_point(set_point_m_s: Option<f32>, node: &impl NodeHandle) -> Outcome {
    check_set_point(set_point_m_s)?;
    node.change(NodeChange::SetPoint(set_point_m_s))
}

/// Makes a reply of an outcome.
pub(super) fn done(outcome: Outcome) -> Reply<'static> {
    outcome.map_or_else(Reply::Refused, |()| Reply::Done)
}
