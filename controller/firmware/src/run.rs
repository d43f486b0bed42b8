//! The main loop.

use crate::board::{Board, This};
use crate::shared::SHARED;
use crate::tick::Timer;
use crate::{crash, line, stack};
use controller::serial::desk::{self, BoardFigures};
use controller::serial::pilot::Pilot;
use controller::serial::station::Station;

/// Who answers.
const IDENTITY: desk::Board =
    desk::Board { name: This::NAME, firmware: env!("CARGO_PKG_VERSION") };

/// From power-up to its end. `after` sees the pilot after each message that was
/// answered.
pub fn run(after: impl Fn(&mut Pilot<'static>)) -> ! {
    let Some(mut core) = cortex_m::Peripherals::take() else { cortex_m::asm::udf() };
    let board = This::power_up();
    let mut timer = Timer::new(core.SYST, &mut core.SCB, board.clock_hz());
    let mut station = Station::power_up(IDENTITY, board.policy_flash(), &SHARED);
    if let Some(frame) = station.alarm() {
        SHARED.with(|shared| shared.sender.send(frame));
    }
    loop {
        let Some(byte) = line::next() else {
            line::sleep();
            continue;
        };
        let Some(frame) = station.push(byte, &SHARED, figures) else { continue };
        SHARED.with(|shared| {
            shared.sender.send(frame);
            if let Some((turn, command)) = shared.pilot.answered() {
                crash::note(*turn, &command.header);
            }
            timer.follow(&shared.pilot);
            after(&mut shared.pilot);
        });
    }
}

fn figures() -> BoardFigures {
    BoardFigures {
        unsent: SHARED.with(|shared| shared.sender.unsent()),
        lost_bytes: line::lost_bytes(),
        stack_used: stack::used(),
        stack_size: stack::size(),
    }
}
