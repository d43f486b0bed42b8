//! A chunk of an MCAP file: decompressed, verified, and read record by record.

use std::io::Read;

use leg_control::checksum::crc32;
use mcap::records::Record;
use mcap::{McapError, McapResult};

/// Bytes of a record before its content: opcode and length.
const RECORD_HEADER_LEN: usize = 9;

/// The decompressed records of a chunk, and how far they are read.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    records: Vec<u8>,
    next: usize,
}

impl Chunk {
    /// Decompresses a chunk of at most `limit` bytes and verifies its checksum.
    pub(super) fn open(record: &[u8], limit: usize) -> McapResult<Self> {
        let Record::Chunk { header, data } = mcap::parse_record(mcap::records::op::CHUNK, record)?
        else {
            return Err(McapError::UnexpectedEoc);
        };
        let size = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX);
        if size > limit {
            return Err(McapError::ChunkTooLarge(header.uncompressed_size));
        }
        // One byte more than promised, to notice that there is more.
        let most = header.uncompressed_size + 1;
        let mut records = Vec::with_capacity(size);
        match header.compression.as_str() {
            "" => records.extend_from_slice(&data),
            "lz4" => {
                let frames = lz4_flex::frame::FrameDecoder::new(&*data);
                frames.take(most).read_to_end(&mut records)?;
            }
            "zstd" => {
                let frame = ruzstd::decoding::StreamingDecoder::new(&*data)
                    .map_err(|error| McapError::DecompressionError(error.to_string()))?;
                frame.take(most).read_to_end(&mut records)?;
            }
            _ => return Err(McapError::UnsupportedCompression(header.compression)),
        }
        if records.len() != size {
            return Err(McapError::DecompressionError(format!(
                "{} bytes in a chunk of {size}",
                records.len()
            )));
        }
        // 0 stands for no checksum.
        let (saved, calculated) = (header.uncompressed_crc, crc32(&records));
        if saved != 0 && saved != calculated {
            return Err(McapError::BadChunkCrc { saved, calculated });
        }
        Ok(Self { records, next: 0 })
    }

    /// Returns whether every record has been read.
    pub(super) fn is_read(&self) -> bool {
        self.next >= self.records.len()
    }

    /// Returns the next record.
    pub(super) fn next_record(&mut self) -> McapResult<Record<'_>> {
        let rest = &self.records[self.next..];
        let (header, content) =
            rest.split_first_chunk::<RECORD_HEADER_LEN>().ok_or(McapError::UnexpectedEoc)?;
        let [opcode, len @ ..] = *header;
        let len = usize::try_from(u64::from_le_bytes(len)).unwrap_or(usize::MAX);
        let content = content.get(..len).ok_or(McapError::UnexpectedEoc)?;
        self.next += RECORD_HEADER_LEN + len;
        mcap::parse_record(opcode, content)
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    /// Returns the content of a chunk record.
    fn chunk(compression: &str, size: u64, crc: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; 16]; // Start and end time.
        bytes.extend(size.to_le_bytes());
        bytes.extend(crc.to_le_bytes());
        bytes.extend((compression.len() as u32).to_le_bytes());
        bytes.extend(compression.as_bytes());
        bytes.extend((data.len() as u64).to_le_bytes());
        bytes.extend(data);
        bytes
    }

    fn record(content: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0x80];
        bytes.extend((content.len() as u64).to_le_bytes());
        bytes.extend(content);
        bytes
    }

    #[test]
    fn refuses_a_chunk_of_another_size_or_checksum_or_compression() {
        let records = record(b"private");
        let (len, crc) = (records.len() as u64, crc32(&records));
        let open =
            |compression, size, crc| Chunk::open(&chunk(compression, size, crc, &records), 1 << 20);
        for crc in [crc, 0] {
            let mut chunk = open("", len, crc).unwrap();
            let record = chunk.next_record().unwrap();
            assert!(matches!(record, Record::Unknown { opcode: 0x80, .. }), "{record:?}");
            assert!(chunk.is_read());
        }
        assert!(matches!(open("", len, crc ^ 1), Err(McapError::BadChunkCrc { .. })));
        assert!(matches!(open("", len - 1, 0), Err(McapError::DecompressionError(_))));
        assert!(matches!(open("", 1 << 40, 0), Err(McapError::ChunkTooLarge(_))));
        assert!(matches!(open("zstd", len, 0), Err(McapError::DecompressionError(_))));
        assert!(matches!(open("lz4", len, 0), Err(McapError::Io(_))));
        let unknown = open("brotli", len, 0);
        assert!(
            matches!(unknown, Err(McapError::UnsupportedCompression(name)) if name == "brotli")
        );
    }

    #[test]
    fn a_record_that_is_cut_off_is_an_error_and_no_panic() {
        for cut in 1..record(b"private").len() {
            let records = &record(b"private")[..cut];
            let mut chunk = Chunk { records: records.to_vec(), next: 0 };
            assert!(chunk.next_record().is_err(), "cut at {cut}");
        }
        let mut endless = vec![0x80];
        endless.extend(u64::MAX.to_le_bytes());
        assert!(Chunk { records: endless, next: 0 }.next_record().is_err());
    }
}
