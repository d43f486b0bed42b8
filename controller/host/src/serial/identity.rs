//! The identity of the device at the other end of the line.

use leg_control::serial::message::{Identity, Mode, PolicyReport, Slot};

/// [`Identity`], to keep.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceIdentity {
    /// [`leg_control::wire::WIRE_VERSION`] of the controller.
    pub wire_version: u16,
    /// The board.
    pub board: String,
    /// Version of the firmware.
    pub firmware: String,
    /// Of the last reset; none since power-up.
    pub session: Option<u32>,
    /// How ticks come about.
    pub mode: Mode,
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
    /// The policy that runs.
    pub policy: Option<PolicyIdentity>,
}

/// [`PolicyReport`], to keep.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyIdentity {
    /// Its slot.
    pub slot: Slot,
    /// Its name.
    pub name: String,
    /// The blob's checksum.
    pub crc32: u32,
    /// The leg it was trained on, by its fingerprint.
    pub leg: u32,
}

impl From<&Identity<'_>> for DeviceIdentity {
    fn from(identity: &Identity<'_>) -> Self {
        let Identity {
            wire_version,
            board,
            firmware,
            session,
            mode,
            rate_hz,
            gravity_m_s2,
            policy,
        } = *identity;
        let policy = policy.map(|PolicyReport { slot, name, crc32, leg }| PolicyIdentity {
            slot,
            name: name.to_owned(),
            crc32,
            leg,
        });
        let (board, firmware) = (board.to_owned(), firmware.to_owned());
        Self { wire_version, board, firmware, session, mode, rate_hz, gravity_m_s2, policy }
    }
}
