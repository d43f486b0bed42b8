//! A policy brought to a flashed controller, and swapped in.

use std::time::{Duration, Instant};

use super::client::{Client, ClientError};
use leg_control::policy::Policy;
use leg_control::serial::message::{
    MAX_CHUNK, MAX_ORIGIN, Request, RequestError, Slot, SlotReport,
};

/// Between two looks whether it is swapped in.
const LOOK: Duration = Duration::from_millis(20);

/// How far an upload is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Bytes that are there, of so many.
    Sent(usize, usize),
    /// All are there; the controller checks them.
    Checking,
    /// It is the policy to run, from the next apex.
    Committed,
}

/// What became of an upload.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uploaded {
    /// Where it lies.
    pub slot: Slot,
    /// From the first byte to the commit.
    pub took: Duration,
    /// From the commit until it ran; `None` when it still waits for an apex.
    pub swapped_after: Option<Duration>,
}

/// Uploads a checked policy, `bytes` being its blob and `origin` where it comes
/// from, commits it, and waits at most `timeout` until it runs. A policy that
/// was committed before, and still waits for its apex, is waited for as long.
///
/// Until the commit the policy that runs is untouched, whatever happens.
///
/// # Errors
/// [`ClientError`]; the policy that ran before runs on.
pub fn upload(
    client: &mut Client,
    policy: &Policy<'_>,
    bytes: &[u8],
    origin: &str,
    timeout: Duration,
    mut progress: impl FnMut(Progress),
) -> Result<Uploaded, ClientError> {
    let crc32 = policy.crc32();
    let took = transfer(client, policy, bytes, origin, timeout, &mut progress)?;
    let (slot, swapped_after) = wait_for_swap(client, timeout, |slots| newest(slots, crc32))?;
    Ok(Uploaded { slot, took, swapped_after })
}

/// Uploads and commits a policy as [`upload`] does, and returns how long it took.
///
/// # Errors
/// [`ClientError`]; the policy that ran before runs on.
pub fn transfer(
    client: &mut Client,
    policy: &Policy<'_>,
    bytes: &[u8],
    origin: &str,
    timeout: Duration,
    mut progress: impl FnMut(Progress),
) -> Result<Duration, ClientError> {
    let begun = Instant::now();
    let crc32 = policy.crc32();
    let begin = Request::Begin { length: bytes.len() as u32, crc32, origin: cut_origin(origin) };
    loop {
        match client.have_done(&begin) {
            Err(ClientError::Refused(RequestError::SwapPending)) if begun.elapsed() < timeout => {
                std::thread::sleep(LOOK);
            }
            begun => break begun?,
        }
    }
    for (index, part) in bytes.chunks(MAX_CHUNK).enumerate() {
        let offset = index * MAX_CHUNK;
        client.have_done(&Request::Chunk { offset: offset as u32, bytes: part })?;
        progress(Progress::Sent(offset + part.len(), bytes.len()));
    }
    progress(Progress::Checking);
    client.have_done(&Request::Verify)?;
    client.have_done(&Request::Commit)?;
    let took = begun.elapsed();
    progress(Progress::Committed);
    Ok(took)
}

/// Has the controller go back to the policy in the other slot, and waits at
/// most `timeout` until it runs. Returns its slot, and how long that took, if
/// it is done.
///
/// # Errors
/// [`ClientError`].
pub fn roll_back(
    client: &mut Client,
    timeout: Duration,
) -> Result<(Slot, Option<Duration>), ClientError> {
    let running = client.slots()?.iter().position(|slot| slot.running);
    let back = running.map_or(Slot::A, |at| Slot::ALL[at].other());
    client.have_done(&Request::RollBack)?;
    wait_for_swap(client, timeout, |_| Some(back))
}

/// Returns the end of an origin, as much as fits a message.
fn cut_origin(origin: &str) -> &str {
    let from = origin.len().saturating_sub(MAX_ORIGIN);
    (from..origin.len()).find_map(|from| origin.get(from..)).unwrap_or_default()
}

/// Returns the slot with the blob of this checksum that was committed last.
fn newest(slots: &[SlotReport<'_>; 2], crc32: u32) -> Option<Slot> {
    let holds = |slot: &SlotReport<'_>| slot.content.is_ok_and(|(_, found)| found == crc32);
    let found = Slot::ALL.into_iter().zip(slots).filter(|(_, slot)| holds(slot));
    found.max_by_key(|(_, slot)| slot.sequence).map(|(slot, _)| slot)
}

fn wait_for_swap(
    client: &mut Client,
    timeout: Duration,
    which: impl Fn(&[SlotReport<'_>; 2]) -> Option<Slot>,
) -> Result<(Slot, Option<Duration>), ClientError> {
    let committed = Instant::now();
    loop {
        let slots = client.slots()?;
        // It was there a moment ago.
        let slot = which(&slots).ok_or(ClientError::Refused(RequestError::Flash))?;
        if slots[slot as usize].running {
            return Ok((slot, Some(committed.elapsed())));
        }
        if committed.elapsed() >= timeout {
            return Ok((slot, None));
        }
        std::thread::sleep(LOOK);
    }
}
