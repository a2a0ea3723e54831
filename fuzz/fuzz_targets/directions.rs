//! Any bytes as rows of directions, and as measured values.

use std::path::Path;
use tsuya::brdf::{MeasuredSamples, parse_directions};
use tsuya::input::FileAccess;

fn check_unit(direction: [f64; 3]) {
    let square: f64 = direction.iter().map(|x| x * x).sum();
    assert!((square - 1.0).abs() < 1e-9, "{direction:?}");
}

pub fn fuzz(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(pairs) = parse_directions(text, Path::new("-")) {
        pairs.iter().flat_map(|&(incoming, outgoing)| [incoming, outgoing]).for_each(check_unit);
    }
    if let Ok(found) = MeasuredSamples::from_text(text, Path::new("-"), &FileAccess::default()) {
        assert!(!found.samples.is_empty() && found.samples.len() <= found.measured);
        assert!(found.relative_noise >= 0.0);
        for sample in &found.samples {
            [sample.incoming, sample.outgoing].into_iter().for_each(check_unit);
            assert!(sample.incoming[2] > 0.0 && sample.outgoing[2] > 0.0);
            assert!(sample.value.iter().chain(&sample.deviation).all(|x| x.is_finite() && *x >= 0.0), "{sample:?}");
        }
    }
}
