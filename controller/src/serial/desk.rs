//! Answers everything but samples, and keeps an upload until it is committed.

use super::message::{
    Alarm, Identity, LineCounts, MAX_CHUNK, Mode, Refusal, Reply, Request, Slot, SlotFault,
    SlotReport, Statistics, cut,
};
use super::pilot::{Pilot, SetPointFault, SharedPilot, Terms};
use super::slots::{self, FlashFault, PolicyFlash};
use crate::config::{ConfigError, RATE_HZ};
use crate::wire::WIRE_VERSION;

/// What only the board knows, for [`Statistics`]; since power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardFigures {
    /// Commands or replies that found no room to be sent.
    pub unsent: u32,
    /// Bytes that came too fast to be kept.
    pub lost_bytes: u32,
    /// Deepest stack, bytes.
    pub stack_used: u32,
    /// Room for the stack, bytes.
    pub stack_size: u32,
}

/// Who the board says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
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

type Outcome = Result<(), Refusal>;

/// The desk: takes a request, gives the reply.
///
/// It reaches the pilot through [`SharedPilot`] for moments only; what takes
/// long (writing flash, checking a blob) it does outside, so ticks go on.
///
/// What is rare stands behind a call (`inline(never)`): inlined, each use would
/// bring a copy of it, and all of their stack would be added up in the one
/// frame under every sample.
#[derive(Clone, Debug)]
pub struct Desk<F> {
    flash: F,
    board: Board,
    upload: Option<Upload>,
    /// The last request: its number, and what came of it if it changed something.
    last: Option<(u32, Option<Outcome>)>,
}

impl<F: PolicyFlash> Desk<F> {
    /// After power-up: has the pilot fly the policy to run. When no slot holds
    /// one, the alarm says why.
    pub fn power_up(board: Board, flash: F, pilot: &impl SharedPilot) -> (Self, Option<Alarm>) {
        let desk = Self { flash, board, upload: None, last: None };
        let alarm = desk.choose(pilot).err().map(|[a, b]| Alarm::NoPolicy { a, b });
        (desk, alarm)
    }

    /// Has the pilot fly the newest policy that passes every check, or says why
    /// neither slot's, A's reason first.
    #[inline(never)]
    fn choose(&self, pilot: &impl SharedPilot) -> Result<(), [SlotFault; 2]> {
        let newest = slots::newest(&self.flash);
        let Err(fault) = self.fly(newest, pilot) else { return Ok(()) };
        let Err(other) = self.fly(newest.other(), pilot) else { return Ok(()) };
        Err(if newest == Slot::A { [fault, other] } else { [other, fault] })
    }

