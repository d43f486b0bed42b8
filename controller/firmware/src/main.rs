//! The controller, flashed.
//!
//! Bytes come by interrupt into a queue. The main loop passes them to the
//! [`Endpoint`] and sends the frames that answer them; a sample in lock-step is
//! a tick. In live mode the timer's interrupt runs the control law on the newest
//! sample, whatever the main loop is doing.
#![no_std]
#![no_main]
// Nothing catches a panic, so code that could raise one is refused.
#![cfg_attr(
    not(feature = "provoke"),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::unreachable
    )
)]

mod board;
mod crash;
mod half;
mod line;
mod node;
mod slots;
mod stack;
mod tick;

use board::{Board, Selected};
use cortex_m_rt::entry;
use leg_control::serial::endpoint::Endpoint;
use leg_control::serial::handler::{DeviceInfo, RequestHandler};
use leg_control::serial::message::DeviceCounts;
use leg_control::serial::node::SharedNode;
use leg_control::serial::slots::FlashSlots;
use node::NODE;
use slots::PolicyFlash;

const DEVICE: DeviceInfo = DeviceInfo { name: Selected::NAME, firmware: env!("CARGO_PKG_VERSION") };

#[entry]
fn main() -> ! {
    static mut INCOMING: line::Bytes = line::Bytes::new();
    static mut OUTGOING: line::Bytes = line::Bytes::new();
    NODE.power_up();
    line::power_up(INCOMING, OUTGOING);
    Selected::power_up();
    let store = FlashSlots::new(PolicyFlash::<Selected>::new());
    let (mut handler, alarm) = RequestHandler::power_up(DEVICE, store, &NODE);
    let mut endpoint = Endpoint::new();
    if let Some(frame) = alarm.and_then(|alarm| endpoint.alarm(alarm)) {
        line::send(frame);
    }
    loop {
        let byte = line::wait_for_byte();
        if let Some(frame) = endpoint.push(byte, &mut handler, &NODE, device_counts) {
            line::send(frame);
            NODE.with(|node| {
                if let Some((seq, command)) = node.answered() {
                    crash::remember(*seq, command);
                }
            });
            tick::follow_mode();
            crash::provoke();
        }
    }
}

/// Returns the counters that only this board knows.
fn device_counts() -> DeviceCounts {
    DeviceCounts {
        unsent: line::unsent(),
        lost_bytes: line::lost(),
        stack_used: stack::used(),
        stack_size: stack::size(),
    }
}
