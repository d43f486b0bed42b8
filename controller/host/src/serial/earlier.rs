//! Names a node of an earlier protocol version, which answers no frame of this one.

use leg_control::checksum::crc32;
use leg_control::serial::PROTOCOL_VERSION;

/// Returns for each earlier protocol version the frame of a `Request::Identify`, whose payload is
/// the same in all versions: request 1, with the id 1, of the kind 0. A node answers it by a
/// frame of its own version.
pub(super) fn identify_requests() -> impl Iterator<Item = Vec<u8>> {
    (1..PROTOCOL_VERSION).map(|version| {
        let mut body = vec![version, 1, 1, 0];
        body.extend(crc32(&body).to_le_bytes());
        let mut frame = vec![0];
        for run in body.split(|&byte| byte == 0) {
            frame.push(run.len() as u8 + 1);
            frame.extend(run);
        }
        frame.push(0);
        frame
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::serial::frame::{FrameError, MAX_FRAME, Receiver, encode};
    use leg_control::serial::message::{Request, ToController};

    #[test]
    fn the_requests_are_those_of_this_version_but_for_version_and_checksum() {
        let identify = ToController::Request { id: 1, request: Request::Identify };
        let ours = encode(&identify, &mut [0; MAX_FRAME]).unwrap().to_vec();
        let frames: Vec<_> = identify_requests().collect();
        assert_eq!(frames.len(), usize::from(PROTOCOL_VERSION) - 1);
        for (frame, version) in frames.iter().zip(1..) {
            let mut receiver = Receiver::new();
            let received: Vec<_> = frame
                .iter()
                .filter_map(|&byte| receiver.push(byte).map(|frame| frame.map(<[u8]>::to_vec)))
                .collect();
            assert_eq!(received, [Err(FrameError::Version(version))]);
            // Version, message, id, kind: the same bytes in the same COBS runs.
            assert_eq!(
                (frame.len(), &frame[..2], &frame[3..6]),
                (ours.len(), &ours[..2], &ours[3..6])
            );
        }
    }
}
