//! What the two ends of a session send each other over a unix socket.
//!
//! The controller listens at [`SOCKET`] in the folder of its domain, and the leg connects.
//! The lines and their order are in `SESSION.md`, which programs of other languages follow.

use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::net::{SendFlags, send};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::discovery::Session;
use crate::link::SessionParams;

/// Version of the lines and of what they agree on.
pub(crate) const SESSION_VERSION: u16 = 1;

/// Name of the controller's socket in the folder of a domain.
pub(super) const SOCKET: &str = "session.sock";

/// Returns the path of the controller's socket in the folder of a domain.
pub(crate) fn socket_in(folder: &Path) -> PathBuf {
    folder.join(SOCKET)
}

/// Time after which a missing line is reported.
const OVERDUE_AFTER: Duration = Duration::from_secs(1);

/// Longest line that is read, bytes.
const MAX_LINE: u64 = 4096;

/// A line that one end sends to the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Line {
    /// The first line of each end.
    Hello(Hello),
    /// This end has opened the session's shared memory.
    Ready,
    /// This end takes no part in the session; the text says why, for the user of the other end.
    Refused(String),
    /// This end leaves in good order.
    Left,
}

/// What each end publishes about itself before the first message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Hello {
    /// [`SESSION_VERSION`] of the sender.
    #[serde(default = "first_version")]
    pub(super) version: u16,
    /// Process id, in its own container; for messages only.
    pub(super) pid: u32,
    /// What both ends must agree on.
    pub(super) params: SessionParams,
    /// The session's shared memory, from a controller that agrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) session: Option<Session>,
    /// Why there is none, from a controller that disagrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) refused: Option<String>,
    /// Names in `params` that this version does not know, of a hello that was received.
    #[serde(skip)]
    pub(super) unknown: Vec<String>,
}

fn first_version() -> u16 {
    1
}

impl Hello {
    /// Returns the hello of this process.
    pub(super) fn of(params: SessionParams) -> Self {
        let pid = std::process::id();
        Self {
            version: SESSION_VERSION,
            pid,
            params,
            session: None,
            refused: None,
            unknown: Vec::new(),
        }
    }

    /// Returns the names in the `params` of a line that this version does not know.
    fn unknown_in(&self, line: &[u8]) -> Vec<String> {
        let known = serde_json::to_value(self.params).unwrap_or_default();
        let sent: Value = serde_json::from_slice(line).unwrap_or_default();
        let names = sent["hello"]["params"].as_object().into_iter().flat_map(Map::keys);
        names.filter(|name| known.get(name).is_none()).cloned().collect()
    }
}

/// A connected socket, which is read and written without waiting. It sends
/// [`Line::Left`] when dropped.
#[derive(Debug)]
pub(super) struct Channel {
    reader: BufReader<UnixStream>,
    line: Vec<u8>,
    /// Since when the next line is awaited; `None` once that was reported.
    since: Option<Instant>,
}

impl Channel {
    pub(super) fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let since = Some(Instant::now());
        Ok(Self { reader: BufReader::new(socket), line: Vec::new(), since })
    }

    /// Returns whether the next line is overdue; once for each line.
    pub(super) fn is_overdue(&mut self) -> bool {
        let is_overdue = self.since.is_some_and(|since| since.elapsed() >= OVERDUE_AFTER);
        if is_overdue {
            self.since = None;
        }
        is_overdue
    }

    /// Sends a line. A peer that is gone or takes nothing is noticed by the next read.
    pub(super) fn send(&self, line: &Line) {
        if let Ok(mut text) = serde_json::to_vec(line) {
            text.push(b'\n');
            let _ = send(self.reader.get_ref(), &text, SendFlags::NOSIGNAL);
        }
    }

    /// Returns the next line, or `None` while there is none.
    ///
    /// # Errors
    /// Returns an error when the peer is gone, [`ErrorKind::InvalidData`] when it has sent
    /// something else.
    pub(super) fn next(&mut self) -> io::Result<Option<Line>> {
        let left = MAX_LINE.saturating_sub(self.line.len() as u64);
        match self.reader.by_ref().take(left).read_until(b'\n', &mut self.line) {
            Ok(_) if self.line.ends_with(b"\n") => {
                self.since = Some(Instant::now());
                let bytes = std::mem::take(&mut self.line);
                let mut line = serde_json::from_slice(&bytes)
                    .map_err(|cause| io::Error::new(ErrorKind::InvalidData, cause))?;
                if let Line::Hello(hello) = &mut line {
                    hello.unknown = hello.unknown_in(&bytes);
                }
                Ok(Some(line))
            }
            Ok(_) if self.line.len() as u64 >= MAX_LINE => Err(ErrorKind::InvalidData.into()),
            Ok(_) => Err(ErrorKind::UnexpectedEof.into()),
            Err(cause) if cause.kind() == ErrorKind::WouldBlock => Ok(None),
            Err(cause) => Err(cause),
        }
    }
}

