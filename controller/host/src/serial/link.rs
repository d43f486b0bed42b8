//! A link over a stream of bytes: samples one way, commands the other, each in a frame of
//! `controller/src/serial/PROTOCOL.md`.
//!
//! It retransmits nothing: a frame that is damaged on the way is a lost message, and the next
//! one counts. The [`Client`](super::Client) retransmits.

use std::io;
use std::time::{Duration, Instant};

use super::line::{Came, Line, framed};
use super::stream::{ByteStream, is_end};
use crate::link::Role;
use crate::link::{Link, LinkError};
use leg_control::serial::frame;
use leg_control::serial::message::{ToController, ToHost};
use leg_control::wire::{Command, Sample};

/// A message that fills a frame.
pub trait Framed: Copy {
    /// The role that sends it.
    const SENDER: Role;

    /// Returns the frame of the message with the sender's number `seq`.
    fn frame(&self, seq: u32) -> Option<Vec<u8>>;

    /// Returns the message in the payload of a frame; `None` if that is of another type.
    fn unframe(payload: &[u8]) -> Option<Self>;
}

impl Framed for Sample {
    const SENDER: Role = Role::Leg;

    fn frame(&self, seq: u32) -> Option<Vec<u8>> {
        framed(&ToController::Sample { seq, sample: *self }).ok()
    }

    fn unframe(payload: &[u8]) -> Option<Self> {
        match frame::decode(payload).ok()? {
            ToController::Sample { sample, .. } => Some(sample),
            ToController::Request { .. } => None,
        }
    }
}

impl Framed for Command {
    const SENDER: Role = Role::Controller;

    fn frame(&self, seq: u32) -> Option<Vec<u8>> {
        framed(&ToHost::Command { seq, command: *self }).ok()
    }

    fn unframe(payload: &[u8]) -> Option<Self> {
        match frame::decode(payload).ok()? {
            ToHost::Command { command, .. } => Some(command),
            ToHost::Reply { .. } | ToHost::Alarm(_) => None,
        }
    }
}

/// One end of a link over a stream.
pub struct SerialLink<Out, In> {
    line: Line,
    seq: u32,
    /// The process at the other end, for messages about it.
    peer_pid: u32,
    /// The stream has ended; messages before that still count.
    ended: bool,
    newest: Option<In>,
    sends: core::marker::PhantomData<Out>,
}

/// The leg's end.
pub type SerialLeg = SerialLink<Sample, Command>;
/// The controller's end.
pub type SerialController = SerialLink<Command, Sample>;

impl<Out, In> SerialLink<Out, In> {
    /// Creates a link over an open stream; `peer_pid` is the process at its other end.
    #[must_use]
    pub fn new(stream: Box<dyn ByteStream>, peer_pid: u32) -> Self {
        Self {
            line: Line::new(stream),
            seq: 0,
            peer_pid,
            ended: false,
            newest: None,
            sends: core::marker::PhantomData,
        }
    }
}

impl<Out: Framed, In: Framed> SerialLink<Out, In> {
    /// Reads all that has arrived; waits for the first byte at most `timeout`. The newest
    /// message replaces those before.
    fn listen(&mut self, mut timeout: Duration) -> Result<(), LinkError> {
        while !self.ended {
            match self.line.receive(timeout) {
                Ok(Came::Frame) => self.newest = In::unframe(self.line.payload()).or(self.newest),
                Ok(Came::Bad(_)) => (),
                Ok(Came::Nothing) if timeout.is_zero() => return Ok(()),
                // The rest of a frame may follow at once.
                Ok(Came::Nothing) => return self.listen(Duration::ZERO),
                Err(error) if is_end(&error) => self.ended = true,
                Err(cause) => return Err(failed("receive", &cause)),
            }
            timeout = Duration::ZERO;
        }
        Ok(())
    }
}

impl<Out: Framed, In: Framed> Link for SerialLink<Out, In> {
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        self.seq = self.seq.wrapping_add(1);
        let too_long = || LinkError::Transport {
            action: "send",
            cause: "the message is longer than a frame".to_owned(),
        };
        let frame = message.frame(self.seq).ok_or_else(too_long)?;
        // `receive` reports a stream that is broken.
        self.line.send(&frame);
        Ok(())
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        let begun = Instant::now();
        self.listen(Duration::ZERO)?;
        loop {
            if let Some(message) = self.newest.take() {
                return Ok(Some(message));
            }
            if self.ended {
                return Err(LinkError::PeerLeft { role: In::SENDER, pid: self.peer_pid });
            }
            let left = timeout.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            self.listen(left)?;
        }
    }
}

fn failed(action: &'static str, cause: &io::Error) -> LinkError {
    LinkError::Transport { action, cause: cause.to_string() }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use super::super::Noisy;
    use super::super::stream::over_unix;
    use super::*;
    use leg_control::wire::Header;

    fn pair() -> (Box<dyn ByteStream>, Box<dyn ByteStream>) {
        let (leg, controller) = UnixStream::pair().unwrap();
        (over_unix(leg).unwrap(), over_unix(controller).unwrap())
    }

    #[test]
    fn on_a_noisy_line_a_message_arrives_undamaged_or_not_at_all() {
        let (leg, controller) = pair();
        let mut leg = SerialLeg::new(Box::new(Noisy::new(leg, 0.005, 11)), 1);
        let mut controller = SerialController::new(controller, 1);
        let mut came = 0;
        for seq in 0..2000 {
            let sample = Sample {
                header: Header { seq, ..Header::default() },
                y_m: 0.3,
                ..Sample::default()
            };
            leg.send(&sample).unwrap();
            if let Some(got) = controller.receive(Duration::ZERO).unwrap() {
                assert_eq!(got, sample);
                came += 1;
            }
        }
        assert!((1000..1900).contains(&came), "{came}");
    }
}
