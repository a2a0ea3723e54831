//! A finished file read back, by the path that its readers take.

use crate::container::Container;
use crate::decoder::{DecodeOptions, decode_each};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::rate::CodedView;

/// Decodes a file and compares every photograph, bit for bit, with what the encoder made the file's statements from. Returns the
/// memory within which it was done: what a reader grants by default, or the first double of it that suffices, with a warning.
/// # Errors
/// [`Error::Check`] where the file does not decode or gives back something else.
pub(super) fn check(bytes: &[u8], expected: &[CodedView], warnings: &mut Vec<String>) -> Result<u64> {
    let by_default = Limits::default();
    let mut limits = by_default;
    loop {
        match decode_within(bytes, expected, limits) {
            Err(Error::Limits { .. }) if limits.memory_bytes < u64::MAX / 2 => limits.memory_bytes *= 2,
            result => {
                result.map_err(failed)?;
                break;
            }
        }
    }
    if limits.memory_bytes > by_default.memory_bytes {
        let [granted, needed] = [by_default, limits].map(|limits| limits.memory_bytes >> 20);
        warnings.push(format!(
            "a reader needs more than the {granted} MiB that it grants by default: {needed} MiB suffice"
        ));
    }
    Ok(limits.memory_bytes)
}

fn failed(error: Error) -> Error {
    match error {
        Error::Check(message) => Error::Check(message),
        other => Error::Check(format!("the encoded file can't be decoded: {other}; this is a defect of the program")),
    }
}

fn decode_within(bytes: &[u8], expected: &[CodedView], limits: Limits) -> Result<()> {
    let mut file = Container::open_slice(bytes, limits)?;
    let mut missing = vec![true; expected.len()];
    decode_each(&mut file, &DecodeOptions { limits, ..Default::default() }, |asset, decoded| {
        for (view, decoded) in decoded {
            if expected.get(view).is_none_or(|expected| expected.digest != decoded.digest()) {
                let name = asset.views.get(view).map_or("", |view| &view.name);
                let message = "is decoded to other values than it was encoded to; this is a defect of the program";
                return Err(Error::Check(format!("view {name} {message}")));
            }
            missing[view] = false;
        }
        Ok(())
    })?;
    match missing.iter().position(|&missing| missing) {
        Some(view) => {
            Err(Error::Check(format!("view {view} is not in the encoded file; this is a defect of the program")))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Distortion;
    use crate::options::EncodeOptions;
    use crate::views::Photograph;

    #[test]
    fn another_file_or_another_photograph_is_found() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/unpolarised");
        let capture = crate::capture::read(folder, &Default::default()).unwrap();
        let encoded = super::super::encode(capture, &EncodeOptions::default()).unwrap();
        let mut file = Container::open_slice(&encoded.bytes, Limits::default()).unwrap();
        let mut photographs = vec![Photograph::default(); 10];
        let keep = |_: &_, decoded: Vec<(usize, Photograph)>| {
            decoded.into_iter().for_each(|(view, photograph)| photographs[view] = photograph);
            Ok(())
        };
        decode_each(&mut file, &DecodeOptions::default(), keep).unwrap();
        let stated = |photographs: &[Photograph]| -> Vec<CodedView> {
            let kept = |photograph: &Photograph| (Distortion::default(), photograph.digest());
            let view = |(distortion, digest)| CodedView { distortion, digest, thumbnail: None };
            photographs.iter().map(kept).map(view).collect()
        };
        let mut warnings = Vec::new();
        assert_eq!(check(&encoded.bytes, &stated(&photographs), &mut warnings).ok(), encoded.reader_memory);
        let tight = Limits { memory_bytes: 1 << 16, ..Limits::default() };
        assert!(matches!(decode_within(&encoded.bytes, &stated(&photographs), tight), Err(Error::Limits { .. })));
        let pixel = photographs[3].mask.data.iter().position(|&inside| inside).unwrap();
        let value = &mut photographs[3].images[0].data[pixel][1];
        *value = f32::from_bits(value.to_bits() + 1);
        let error = check(&encoded.bytes, &stated(&photographs), &mut warnings).unwrap_err().to_string();
        assert!(error.contains("03.png") && error.contains("defect"), "{error}");
        let cut = &encoded.bytes[..encoded.bytes.len() - 100];
        assert!(matches!(check(cut, &stated(&photographs), &mut warnings), Err(Error::Check(_))));
        assert!(warnings.is_empty());
    }
}
