//! Beside the loop: takes orders for it, and says how it is doing.

use std::collections::VecDeque;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use rtrb::{Consumer, Producer, RingBuffer};
use serde_json::Value;

use super::desk::requests::{
    Activity, Crc32, Policies, PolicyBytes, PolicyName, Request, Status, SwapRecord, Swapping,
};
use super::link::{PeerStatus, SessionParams, TimeMode};
use super::operated::{Board, ORDERS, Operated, Order, Taken};
use super::realtime::LatestReport;
use super::shelf::{self, Shelved};
use leg_control::config::Config;
use leg_process::policy_file::PolicyFile;

/// Swaps that are remembered.
const MEMORY: usize = 4096;

/// How to look at what the office does not see by itself.
pub struct Windows {
    /// At the peer.
    pub peer: Box<dyn Fn() -> PeerStatus + Send>,
    /// At the loop's own figures, in real time.
    pub timing: Option<LatestReport>,
}

impl fmt::Debug for Windows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Windows")
    }
}

/// A policy of this process, and what is said of it.
#[derive(Clone, Debug)]
struct Known {
    shelved: &'static Shelved,
    name: PolicyName,
}

impl Known {
    fn new(shelved: &'static Shelved, file: String) -> Self {
        let manifest = shelved.policy().manifest();
        let made = &manifest.provenance;
        let provenance = format!(
            "preset {}, seed {}, {} steps, trainer {}",
            made.preset, made.seed, made.steps, made.trainer_version
        );
        let crc32 = Crc32(shelved.policy().crc32());
        let name = PolicyName { name: manifest.name.to_owned(), crc32, file, provenance };
        Self { shelved, name }
    }
}

/// The order of a number, and when the loop took it.
#[derive(Clone, Debug)]
struct Entry {
    record: SwapRecord,
    known: Known,
}

/// What takes orders for an [`Operated`] controller.
#[derive(Debug)]
pub struct Office {
    params: SessionParams,
    orders: Producer<Order>,
    taken: Consumer<Taken>,
    board: Arc<Board>,
    windows: Windows,
    /// The policy before the first order that is remembered.
    first: Known,
    entries: VecDeque<Entry>,
    /// Orders given.
    given: u64,
    /// The order that was in force when last asked for news.
    seen_in_force: u64,
}

impl Office {
    /// A controller that begins with `policy`, from `file`, and its office.
    #[must_use]
    pub fn open(
        policy: &'static Shelved,
        file: &str,
        config: Config,
        params: SessionParams,
        windows: Windows,
    ) -> (Operated, Self) {
        let (orders, to_take) = RingBuffer::new(ORDERS);
        let (told, taken) = RingBuffer::new(ORDERS);
        let board = Arc::new(Board::default());
        let operated = Operated::new(policy, config, to_take, told, Arc::clone(&board));
        let office = Self {
            params,
            orders,
            taken,
            board,
            windows,
            first: Known::new(policy, file.to_owned()),
            entries: VecDeque::new(),
            given: 0,
            seen_in_force: 0,
        };
        (operated, office)
    }

    /// Has the controller go on with the policy in `blob`, from the next apex.
    ///
    /// # Errors
    /// Why it is refused; then nothing has changed.
    pub fn swap(&mut self, file: &str, blob: &[u8]) -> Result<Swapping, String> {
        self.listen();
        let stays =
            |known: &Known| format!("the policy {} ({}) stays", known.name.name, known.name.crc32);
        let in_force = self.in_force().clone();
        let shelved = shelf::keep(blob).map_err(|cause| {
            format!("{file} is not a valid policy: {cause}; {}", stays(&in_force))
        })?;
        let number = self.given + 1;
        // A place for its taking, too: the loop never finds that ring full.
        let waiting = self.entries.iter().rev().take_while(|entry| entry.record.at.is_none());
        if waiting.count() >= ORDERS || self.orders.push(Order { number, policy: shelved }).is_err()
        {
            return Err(format!(
                "{ORDERS} swaps wait for a sample from the leg already; {}; start the leg, or try \
                 again when it goes on",
                stays(&in_force)
            ));
        }
        self.given = number;
        let known = Known::new(shelved, file.to_owned());
        let record = SwapRecord { number, crc32: known.name.crc32, at: None };
        self.entries.push_back(Entry { record, known: known.clone() });
        if self.entries.len() > MEMORY
            && let Some(oldest) = self.entries.pop_front()
        {
            self.first = oldest.known;
        }
        Ok(Swapping { number, policy: known.name, instead_of: in_force.name })
    }

