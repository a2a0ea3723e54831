//! Any bytes as rows of directions.
#![no_main]
use libfuzzer_sys::fuzz_target;
use std::path::Path;
use tsuya::brdf::parse_directions;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(pairs) = parse_directions(text, Path::new("-")) {
        for direction in pairs.iter().flat_map(|&(incoming, outgoing)| [incoming, outgoing]) {
            let square: f64 = direction.iter().map(|x| x * x).sum();
            assert!((square - 1.0).abs() < 1e-9, "{direction:?}");
        }
    }
});
