//! A control node behind any byte stream that implements `embedded_io`.
//!
//! The firmware in `controller/firmware` is this and a board. Here the stream is
//! in memory: a host's requests are read from it, and the node's replies are
//! written to it.
//!
//! ```console
//! $ cargo run -p leg-control --example serial_endpoint
//! ```

use std::cell::RefCell;
use std::convert::Infallible;

use embedded_io::{ErrorType, Read, Write};
use leg_control::policy::{Policy, SHIPPED};
use leg_control::serial::endpoint::Endpoint;
use leg_control::serial::frame::{self, MAX_FRAME, Receiver};
use leg_control::serial::handler::{DeviceInfo, RequestHandler};
use leg_control::serial::message::{
    BlobError, DeviceCounts, Mode, Reply, Request, Slot, SlotError, ToController, ToHost,
};
use leg_control::serial::node::{ControlNode, SharedNode};
use leg_control::serial::store::{PolicyStore, StoreError};
use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};

/// A node that only this thread uses.
struct OwnNode(RefCell<ControlNode<'static>>);

impl SharedNode for OwnNode {
    fn with<R>(&self, f: impl FnOnce(&mut ControlNode<'static>) -> R) -> R {
        f(&mut self.0.borrow_mut())
    }
}

/// A store with the shipped policy in slot A, which takes no other. With flash,
/// `leg_control::serial::slots::FlashSlots` is the store.
struct ShippedPolicy;

impl PolicyStore for ShippedPolicy {
    const BEGIN_STALLS: bool = false;
    const OVERWRITES: bool = false;

    fn capacity(&self) -> usize {
        0
    }

    fn sequence(&self, _slot: Slot) -> u32 {
        0
    }

    fn policy<R>(&self, slot: Slot, f: impl FnOnce(&Policy<'static>) -> R) -> Result<R, SlotError> {
        match slot {
            Slot::A => match Policy::parse(SHIPPED) {
                Ok(policy) => Ok(f(&policy)),
                Err(error) => Err(SlotError::Blob(error.into())),
            },
            Slot::B => Err(SlotError::Empty),
        }
    }

    fn begin(&mut self, _slot: Slot, _length: usize, _origin: &str) -> Result<(), StoreError> {
        Err(StoreError)
    }

    fn write(&mut self, _slot: Slot, _offset: u32, _bytes: &[u8]) -> Result<(), StoreError> {
        Err(StoreError)
    }

    fn check(&self, _slot: Slot, _length: usize) -> Result<u32, BlobError> {
        Err(BlobError::TooShort)
    }

    fn commit(&mut self, _slot: Slot, _length: u32, _crc32: u32) -> Result<(), StoreError> {
        Err(StoreError)
    }

    fn revoke(&mut self, _slot: Slot) -> Result<(), StoreError> {
        Err(StoreError)
    }
}

/// A stream in memory, in place of a UART.
struct MemoryStream<'a> {
    received: &'a [u8],
    sent: Vec<u8>,
}

impl ErrorType for MemoryStream<'_> {
    type Error = Infallible;
}

impl Read for MemoryStream<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        self.received.read(bytes)
    }
}

impl Write for MemoryStream<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.sent.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Encodes what a host sends: two requests and one sample.
fn from_host() -> Vec<u8> {
    let header = Header {
        version: WIRE_VERSION,
        flags: flags::STATE_SENSED | flags::CONTACT_SENSED,
        run_id: 1,
        seq: 0,
        t_ns: 0,
    };
    let sample = Sample { header, y_m: 2.0, ..Sample::default() };
    let messages = [
        ToController::Request { id: 1, request: Request::Identify },
        ToController::Request { id: 2, request: Request::SetMode(Mode::LockStep) },
        ToController::Sample { seq: 1, sample },
    ];
    let mut bytes = Vec::new();
    for message in messages {
        let mut room = [0; MAX_FRAME];
        bytes.extend_from_slice(frame::encode(&message, &mut room).expect("it fits a frame"));
    }
    bytes
}

fn main() {
    let node = OwnNode(RefCell::new(ControlNode::new()));
    let device = DeviceInfo { name: "example", firmware: env!("CARGO_PKG_VERSION") };
    let (mut handler, alarm) = RequestHandler::power_up(device, ShippedPolicy, &node);
    assert_eq!(alarm, None, "the shipped policy runs");

    let host = from_host();
    let mut stream = MemoryStream { received: &host, sent: Vec::new() };
    let mut endpoint = Endpoint::new();
    while endpoint.serve(&mut stream, &mut handler, &node, DeviceCounts::default) != Ok(0) {}

    // The host's side again: it decodes what the node has sent.
    let mut receiver = Receiver::new();
    let mut answers = 0;
    for byte in stream.sent {
        let Some(Ok(payload)) = receiver.push(byte) else { continue };
        answers += 1;
        match frame::decode(payload) {
            Ok(ToHost::Reply { reply: Reply::Identity(identity), .. }) => {
                let policy = identity.policy.map_or("none", |policy| policy.name);
                println!("{} at {} Hz, policy {policy}", identity.board, identity.rate_hz);
            }
            Ok(ToHost::Command { command, .. }) => {
                println!("leg angle {:.3} rad", command.leg_angle_rad);
            }
            other => println!("{other:?}"),
        }
    }
    assert_eq!(answers, 3, "one answer each");
}
