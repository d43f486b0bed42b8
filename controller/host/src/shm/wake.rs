//! Wake-ups between two ends that share busy cores.
//!
//! Polling finds a message fastest, as long as both ends have a core of their own. On busy cores
//! an end that polls uses up its time slices, and one that sleeps gets a core milliseconds too
//! late. A process that blocks on a socket runs as soon as the peer, which blocks in turn, has
//! written to it. That costs a system call for each message, so it takes place only where an end
//! wants it: one whose ticks take longer than that.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::discovery::Session;
use crate::link::Role;

/// Returns the path at which an end waits for wake-ups.
pub(super) fn path(session: &Session, role: Role) -> PathBuf {
    session.folder.join(format!("{}.wake", role.as_str()))
}

/// The wake-ups from the peer, and to it.
#[derive(Debug)]
pub(super) struct Wake(UnixDatagram);

impl Wake {
    /// Binds the socket of `own`, if the peer has one; `None` if it wants no wake-ups.
    ///
    /// # Errors
    /// Returns an error if the peer's socket is there and a connection fails.
    pub(super) fn with_peer(session: &Session, own: Role, peer: Role) -> io::Result<Option<Self>> {
        let theirs = path(session, peer);
        if !theirs.exists() {
            return Ok(None);
        }
        let socket = UnixDatagram::bind(path(session, own))?;
        socket.set_nonblocking(true)?;
        socket.connect(theirs)?;
        Ok(Some(Self(socket)))
    }

    /// Wakes the peer. One that has yet to read earlier wake-ups, or is gone, needs none.
    pub(super) fn send(&self) {
        let _ = self.0.send(&[0]);
    }

    /// Blocks until the peer sends a wake-up, at most for `timeout`.
    pub(super) fn wait(&self, timeout: Duration) {
        let timeout = Timespec {
            tv_sec: timeout.as_secs().try_into().unwrap_or(i64::MAX),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        // A signal ends the wait early, which does no harm.
        let _ = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&timeout));
        while self.0.recv(&mut [0]).is_ok() {}
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn session() -> (tempfile::TempDir, Session) {
        let folder = tempfile::tempdir().unwrap();
        let session = Session { prefix: "leg-".into(), folder: folder.path().to_owned() };
        (folder, session)
    }

    #[test]
    fn an_end_that_wants_wake_ups_gets_and_sends_them() {
        let (_folder, session) = session();
        let (leg, controller) = (Role::Leg, Role::Controller);
        assert!(Wake::with_peer(&session, controller, leg).unwrap().is_none(), "nobody wants any");
        let peer = UnixDatagram::bind(path(&session, leg)).unwrap();
        let wake = Wake::with_peer(&session, controller, leg).unwrap().unwrap();
        peer.connect(path(&session, controller)).unwrap();

        wake.send();
        assert_eq!(peer.recv(&mut [0; 8]).unwrap(), 1);
        for _ in 0..3 {
            peer.send(&[7; 5]).unwrap();
        }
        let begun = Instant::now();
        wake.wait(Duration::from_mins(1));
        assert!(begun.elapsed() < Duration::from_secs(30));
        // All three are read, so that an old one ends no later wait.
        let begun = Instant::now();
        wake.wait(Duration::from_millis(5));
        assert!(begun.elapsed() >= Duration::from_millis(5));
    }

    #[test]
    fn a_peer_that_reads_nothing_or_is_gone_stops_nobody() {
        let (_folder, session) = session();
        let peer = UnixDatagram::bind(path(&session, Role::Leg)).unwrap();
        let wake = Wake::with_peer(&session, Role::Controller, Role::Leg).unwrap().unwrap();
        (0..10_000).for_each(|_| wake.send());
        drop(peer);
        wake.send();
        wake.wait(Duration::from_millis(1));
    }
}
