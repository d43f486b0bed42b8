//! The controller, flashed.
//!
//! Bytes come by interrupt into a ring; the main loop hands them to the
//! [`Station`], which knows the protocol and the control law, and sends what it
//! answers. In lock-step that is all. Live, the tick timer's interrupt runs the
//! control law on the newest sample, whatever the main loop is doing.
#![no_std]
#![no_main]
// Nobody catches a panic: what could raise one does not pass.
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
mod line;
mod pilot;
mod ring;
mod slots;
mod stack;
mod tick;

use board::{Board, Selected};
use leg_control::serial::desk::{self, BoardFigures};
use leg_control::serial::pilot::SharedPilot;
use leg_control::serial::station::Station;
use cortex_m_rt::entry;
use pilot::PILOT;
use slots::Slots;

const IDENTITY: desk::Board =
    desk::Board { name: Selected::NAME, firmware: env!("CARGO_PKG_VERSION") };

#[entry]
fn main() -> ! {
    PILOT.power_up();
    Selected::power_up();
    let mut station = Station::power_up(IDENTITY, Slots::<Selected>::new(), &PILOT);
    if let Some(alarm) = station.alarm() {
        line::send(alarm);
    }
    loop {
        let byte = line::wait_for_byte();
        if let Some(frame) = station.push(byte, &PILOT, figures) {
            line::send(frame);
            PILOT.with(|pilot| {
                if let Some((turn, command)) = pilot.answered() {
                    crash::remember(*turn, command);
                }
            });
            tick::follow_mode();
            crash::provoke();
        }
    }
}

/// What only this board knows.
fn figures() -> BoardFigures {
    BoardFigures {
        unsent: line::unsent(),
        lost_bytes: line::lost(),
        stack_used: stack::used(),
        stack_size: stack::size(),
    }
}
