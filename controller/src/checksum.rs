//! CRC-32 ISO HDLC: the checksum at the end of a blob, of a frame, of a seal.

static CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Returns the CRC-32 of `bytes` (polynomial 04c11db7 reflected, initial value and
/// final xor ffffffff; `123456789` gives cbf43926). Once in an image, however many
/// call it.
#[must_use]
#[inline(never)]
pub fn crc32(bytes: &[u8]) -> u32 {
    // By fours: arrays are unrolled everywhere.
    let (fours, rest) = bytes.as_chunks::<4>();
    let mut digest = CRC.digest();
    for four in fours {
        digest.update(four);
    }
    digest.update(rest);
    digest.finalize()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_check_value_of_the_catalogue() {
        assert_eq!(super::crc32(b"123456789"), 0xcbf4_3926);
    }
}
