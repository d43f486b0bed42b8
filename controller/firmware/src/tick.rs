//! The tick of live mode: SysTick at the rate of the last reset.
#![allow(unsafe_code)]

use crate::ceiling::TICK_PRIORITY;
use crate::crash;
use crate::shared::SHARED;
use controller::serial::frame::{self, MAX_FRAME};
use controller::serial::message::{Mode, ToHost};
use controller::serial::pilot::Pilot;
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};
use cortex_m_rt::exception;

/// SysTick, running at the pilot's rate while it is live.
pub struct Timer {
    syst: SYST,
    clock_hz: u32,
    rate_hz: Option<u32>,
}

impl Timer {
    /// A timer at rest, on the processor's clock.
    pub fn new(mut syst: SYST, scb: &mut SCB, clock_hz: u32) -> Self {
        // SAFETY: the priority is that of the ceiling which guards all that the
        // handler below shares.
        unsafe { scb.set_priority(SystemHandler::SysTick, TICK_PRIORITY) };
        syst.set_clock_source(SystClkSource::Core);
        Self { syst, clock_hz, rate_hz: None }
    }

    /// Starts, stops or changes pace as the pilot wants it.
    pub fn follow(&mut self, pilot: &Pilot<'_>) {
        let rate_hz = (pilot.mode() == Mode::Live).then_some(pilot.terms().rate_hz);
        if rate_hz == self.rate_hz {
            return;
        }
        self.rate_hz = rate_hz;
        self.syst.disable_counter();
        self.syst.disable_interrupt();
        // A tick of the old pace that waits is none of the new one.
        SCB::clear_pendst();
        if let Some(rate_hz) = rate_hz {
            // To the nearest; 24 bits hold it at any rate and clock there is.
            let cycles = (self.clock_hz + rate_hz / 2).checked_div(rate_hz).unwrap_or(0);
            self.syst.set_reload(cycles.saturating_sub(1));
            self.syst.clear_current();
            self.syst.enable_interrupt();
            self.syst.enable_counter();
        }
    }
}

#[exception]
fn SysTick() {
    SHARED.with(|shared| {
        if let Some((turn, command)) = shared.pilot.live_tick() {
            let mut buffer = [0; MAX_FRAME];
            if let Ok(frame) = frame::encode(&ToHost::Command { turn, command }, &mut buffer) {
                shared.sender.send(frame);
            }
            crash::note(turn, &command.header);
        }
        if SCB::is_pendst_pending() {
            shared.pilot.count_overrun();
        }
    });
}
