//! The flashed controller in a host process: its own code for everything above
//! the bytes, flash in memory, the system's clock as the timer.
//!
//! For trying a bridge without a board, and for tests of the host's end.

use std::io;
use std::os::unix::net::UnixListener;
use std::time::{Duration, Instant};

use super::stream::{ByteStream, over_unix};
use crate::flash::{LockedPilot, MemoryFlash};
use leg_control::serial::desk::{Board, BoardFigures};
use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::message::{Mode, ToHost};
use leg_control::serial::pilot::{Pilot, SharedPilot};
use leg_control::serial::station::Station;

const BOARD: Board = Board { name: "virtual", firmware: env!("CARGO_PKG_VERSION") };
/// Longest wait before looking whether to go on.
const LOOK: Duration = Duration::from_millis(20);

/// A board with nothing around it.
#[derive(Debug)]
pub struct VirtualBoard {
    station: Station<MemoryFlash>,
    pilot: LockedPilot,
    /// Live: when the next tick is.
    next_tick: Option<Instant>,
}

impl VirtualBoard {
    /// Powers it up with this in its flash.
    #[must_use]
    pub fn power_up(flash: MemoryFlash) -> Self {
        let pilot = LockedPilot::new(Pilot::new());
        Self { station: Station::power_up(BOARD, flash, &pilot), pilot, next_tick: None }
    }

    /// As after its power was off and on: the flash is as it was, all else forgotten.
    pub fn power_cycle(&mut self) {
        *self = Self::power_up(self.station.desk().flash().clone());
    }

    /// Serves whoever is at the other end of `stream`, until the stream ends or
    /// `go_on` says no. The run goes on with the next call, as a board's does
    /// when it is plugged in again.
    ///
    /// # Errors
    /// When the stream breaks otherwise than by ending.
    pub fn serve(
        &mut self,
        stream: &mut dyn ByteStream,
        mut go_on: impl FnMut() -> bool,
    ) -> io::Result<()> {
        let outcome = self.try_serve(stream, &mut go_on);
        match outcome {
            Err(error) if is_end(&error) => Ok(()),
            outcome => outcome,
        }
    }

    fn try_serve(
        &mut self,
        stream: &mut dyn ByteStream,
        go_on: &mut impl FnMut() -> bool,
    ) -> io::Result<()> {
        let mut bytes = [0; 1024];
        if let Some(alarm) = self.station.alarm() {
            stream.write_all(alarm)?;
        }
        while go_on() {
            let until_tick = self.live_ticks(stream)?;
            let count = stream.read(&mut bytes, until_tick.min(LOOK))?;
            for &byte in &bytes[..count] {
                if let Some(frame) = self.station.push(byte, &self.pilot, BoardFigures::default) {
                    stream.write_all(frame)?;
                }
            }
        }
        Ok(())
    }

    /// Runs the live ticks that are due; returns how long until the next.
    fn live_ticks(&mut self, stream: &mut dyn ByteStream) -> io::Result<Duration> {
        let (mode, terms) = self.pilot.with(|pilot| (pilot.mode(), pilot.terms()));
        if mode != Mode::Live {
            self.next_tick = None;
            return Ok(LOOK);
        }
        let period = Duration::from_secs(1) / terms.rate_hz;
        let now = Instant::now();
        let due = *self.next_tick.get_or_insert(now + period);
        if now < due {
            return Ok(due - now);
        }
        let late = now >= due + period;
        self.next_tick = Some(if late { now + period } else { due + period });
        let command = self.pilot.with(|pilot| {
            if late {
                pilot.count_overrun();
            }
            pilot.live_tick()
        });
        if let Some((turn, command)) = command {
            let mut room = [0; MAX_FRAME];
            if let Ok(frame) = frame::encode(&ToHost::Command { turn, command }, &mut room) {
                stream.write_all(frame)?;
            }
        }
        Ok(Duration::ZERO)
    }

    /// Serves one caller after the other, as a board has one line, until
    /// `go_on` says no.
    ///
    /// # Errors
    /// When the listener fails.
    pub fn listen(
        &mut self,
        listener: &UnixListener,
        mut go_on: impl FnMut() -> bool,
    ) -> io::Result<()> {
        listener.set_nonblocking(true)?;
        while go_on() {
            match listener.accept() {
                // A caller that breaks off is no reason to end.
                Ok((socket, _)) => {
                    let _ = self.serve(&mut *over_unix(socket)?, &mut go_on);
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    std::thread::sleep(Duration::from_millis(2));
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Whether the other end has hung up.
fn is_end(error: &io::Error) -> bool {
    use io::ErrorKind::{BrokenPipe, ConnectionReset, UnexpectedEof};
    matches!(error.kind(), UnexpectedEof | BrokenPipe | ConnectionReset)
}
