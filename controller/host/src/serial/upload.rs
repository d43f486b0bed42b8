//! Uploads of a policy to a controller.

use std::time::{Duration, Instant};

use super::client::{Client, ClientError};
use leg_control::policy::Policy;
use leg_control::serial::message::{
    MAX_CHUNK, MAX_ORIGIN, Request, RequestError, Slot, SlotReport,
};

/// Time between two checks whether the policy runs.
const LOOK: Duration = Duration::from_millis(20);

/// Progress of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Bytes sent, of so many.
    Sent(usize, usize),
    /// All bytes are sent; the controller checks them.
    Checking,
    /// The policy is committed and runs from the next apex on.
    Committed,
}

/// Result of an upload.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uploaded {
    /// The slot of the policy.
    pub slot: Slot,
    /// Time from the first byte to the commit.
    pub took: Duration,
    /// Time from the commit until the policy ran; `None` while it waits for an apex.
    pub swapped_after: Option<Duration>,
}

/// Uploads and commits a checked policy, and waits at most `timeout` until it runs; `bytes` is
/// its blob, `origin` its file. If a policy committed before still waits for its apex, waits at
/// most `timeout` for that first.
///
/// Until the commit nothing changes the running policy.
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
            Err(ClientError::Refused(RequestError::TooLong { room })) => {
                return Err(ClientError::TooLong { len: bytes.len(), room });
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

/// Makes the controller return to the policy in the other slot, and waits at most `timeout`
/// until that runs. Returns its slot, and the time until it ran; `None` while it waits for an
/// apex.
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
