//! What a controller says is wrong, in words, with what to do about it.
//!
//! Here and not beside the messages, so that the firmware carries no text.

use leg_control::serial::message::{Alarm, BlobFault, Crash, Refusal, SlotFault};

/// Why a request is refused.
#[must_use]
pub fn refusal(refusal: &Refusal) -> String {
    match *refusal {
        Refusal::Rate { least, most } => {
            format!("it ticks at {least} to {most} Hz; give a --rate within")
        }
        Refusal::Gravity => "gravity must be finite and above 0; give another --gravity".into(),
        Refusal::SetPoint { most_m_s } => {
            format!("a set-point must be finite and at most {most_m_s} m/s, either way")
        }
        Refusal::NoPolicy => {
            "it has no policy to run; bring one by `controller policy upload`".into()
        }
        Refusal::TooLong { room } => {
            format!("a slot has room for {room} bytes; train a smaller actor")
        }
        Refusal::SwapPending => {
            "the policy committed last waits for the leg's next apex; try again after it".into()
        }
        Refusal::EraseWouldStall => {
            "this board stands still while it erases flash, and live the leg would fall; upload \
             while no run is on, or in lock-step"
                .into()
        }
        Refusal::NotBegun => {
            "no upload is under way (was the board reset?); begin the upload anew".into()
        }
        Refusal::Offset { expected } => format!(
            "it expects the blob's byte {expected} next (does another program upload, too?); \
             begin the upload anew"
        ),
        Refusal::Incomplete { received, length } => {
            format!("only {received} of {length} bytes are there; begin the upload anew")
        }
        Refusal::WrongBlob { crc32 } => format!(
            "what arrived has checksum {crc32:08x}, which is not that announced; begin the upload \
             anew"
        ),
        Refusal::Blob(fault) => format!("what arrived is not a valid policy: {}", blob(fault)),
        Refusal::NothingToRollBackTo(fault) => {
            format!("the other slot has nothing to go back to: {}", slot(fault))
        }
        Refusal::Flash => "its flash does not keep what is written; try again, and if it fails \
                           again, the flash is worn out"
            .into(),
        Refusal::InSession => {
            "a bridge runs the leg over this line, and it alone resets the controller and sets \
             its mode; end the bridge first"
                .into()
        }
    }
}

/// Why a slot holds nothing to run.
#[must_use]
pub fn slot(fault: SlotFault) -> String {
    match fault {
        SlotFault::Empty => "empty".into(),
        SlotFault::Unfinished => "an upload was begun and not committed".into(),
        SlotFault::BadSeal => "its seal is damaged".into(),
        SlotFault::RolledBack => "rolled back".into(),
        SlotFault::Blob(fault) => blob(fault),
    }
}

/// Which check a blob fails.
#[must_use]
pub fn blob(fault: BlobFault) -> String {
    match fault {
        BlobFault::TooShort => "the blob is cut off".into(),
        BlobFault::TooLong => "something follows the blob".into(),
        BlobFault::Magic => "no policy blob at all".into(),
        BlobFault::Version(version) => format!(
            "the blob is of format version {version}; write it by the trainer of the firmware's \
             release"
        ),
        BlobFault::Crc => "the blob is damaged".into(),
        BlobFault::Malformed => "the blob's fields cannot be decoded".into(),
        BlobFault::Misaligned => "the blob does not lie at a multiple of 4 bytes".into(),
        BlobFault::Shape => "architecture and weights do not fit".into(),
        BlobFault::NonFinite => "a figure is not finite".into(),
        BlobFault::OutOfRange => "a figure is out of range".into(),
        BlobFault::TooFewTestVectors => "it has too few test vectors".into(),
        BlobFault::TestVector(index) => format!(
            "test vector {index} comes out otherwise on this board: its arithmetic is not that of \
             the trainer"
        ),
    }
}

/// What an alarm says.
#[must_use]
pub fn alarm(alarm: &Alarm) -> String {
    match *alarm {
        Alarm::NoPolicy { a, b } => format!(
            "no policy to run (slot A: {}; slot B: {}); the leg stays in the safe command until \
             `controller policy upload` brings one",
            slot(a),
            slot(b)
        ),
        Alarm::Crash(Crash::Panic { line }) => format!(
            "its program broke off (a panic at line {line}); the leg is in its safe state until \
             the board is powered up again"
        ),
        Alarm::Crash(Crash::HardFault { pc }) => format!(
            "its program broke off (a fault at {pc:#010x}); the leg is in its safe state until \
             the board is powered up again"
        ),
    }
}
