//! The control tick of live mode: `SysTick`, at the rate of the last reset.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::message::{Mode, ToHost};
use leg_control::serial::node::{ControlNode, SharedNode};

use crate::board::{Board, Selected};
use crate::node::NODE;
use crate::{crash, line};

/// Ticks a second of the running timer, Hz; 0 while it stands.
static RATE_HZ: AtomicU32 = AtomicU32::new(0);

/// Starts, changes or stops the timer, as the node's mode requires.
pub(crate) fn follow_mode() {
    let rate_hz = match NODE.with(|node| node.mode()) {
        (Mode::Live, rate_hz) => rate_hz,
        (Mode::Idle | Mode::LockStep, _) => 0,
    };
    if RATE_HZ.swap(rate_hz, Ordering::Relaxed) != rate_hz {
        Selected::set_tick_rate(rate_hz);
    }
}

#[exception]
fn SysTick() {
    let Some((seq, command)) = NODE.with(ControlNode::live_tick) else { return };
    crash::remember(seq, &command);
    let mut out = [0; MAX_FRAME];
    if let Ok(frame) = frame::encode(&ToHost::Command { seq, command }, &mut out) {
        line::send(frame);
    }
    if SCB::is_pendst_pending() {
        NODE.with(ControlNode::count_overrun);
    }
}
