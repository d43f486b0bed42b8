//! The flashed controller in a host process: its own code above the bytes, flash
//! in memory, and the system's clock as the timer.
//!
//! It serves to try a bridge without a board, and to test the host's end.

use std::io;
use std::os::unix::net::UnixListener;
use std::time::{Duration, Instant};

use super::stream::{ByteStream, is_end, over_unix};
use crate::flash::{LockedNode, MemoryFlash};
use leg_control::serial::endpoint::Endpoint;
use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::handler::{DeviceInfo, RequestHandler};
use leg_control::serial::message::{Alarm, DeviceCounts, Mode, ToHost};
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::serial::slots::FlashSlots;

const DEVICE: DeviceInfo = DeviceInfo { name: "virtual", firmware: env!("CARGO_PKG_VERSION") };
/// Longest wait before checking whether to go on.
const LOOK: Duration = Duration::from_millis(20);

/// A board in memory.
#[derive(Debug)]
pub struct VirtualBoard {
    endpoint: Endpoint,
    handler: RequestHandler<FlashSlots<MemoryFlash>>,
    alarm: Option<Alarm>,
    node: LockedNode,
    /// Live mode: when the next tick is due.
    next_tick: Option<Instant>,
}

impl VirtualBoard {
    /// Powers a board up with this flash.
    #[must_use]
    pub fn power_up(flash: MemoryFlash) -> Self {
        let node = LockedNode::new(ControlNode::new());
        let (handler, alarm) = RequestHandler::power_up(DEVICE, FlashSlots::new(flash), &node);
        Self { endpoint: Endpoint::new(), handler, alarm, node, next_tick: None }
    }

    /// Turns the power off and on: the flash stays, everything else is lost.
    pub fn power_cycle(&mut self) {
        *self = Self::power_up(self.handler.store().flash().clone());
    }

    /// Serves the host at the other end of `stream` until the stream ends or
    /// `go_on` returns false. The run continues with the next call, as that of a
    /// board does when it is plugged in again.
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
        if let Some(frame) = self.alarm.take().and_then(|alarm| self.endpoint.alarm(alarm)) {
            stream.write_all(frame)?;
        }
        while go_on() {
            let until_tick = self.live_ticks(stream)?;
            let count = stream.read(&mut bytes, until_tick.min(LOOK))?;
            for &byte in &bytes[..count] {
                let Self { endpoint, handler, node, .. } = self;
                if let Some(frame) = endpoint.push(byte, handler, node, DeviceCounts::default) {
                    stream.write_all(frame)?;
                }
            }
        }
        Ok(())
    }

    /// Runs the live tick that is due; returns the time until the next.
    fn live_ticks(&mut self, stream: &mut dyn ByteStream) -> io::Result<Duration> {
        let (mode, rate_hz) = self.node.with(|node| node.mode());
        if mode != Mode::Live {
            self.next_tick = None;
            return Ok(LOOK);
        }
        let period = Duration::from_secs(1) / rate_hz;
        let now = Instant::now();
        let due = *self.next_tick.get_or_insert(now + period);
        if now < due {
            return Ok(due - now);
        }
        let late = now >= due + period;
        self.next_tick = Some(if late { now + period } else { due + period });
        let command = self.node.with(|node| {
            if late {
                node.count_overrun();
            }
            node.live_tick()
        });
        if let Some((seq, command)) = command {
            let mut room = [0; MAX_FRAME];
            if let Ok(frame) = frame::encode(&ToHost::Command { seq, command }, &mut room) {
                stream.write_all(frame)?;
            }
        }
        Ok(Duration::ZERO)
    }

    /// Serves one connection after the other, as a board has one line, until
    /// `go_on` returns false.
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
                // A connection that breaks does not end the board.
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
