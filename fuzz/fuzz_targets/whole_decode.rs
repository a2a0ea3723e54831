//! Any bytes as a file, decoded with tight limits in every way: as they are, and with right checksums.

use tsuya::Limits;
use tsuya::decoder::{DecodeOptions, decode};
use tsuya_fuzz::compare::decode_in_every_way;
use tsuya_fuzz::repair::repair;

pub fn fuzz(bytes: &[u8]) {
    let limits = Limits { memory_bytes: 1 << 25, views: 24, image_side: 256, mesh_elements: 1 << 11 };
    let _ = decode(bytes, &DecodeOptions { limits, ..Default::default() });
    if let Some(bytes) = repair(bytes) {
        let _ = decode_in_every_way(&bytes, limits);
    }
}