    /// The flash behind it.
    #[must_use]
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// Does what is asked for, unless it is the last request again, and says
    /// what came of it. Encode the reply before the next request: names in it
    /// lie in the slots.
    pub fn answer(
        &mut self,
        id: u32,
        request: &Request<'_>,
        pilot: &impl SharedPilot,
        line: &LineCounts,
        figures: &BoardFigures,
    ) -> Reply<'static> {
        let again = self.last.filter(|(last, _)| *last == id);
        if again.is_some() {
            pilot.with(Pilot::count_repeated);
        }
        let outcome = match request {
            Request::Identify => return self.query(id, Reply::Identity(self.identity(pilot))),
            Request::Statistics => {
                return self.query(id, Reply::Statistics(statistics(pilot, line, figures)));
            }
            Request::Slots => return self.query(id, Reply::Slots(self.slots(pilot))),
            _ => match again {
                Some((_, Some(outcome))) => outcome,
                _ => self.act(request, pilot),
            },
        };
        self.last = Some((id, Some(outcome)));
        outcome.map_or_else(Reply::Refused, |()| Reply::Done)
    }

    fn query(&mut self, id: u32, reply: Reply<'static>) -> Reply<'static> {
        self.last = Some((id, None));
        reply
    }

    fn act(&mut self, request: &Request<'_>, pilot: &impl SharedPilot) -> Outcome {
        match *request {
            // Answered already; there is nothing to do.
            Request::Identify | Request::Statistics | Request::Slots => Ok(()),
            Request::Reset { session, rate_hz, gravity_m_s2 } => {
                let terms = Terms { rate_hz, gravity_m_s2 };
                pilot.with(|pilot| pilot.reset(session, terms)).map_err(|error| match error {
                    ConfigError::Rate(_) => {
                        Refusal::Rate { least: *RATE_HZ.start(), most: *RATE_HZ.end() }
                    }
                    // The limits are the usual ones: they cannot be at fault.
                    ConfigError::Gravity(_) | ConfigError::Limits => Refusal::Gravity,
                })
            }
            Request::SetMode(mode) => {
                pilot.with(|pilot| {
                    if pilot.mode() != mode {
                        pilot.set_mode(mode);
                    }
                });
                Ok(())
            }
            Request::SetPoint(set_point_m_s) => pilot
                .with(|pilot| pilot.set_point(set_point_m_s))
                .map_err(|SetPointFault { most_m_s }| Refusal::SetPoint { most_m_s }),
            Request::Begin { length, crc32 } => self.begin(length, crc32, pilot),
            Request::Chunk { offset, bytes } => self.chunk(offset, bytes),
            Request::Verify => self.verify().map(|_| ()),
            Request::Commit => self.commit(pilot),
            Request::RollBack => self.roll_back(pilot),
        }
    }

    #[inline(never)]
    fn identity(&self, pilot: &impl SharedPilot) -> Identity<'static> {
        pilot.with(|pilot| Identity {
            wire_version: WIRE_VERSION,
            board: cut(self.board.name),
            firmware: cut(self.board.firmware),
            session: pilot.session(),
            mode: pilot.mode(),
            rate_hz: pilot.terms().rate_hz,
            gravity_m_s2: pilot.terms().gravity_m_s2,
            policy: pilot.report(),
        })
    }

    #[inline(never)]
    fn slots(&self, pilot: &impl SharedPilot) -> [SlotReport<'static>; 2] {
        let running = pilot.with(|pilot| pilot.slot());
        Slot::ALL.map(|slot| SlotReport {
            sequence: slots::sequence(self.flash.bytes(slot)),
            running: running == Some(slot),
            content: self.content(slot),
        })
    }

    /// Name and checksum of the policy in a slot, once it has passed every check.
    #[inline(never)]
    fn content(&self, slot: Slot) -> Result<(&'static str, u32), SlotFault> {
        slots::policy(self.flash.bytes(slot), |policy| {
            (cut(policy.manifest().name), policy.crc32())
        })
    }

    #[inline(never)]
    fn begin(&mut self, length: u32, crc32: u32, pilot: &impl SharedPilot) -> Outcome {
        let (running, pending, mode) =
            pilot.with(|pilot| (pilot.slot(), pilot.swap_is_pending(), pilot.mode()));
        if pending {
            return Err(Refusal::SwapPending);
        }
        let room = slots::room(&self.flash);
        if length as usize > room {
            return Err(Refusal::TooLong { room: room as u32 });
        }
        if self.flash.erase_stalls() && mode == Mode::Live {
            return Err(Refusal::EraseWouldStall);
        }
        let slot = running.map_or(Slot::A, Slot::other);
        self.upload = None;
        slots::open(&mut self.flash, slot).map_err(|FlashFault| Refusal::Flash)?;
        self.upload = Some(Upload { slot, length, crc32, received: 0 });
        Ok(())
    }

    #[inline(never)]
    fn chunk(&mut self, offset: u32, bytes: &[u8]) -> Outcome {
        let upload = self.upload.as_mut().ok_or(Refusal::NotBegun)?;
        let expected = upload.received;
        let is_a_chunk = !bytes.is_empty() && bytes.len() <= MAX_CHUNK && offset.is_multiple_of(4);
        let end = offset.saturating_add(bytes.len() as u32);
        if is_a_chunk && end <= expected {
            return Ok(());
        }
        let fits = end == upload.length || (end < upload.length && end.is_multiple_of(4));
        if !is_a_chunk || offset != expected || !fits {
            return Err(Refusal::Offset { expected });
        }
        let slot = upload.slot;
        upload.received = end;
        slots::write(&mut self.flash, slot, offset, bytes).map_err(|FlashFault| {
            // What is there is unknown now.
            self.upload = None;
            Refusal::Flash
        })
    }

    #[inline(never)]
    fn verify(&self) -> Result<Upload, Refusal> {
        let upload = self.upload.ok_or(Refusal::NotBegun)?;
        let Upload { slot, length, crc32, received } = upload;
        if received < length {
            return Err(Refusal::Incomplete { received, length });
        }
        let blob = self.flash.bytes(slot).get(..length as usize).unwrap_or_default();
        match slots::check(blob).map_err(Refusal::Blob)? {
            found if found == crc32 => Ok(upload),
            found => Err(Refusal::WrongBlob { crc32: found }),
        }
    }

    #[inline(never)]
    fn commit(&mut self, pilot: &impl SharedPilot) -> Outcome {
        let Upload { slot, length, crc32, .. } = self.verify()?;
        self.upload = None;
        slots::seal(&mut self.flash, slot, length, crc32).map_err(|FlashFault| Refusal::Flash)?;
        self.fly(slot, pilot).map_err(|_| Refusal::Flash)
    }

    #[inline(never)]
    fn roll_back(&mut self, pilot: &impl SharedPilot) -> Outcome {
        let (running, pending) = pilot.with(|pilot| (pilot.slot(), pilot.swap_is_pending()));
        if pending {
            return Err(Refusal::SwapPending);
        }
        let running = running.ok_or(Refusal::NoPolicy)?;
        let other = running.other();
        self.content(other).map_err(Refusal::NothingToRollBackTo)?;
        slots::revoke(&mut self.flash, running).map_err(|FlashFault| Refusal::Flash)?;
        self.fly(other, pilot).map_err(|_| Refusal::Flash)
    }

    /// Reads the slot as it is after all writing, and has the pilot fly it.
    #[inline(never)]
    fn fly(&self, slot: Slot, pilot: &impl SharedPilot) -> Result<(), SlotFault> {
        slots::policy(self.flash.bytes(slot), |policy| {
            pilot.with(|pilot| pilot.fly(slot, policy));
        })
    }
}

#[inline(never)]
fn statistics(pilot: &impl SharedPilot, line: &LineCounts, figures: &BoardFigures) -> Statistics {
    let run = pilot.with(|pilot| *pilot.counts());
    Statistics {
        line: *line,
        ticks: run.ticks,
        missed: run.missed,
        overwritten: run.overwritten,
        overruns: run.overruns,
        repeated: run.repeated,
        swaps: run.swaps,
        unsent: figures.unsent,
        lost_bytes: figures.lost_bytes,
        stack_used: figures.stack_used,
        stack_size: figures.stack_size,
    }
}
