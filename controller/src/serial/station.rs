//! One end of the line: bytes in, frames out.

use super::desk::{Board, BoardFigures, Desk};
use super::frame::{self, MAX_FRAME, Receiver};
use super::message::{Alarm, ToController, ToHost};
use super::pilot::SharedPilot;
use super::slots::PolicyFlash;

/// Receiver and desk, and the frame that is going out.
///
/// The pilot is shared with whatever ticks, and given to each call. The
/// commands of live ticks do not come this way: who calls
/// [`super::pilot::Pilot::live_tick`] encodes what comes of it as
/// [`ToHost::Command`] with [`frame::encode`].
#[derive(Clone, Debug)]
pub struct Station<F> {
    receiver: Receiver,
    desk: Desk<F>,
    alarm: Option<Alarm>,
    out: [u8; MAX_FRAME],
}

impl<F: PolicyFlash> Station<F> {
    /// After power-up: has the pilot fly the policy to run.
    pub fn power_up(board: Board, flash: F, pilot: &impl SharedPilot) -> Self {
        let (desk, alarm) = Desk::power_up(board, flash, pilot);
        Self { receiver: Receiver::new(), desk, alarm, out: [0; MAX_FRAME] }
    }

    /// The desk.
    #[must_use]
    pub fn desk(&self) -> &Desk<F> {
        &self.desk
    }

    /// The frame to send first, if power-up found something wrong.
    pub fn alarm(&mut self) -> Option<&[u8]> {
        let alarm = self.alarm.take()?;
        frame::encode(&ToHost::Alarm(alarm), &mut self.out).ok()
    }

    /// Takes a byte from the line; returns the frame to send, if it ends a
    /// message that is to be answered now. `figures` is called for requests.
    pub fn push(
        &mut self,
        byte: u8,
        pilot: &impl SharedPilot,
        figures: impl FnOnce() -> BoardFigures,
    ) -> Option<&[u8]> {
        self.receiver.push(byte)?.ok()?;
        let answer = match frame::decode(self.receiver.payload()) {
            Ok(ToController::Sample { turn, sample }) => {
                let command = pilot.with(|pilot| pilot.sample(turn, &sample))?;
                ToHost::Command { turn, command }
            }
            Ok(ToController::Request { id, request }) => {
                let line = self.receiver.counts();
                let reply = self.desk.answer(id, &request, pilot, line, &figures());
                ToHost::Reply { id, reply }
            }
            Err(frame::Unknown) => {
                self.receiver.count_unknown();
                return None;
            }
        };
        // Every message fits (see the tests).
        frame::encode(&answer, &mut self.out).ok()
    }
}
