//! The MCAP file of a recording: chunks compressed by zstd, each in order of time.

use std::io::{self, Write};
use std::ops::Range;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::schema::PROFILE;

/// The encoding of the messages of a recording, and of their schemas.
pub(super) const PROTOBUF: &str = "protobuf";
/// Bytes of messages in a chunk, after which it is written; a file that is cut off loses at most
/// its last chunk.
const CHUNK_LEN: usize = 1 << 18;

/// Writes a recording. The messages of a chunk are collected, sorted by their log time and
/// written together: a message may come later than others of its time, as an apex does, which
/// is known only when the controller has answered it.
pub(super) struct RecordingFile<W: Write> {
    writer: Writer<NoSeek<W>>,
    /// The messages of the next chunk, one after the other.
    bytes: Vec<u8>,
    /// Where each of them is.
    pending: Vec<(MessageHeader, Range<usize>)>,
    written: u64,
}

impl<W: Write> RecordingFile<W> {
    /// Writes the header of a recording.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn begin(to: W) -> io::Result<Self> {
        let writer = WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("sim-host ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            // The chunks are small, and the run needs the other processors.
            .compression_threads(0)
            // Chunks end by `flush`.
            .chunk_size(None)
            .disable_seeking(true)
            .create(NoSeek::new(to))
            .map_err(system_error)?;
        Ok(Self { writer, bytes: Vec::new(), pending: Vec::new(), written: 0 })
    }

    /// Adds a schema; returns its number.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn add_schema(
        &mut self,
        name: &str,
        encoding: &str,
        data: &[u8],
    ) -> io::Result<u16> {
        self.writer.add_schema(name, encoding, data).map_err(system_error)
    }

    /// Adds a channel with the number of its schema, 0 for none; returns its number.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn add_channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
    ) -> io::Result<u16> {
        self.writer.add_channel(schema, topic, encoding, &[].into()).map_err(system_error)
    }

    /// Adds a message of a channel that was added.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn add(&mut self, header: MessageHeader, message: &[u8]) -> io::Result<()> {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(message);
        self.pending.push((header, start..self.bytes.len()));
        if self.bytes.len() >= CHUNK_LEN { self.flush() } else { Ok(()) }
    }

    /// Ends the chunk and writes it.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        // Stable: messages of the same time keep their order.
        self.pending.sort_by_key(|(header, _)| header.log_time);
        for (header, place) in self.pending.drain(..) {
            self.writer
                .write_to_known_channel(&header, &self.bytes[place])
                .map_err(system_error)?;
            self.written += 1;
        }
        self.bytes.clear();
        self.writer.flush().map_err(system_error)
    }

    /// Writes the rest and the index. Returns the number of messages and what it wrote to.
    ///
    /// # Errors
    /// The error of the system.
    pub(super) fn finish(mut self) -> io::Result<(u64, W)> {
        self.flush()?;
        self.writer.finish().map_err(system_error)?;
        Ok((self.written, self.writer.into_inner().into_inner()))
    }
}

/// Returns the error of the system that the writer of the format has met.
fn system_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        error => io::Error::other(error),
    }
}

#[cfg(test)]
mod tests {
    use mcap::records::Record;
    use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

    use super::*;

    /// Returns the compression of each chunk, and the log times of the messages in their order.
    fn compressions_and_times(bytes: &[u8]) -> (Vec<String>, Vec<u64>) {
        let options = LinearReaderOptions::default().with_emit_chunks(true);
        let mut reader = LinearReader::new_with_options(options);
        let (mut rest, mut compressions) = (bytes, Vec::new());
        while let Some(event) = reader.next_event() {
            match event.unwrap() {
                LinearReadEvent::ReadRequest(least) => {
                    let len = least.min(rest.len());
                    reader.insert(len).copy_from_slice(&rest[..len]);
                    reader.notify_read(len);
                    rest = &rest[len..];
                }
                LinearReadEvent::Record { opcode, data } => {
                    let record = mcap::parse_record(opcode, data).unwrap();
                    if let Record::Chunk { header, .. } = record {
                        compressions.push(header.compression);
                    }
                }
            }
        }
        let messages = mcap::MessageStream::new(bytes).unwrap();
        (compressions, messages.map(|message| message.unwrap().log_time).collect())
    }

    #[test]
    fn each_chunk_is_compressed_and_in_order_of_time() {
        let mut file = RecordingFile::begin(Vec::new()).unwrap();
        let schema = file.add_schema("leg.A", PROTOBUF, b"schema").unwrap();
        let channel_id = file.add_channel(schema, "/a", PROTOBUF).unwrap();
        for times in [[3, 1, 2], [9, 7, 8]] {
            for log_time in times {
                let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: 0 };
                file.add(header, &[log_time as u8; 100]).unwrap();
            }
            file.flush().unwrap();
        }
        let (messages, bytes) = file.finish().unwrap();
        let (compressions, times) = compressions_and_times(&bytes);
        assert_eq!((messages, times), (6, vec![1, 2, 3, 7, 8, 9]));
        assert_eq!(compressions, ["zstd", "zstd"]);
    }
}
