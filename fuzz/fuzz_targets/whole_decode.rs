//! Any bytes as a file, decoded with tight limits: as they are, and with right checksums.
#![no_main]
mod repair;
use libfuzzer_sys::fuzz_target;
use tsuya::Limits;
use tsuya::decoder::{DecodeOptions, Selection, decode};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { memory_bytes: 1 << 25, frames: 16, picture_side: 256, mesh_elements: 1 << 11 };
    let _ = decode(bytes, &DecodeOptions { limits, selection: Selection::All });
    let Some(bytes) = repair::repair(bytes) else { return };
    if let Ok(asset) = decode(&bytes, &DecodeOptions { limits, selection: Selection::All }) {
        let one = decode(&bytes, &DecodeOptions { limits, selection: Selection::Views(vec![0]) });
        let same = |a: &tsuya::asset::Photograph, b: &tsuya::asset::Photograph| {
            let bits = |p: &tsuya::asset::Photograph| -> Vec<u32> {
                p.images.iter().flat_map(|i| i.data.iter().flatten().map(|x| x.to_bits())).collect()
            };
            a.mask == b.mask && bits(a) == bits(b)
        };
        if let (Some(Some(all)), Ok(one)) = (asset.photographs.first(), one) {
            assert!(one.photographs[0].as_ref().is_some_and(|one| same(all, one)));
        }
    }
});
