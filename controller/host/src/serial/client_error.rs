//! Why a request to a controller failed.

use std::io;
use std::time::Duration;

use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::message::{Alarm, RequestError};

/// Why a request failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The stream broke.
    #[error(
        "the line to the controller broke: {0}; is the board unplugged, or has the emulator ended?"
    )]
    Line(#[from] io::Error),
    /// Nothing arrived.
    #[error(
        "no answer for {:.1} s: {}{}",
        waited.as_secs_f64(),
        taken_by(others),
        match is_serial_port {
            true => "is the board powered, the baud rate right?",
            false => "is the process stopped, or does another program use it?",
        }
    )]
    Silent {
        /// Time waited.
        waited: Duration,
        /// Other processes that have the port open.
        others: Vec<String>,
        /// Whether the line is a serial port, and not a socket.
        is_serial_port: bool,
    },
    /// Frames arrived, but none was good.
    #[error(
        "only noise has arrived for {:.1} s ({bad} damaged frames): {}{}",
        waited.as_secs_f64(),
        taken_by(others),
        match is_serial_port {
            true => "is the baud rate right, the cable good?",
            false => "is it a controller?",
        }
    )]
    Noise {
        /// Time waited.
        waited: Duration,
        /// Other processes that have the port open.
        others: Vec<String>,
        /// Whether the line is a serial port, and not a socket.
        is_serial_port: bool,
        /// Damaged frames.
        bad: u32,
    },
    /// The policy does not fit a slot of the controller.
    #[error(
        "the policy has {len} bytes, and a slot of this controller has room for {room}; train a \
         smaller actor, or take a board with larger slots"
    )]
    TooLong {
        /// Length of the policy, bytes.
        len: usize,
        /// Room of a slot, bytes.
        room: u32,
    },
    /// The controller uses another protocol version.
    #[error(
        "the controller uses protocol version {theirs}, this program {PROTOCOL_VERSION}; flash the \
         firmware of this release, or use the program of that one"
    )]
    ProtocolVersion {
        /// The version of the controller.
        theirs: u8,
    },
    /// The controller refuses the request.
    #[error("the controller refuses: {0}")]
    Refused(RequestError),
    /// The reply is of another kind than the request.
    #[error("the controller's reply does not fit the request; build both from the same release")]
    WrongReply,
    /// The controller has crashed.
    #[error("the controller has raised an alarm: {0}")]
    Alarm(Alarm),
    /// A signal asked this process to stop.
    #[error("stopped by a signal")]
    Stopped,
}

/// Returns the sentence on other processes that use the same port; empty without any.
#[must_use]
pub fn taken_by(others: &[String]) -> String {
    match others {
        [] => String::new(),
        [one] => format!("{one} has the port open, too, and may take the answers; end it; "),
        more => format!(
            "{} have the port open, too, and may take the answers; end them; ",
            more.join(", ")
        ),
    }
}

impl ClientError {
    /// Returns whether the stream broke, so that another one may work.
    #[must_use]
    pub fn is_unplugged(&self) -> bool {
        matches!(self, Self::Line(_))
    }
}
