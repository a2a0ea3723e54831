//! Any bytes as a MERL table.

use tsuya::brdf::{Brdf, MerlTable};

pub fn fuzz(bytes: &[u8]) {
    // The bytes, and the same before as many zeros as make a whole table (one input in 16: a table has 35 MB).
    let rest = 34_992_012u64.saturating_sub(bytes.len() as u64);
    let whole = bytes.starts_with(&[90, 0, 0, 0, 90]) && bytes.last().is_some_and(|last| last % 16 == 0);
    let zeros = std::io::Read::take(std::io::repeat(0), if whole { rest } else { 0 });
    if let Ok(table) = MerlTable::read_from(std::io::Read::chain(bytes, zeros), "fuzz.binary") {
        let value = table.evaluate([0.6, 0.0, 0.8], [0.0, 0.6, 0.8]);
        assert!(table.valid_count() > 0 && value.iter().all(|x| x.is_finite() && *x >= 0.0));
    }
}
