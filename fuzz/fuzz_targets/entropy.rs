//! Any bits under any probabilities come back, and any bytes are some bits.

use tsuya::internals::entropy::{BitCoder, NumberModel, RangeDecoder, RangeEncoder, code_end};

pub fn fuzz(bytes: &[u8]) {
    let pairs = || bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let mut encoder = RangeEncoder::new();
    for value in pairs() {
        encoder.bit((value as u32 | 1).min(65535), value & 1 == 1);
    }
    let mut number = NumberModel::default();
    for value in pairs() {
        number.code(&mut encoder, value as u32);
    }
    code_end(&mut encoder);
    let stream = encoder.finish();
    let mut decoder = RangeDecoder::new(&stream);
    for value in pairs() {
        assert_eq!(decoder.bit((value as u32 | 1).min(65535), false), value & 1 == 1);
    }
    let mut number = NumberModel::default();
    for value in pairs() {
        assert_eq!(number.code(&mut decoder, 0), value as u32);
    }
    assert!(code_end(&mut decoder) && decoder.ends_as_written(0));

    let mut decoder = RangeDecoder::new(bytes);
    let mut number = NumberModel::default();
    for _ in 0..bytes.len() {
        number.code_signed(&mut decoder, 0);
    }
}
