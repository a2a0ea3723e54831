//! Decompression of one zstd frame (RFC 8878): by the C library, and where there is none, in WebAssembly, by ruzstd.

#[cfg(target_arch = "wasm32")]
pub(super) use by_ruzstd::decompress;
#[cfg(not(target_arch = "wasm32"))]
pub(super) use by_zstd::decompress;

/// Largest window that every decoder should support (RFC 8878, 3.1.1.1.2).
#[cfg(any(test, target_arch = "wasm32"))]
const MAX_WINDOW_BYTES: u64 = 8 << 20;

/// Why a frame can't be decompressed.
#[derive(Debug, PartialEq)]
pub(super) enum ZstdRefusal {
    /// Not one whole frame, or bytes after it.
    NotOneFrame,
    /// Another length than expected.
    Length,
    /// Message of the decompressor.
    Damaged(String),
    /// No memory for the expected length.
    Memory,
}

/// Room for exactly `length` bytes.
fn reserved(length: usize) -> Result<Vec<u8>, ZstdRefusal> {
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length).map_err(|_| ZstdRefusal::Memory)?;
    Ok(bytes)
}

#[cfg(not(target_arch = "wasm32"))]
mod by_zstd {
    use super::{ZstdRefusal, reserved};

    /// The content of exactly one frame that decompresses to exactly `length` bytes.
    pub(crate) fn decompress(stored: &[u8], length: usize) -> Result<Vec<u8>, ZstdRefusal> {
        match zstd::zstd_safe::find_frame_compressed_size(stored) {
            Ok(size) if size == stored.len() => {}
            _ => return Err(ZstdRefusal::NotOneFrame),
        }
        let mut decoded = reserved(length)?;
        let damaged = |error: std::io::Error| ZstdRefusal::Damaged(error.to_string());
        let mut decompressor = zstd::bulk::Decompressor::new().map_err(damaged)?;
        match decompressor.decompress_to_buffer(stored, &mut decoded).map_err(damaged)? {
            produced if produced == length => Ok(decoded),
            _ => Err(ZstdRefusal::Length),
        }
    }
}

#[cfg(any(test, target_arch = "wasm32"))]
mod by_ruzstd {
    use super::{MAX_WINDOW_BYTES, ZstdRefusal, reserved};
    use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder, errors::FrameDecoderError};
    use std::io::Read;

    /// The content of exactly one frame that decompresses to exactly `length` bytes.
    pub(crate) fn decompress(stored: &[u8], length: usize) -> Result<Vec<u8>, ZstdRefusal> {
        let damaged = |error: FrameDecoderError| ZstdRefusal::Damaged(error.to_string());
        let mut rest = stored;
        let mut decoder = FrameDecoder::new();
        // What the decoder keeps is bounded by the window, whatever the frame's blocks repeat.
        decoder.set_max_window_size(MAX_WINDOW_BYTES.max(length as u64));
        decoder.init(&mut rest).map_err(damaged)?;
        let mut decoded = reserved(length)?;
        while !decoder.is_finished() {
            decoder.decode_blocks(&mut rest, BlockDecodingStrategy::UptoBlocks(1)).map_err(damaged)?;
            let left = (length - decoded.len()) as u64;
            if decoder.can_collect() as u64 > left {
                return Err(ZstdRefusal::Length);
            }
            let drained = decoder.by_ref().take(left).read_to_end(&mut decoded);
            drained.map_err(|error| ZstdRefusal::Damaged(error.to_string()))?;
        }
        if !rest.is_empty() {
            return Err(ZstdRefusal::NotOneFrame);
        }
        if decoded.len() != length || decoder.can_collect() > 0 {
            return Err(ZstdRefusal::Length);
        }
        Ok(decoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both decompressors give the same bytes, and refuse the same frames.
    #[test]
    fn the_two_decompressors_agree() {
        let text: Vec<u8> =
            (0..60_000u32).flat_map(|i| format!("{} ", i.wrapping_mul(i) % 1013).into_bytes()).collect();
        for (content, level) in [(&text[..], 3), (&text[..], 19), (&text[..1], 3), (&[0u8; 300_000], 1)] {
            let frame = zstd::bulk::compress(content, level).unwrap();
            assert_eq!(by_zstd::decompress(&frame, content.len()).unwrap(), content);
            assert_eq!(by_ruzstd::decompress(&frame, content.len()).unwrap(), content);
            for wrong in [content.len() - 1, content.len() + 1] {
                assert!(by_zstd::decompress(&frame, wrong).is_err());
                assert_eq!(by_ruzstd::decompress(&frame, wrong), Err(ZstdRefusal::Length));
            }
            let extended = [&frame[..], b"x"].concat();
            assert_eq!(by_zstd::decompress(&extended, content.len()), Err(ZstdRefusal::NotOneFrame));
            assert_eq!(by_ruzstd::decompress(&extended, content.len()), Err(ZstdRefusal::NotOneFrame));
            for cut in (0..frame.len()).step_by(1 + frame.len() / 200) {
                assert!(by_zstd::decompress(&frame[..cut], content.len()).is_err());
                assert!(by_ruzstd::decompress(&frame[..cut], content.len()).is_err(), "{cut} of {}", frame.len());
            }
        }
        // A flipped byte gives an error or other bytes of the same length, never a panic.
        let frame = zstd::bulk::compress(&text, 3).unwrap();
        for at in (0..frame.len()).step_by(1 + frame.len() / 500) {
            let mut damaged = frame.clone();
            damaged[at] ^= 0x55;
            if let Ok(decoded) = by_ruzstd::decompress(&damaged, text.len()) {
                assert_eq!(decoded.len(), text.len());
            }
        }
    }
}