    /// As [`Office::swap`], with the policy in a file.
    ///
    /// # Errors
    /// As [`Office::swap`], or when the file cannot be read.
    pub fn swap_file(&mut self, path: &Path) -> Result<Swapping, String> {
        let blob = PolicyFile::read(path).map_err(|cause| cause.to_string())?;
        self.swap(&path.display().to_string(), blob.as_slice())
    }

    /// The policy that took over since the last call, if one did: its number, what
    /// it is, and where in the run.
    pub fn news(&mut self) -> Option<String> {
        self.listen();
        let reading = self.board.read();
        if reading.in_force == self.seen_in_force {
            return None;
        }
        self.seen_in_force = reading.in_force;
        let PolicyName { name, crc32, file, .. } = &self.in_force().name;
        let at = reading.since.map_or_else(String::new, |at| format!(" at tick {}", at.seq));
        Some(format!("the policy {name} ({crc32}, {file}) has taken over{at}"))
    }

    /// How the controller is doing.
    pub fn status(&mut self) -> Status {
        self.listen();
        let reading = self.board.read();
        let peer = (self.windows.peer)();
        let activity = match (peer.pid, reading.is_safe) {
            (None, _) => Activity::Waiting,
            (Some(_), true) => Activity::Safe,
            (Some(_), false) => Activity::Running,
        };
        let pending = (reading.in_force < self.given).then(|| self.known(self.given).name.clone());
        Status {
            pid: std::process::id(),
            rate_hz: self.params.rate_hz,
            gravity_m_s2: self.params.gravity_m_s2,
            pace: self.params.time_mode.unwrap_or(TimeMode::LockStep),
            activity,
            policy: self.known(reading.in_force).name.clone(),
            since_unix_s: reading.since_unix.as_secs_f64(),
            since: reading.since,
            pending,
            swaps: reading.in_force,
            last: reading.last,
            ticks: reading.ticks,
            apexes: reading.apexes,
            rejected: reading.rejected,
            peer,
            timing: self.windows.timing.as_ref().map(LatestReport::get),
        }
    }

    /// The policy in force, with its bytes, and the swaps until now.
    pub fn policies(&mut self) -> Policies {
        self.listen();
        let Known { shelved, name } = self.in_force();
        let running = PolicyBytes { policy: name.clone(), blob: shelved.blob().to_vec() };
        Policies { running, swaps: self.entries.iter().map(|entry| entry.record).collect() }
    }

    /// Answers what came to the desk.
    ///
    /// # Errors
    /// Why a request is refused.
    pub fn answer(&mut self, request: Request) -> Result<Value, String> {
        let answer = match request {
            Request::Status => serde_json::to_value(self.status()),
            Request::Swap { file, blob } => serde_json::to_value(self.swap(&file, &blob)?),
            Request::Policy => serde_json::to_value(self.policies()),
        };
        answer.map_err(|cause| cause.to_string())
    }

    /// Writes down what the loop has told.
    fn listen(&mut self) {
        while let Ok(Taken { up_to, at }) = self.taken.pop() {
            for Entry { record, .. } in self.entries.iter_mut().rev() {
                if record.number <= up_to {
                    if record.at.is_some() {
                        break;
                    }
                    record.at = Some(at);
                }
            }
        }
    }

    fn in_force(&self) -> &Known {
        self.known(self.board.read().in_force)
    }

    /// The policy of an order; long forgotten ones are the one before the first remembered.
    fn known(&self, number: u64) -> &Known {
        let back = self.given.saturating_sub(number) as usize;
        let index = self.entries.len().checked_sub(back + 1);
        index.and_then(|index| self.entries.get(index)).map_or(&self.first, |entry| &entry.known)
    }
}

#[cfg(test)]
mod tests;
