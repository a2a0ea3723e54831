//! Any bytes as a MERL table, alone and before a whole table's worth of a repeated value.
#![no_main]
use libfuzzer_sys::fuzz_target;
use std::io::Read;
use tsuya::brdf::Brdf;
use tsuya::brdf::merl::MerlTable;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(table) = MerlTable::read_from(bytes, "fuzz.binary") {
        let value = table.evaluate([0.6, 0.0, 0.8], [0.0, 0.6, 0.8]);
        assert!(value.iter().all(|x| x.is_finite() && *x >= 0.0));
    }
    // Whole files are slow: one input in 64.
    if bytes.len() >= 20 && bytes[0] == 90 && bytes.last().is_some_and(|last| last % 64 == 0) {
        let value = [bytes[12], bytes[13], bytes[14], bytes[15], bytes[16], bytes[17], bytes[18], bytes[19]];
        let rest = std::io::repeat(0).take(34_992_012u64.saturating_sub(bytes.len() as u64));
        if let Ok(table) = MerlTable::read_from(bytes.chain(rest), "fuzz.binary") {
            assert!(table.valid_count() > 0, "{value:?}");
        }
    }
});