impl Drop for Channel {
    fn drop(&mut self) {
        self.send(&Line::Left);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::link::TimeMode;

    fn channel() -> (UnixStream, Channel) {
        let (near, far) = UnixStream::pair().unwrap();
        (near, Channel::new(far).unwrap())
    }

    #[test]
    fn lines_arrive_whole_and_in_order_and_the_end_is_noticed() {
        let (mut peer, mut channel) = channel();
        assert_eq!(channel.next().unwrap(), None);
        let hello = r#"{"hello":{"pid":7,"params":{"wire_version":9,"rate_hz":500,"gravity_m_s2":0.3,"leg":null,"time_mode":"real-time"},"novelty":[]}}"#;
        peer.write_all(&hello.as_bytes()[..20]).unwrap();
        assert_eq!(channel.next().unwrap(), None, "it is incomplete");
        peer.write_all(format!("{}\n\"ready\"\n\"left\"\n", &hello[20..]).as_bytes()).unwrap();
        let params = SessionParams { wire_version: 9, ..SessionParams::at(500) };
        let params = params.with_gravity(0.3).with_time_mode(TimeMode::RealTime);
        let expected = Hello { pid: 7, ..Hello::of(params) };
        assert_eq!(expected.version, 1, "if missing");
        assert_eq!(channel.next().unwrap(), Some(Line::Hello(expected)));
        drop(peer);
        assert_eq!(channel.next().unwrap(), Some(Line::Ready), "before the end");
        assert_eq!(channel.next().unwrap(), Some(Line::Left));
        assert_eq!(channel.next().unwrap_err().kind(), ErrorKind::UnexpectedEof);
        channel.send(&Line::Ready);
    }

    #[test]
    fn the_lines_in_the_document_are_those_that_are_sent() {
        let document = include_str!("../../SESSION.md");
        let examples: Vec<&str> = document
            .lines()
            .map(str::trim)
            .filter(|line| {
                line.starts_with("{\"") || line.starts_with("\"re") || *line == "\"left\""
            })
            .collect();
        assert_eq!(examples.len(), 6);
        for example in examples {
            let line: Line = serde_json::from_str(example).expect(example);
            assert_eq!(serde_json::to_string(&line).unwrap(), example);
        }
        assert!(document.contains("at most 4,096 bytes") && MAX_LINE == 4096);
    }

    #[test]
    fn parameters_arrive_bit_for_bit_and_an_end_in_good_order_is_sent() {
        let (peer, mut channel) = channel();
        let peer = Channel::new(peer).unwrap();
        for gravity in [9.81, 0.1 + 0.2, 1.0 / 3.0, f32::MIN_POSITIVE, 3.711_000_2] {
            let params = SessionParams::at(1000).with_gravity(gravity).with_any_time_mode();
            let session = Some(Session { prefix: "p".to_owned(), folder: "/f".into() });
            let hello = Line::Hello(Hello { session, ..Hello::of(params) });
            peer.send(&hello);
            assert_eq!(channel.next().unwrap(), Some(hello));
        }
        drop(peer);
        assert_eq!(channel.next().unwrap(), Some(Line::Left));
    }

    #[test]
    fn a_misspelt_parameter_is_found() {
        let (mut peer, mut channel) = channel();
        let hello = r#"{"hello":{"pid":7,"params":{"wire_version":2,"rate_hz":500,"gravity_m_s2":0.3,"time_modes":"real-time"},"novelty":[]}}"#;
        peer.write_all(format!("{hello}\n").as_bytes()).unwrap();
        let Ok(Some(Line::Hello(hello))) = channel.next() else { panic!("a hello") };
        assert_eq!(hello.unknown, ["time_modes"]);
    }

    #[test]
    fn rejects_another_language_and_a_line_without_an_end() {
        let (mut peer, mut channel) = channel();
        peer.write_all(b"GET / HTTP/1.1\n").unwrap();
        assert_eq!(channel.next().unwrap_err().kind(), ErrorKind::InvalidData);
        peer.write_all(&[b'x'; MAX_LINE as usize]).unwrap();
        assert_eq!(channel.next().unwrap_err().kind(), ErrorKind::InvalidData);
    }
}
