//! Captures whose photographs are read when they are needed.

use super::frames::{FrameFiles, FrameSettings, FrameSource};
use super::test_capture::{Small, sample};
use super::*;
use crate::image::ColorSpace;
use std::fs;

#[test]
fn an_open_capture_has_the_pixels_that_the_masks_show() {
    let bits = |image: &crate::image::RgbImage, k: usize| image.data[k].map(f32::to_bits);
    let mut missing = Small::new(true);
    missing.picture("0.exr", |x, y| if (x, y) == (3, 4) { (f32::NAN, 1.0, 1.0) } else { (x as f32, y as f32, 0.0) });
    missing.mask("mask.png", 16, 12, true);
    missing.frames[1] += ", \"mask_path\": \"mask.png\"";
    missing.read(&CaptureReadOptions::default()).unwrap();
    for folder in [sample(), missing.folder.path().to_owned()] {
        let options = CaptureReadOptions { unchecked: true, ..CaptureReadOptions::default() };
        let (whole, opened) = (read(&folder, &options).unwrap(), open(&folder, &options).unwrap());
        assert_eq!(opened.views().len(), whole.frames.len());
        assert_eq!((opened.missing_pixels, &opened.warnings), (whole.missing_pixels, &whole.warnings));
        assert_eq!(opened.agreement().unwrap(), agreement(&whole));
        for (k, wanted) in whole.frames.iter().enumerate() {
            let found = opened.frame(k).unwrap();
            assert!(found.view == wanted.view && found.mask == wanted.mask && found.cross.is_some());
            let pairs =
                [(Some(&found.photograph), Some(&wanted.photograph)), (found.cross.as_ref(), wanted.cross.as_ref())];
            for (found, wanted) in pairs.map(|(a, b)| (a.unwrap(), b.unwrap())) {
                let shown = |k: &usize| whole.frames[0].mask.is_none() || found.data[*k] != [0.0; 3];
                let compared =
                    (0..wanted.data.len()).filter(shown).map(|k| assert_eq!(bits(found, k), bits(wanted, k)));
                assert!(compared.count() > 50);
            }
        }
    }
}

#[test]
fn a_photograph_that_changes_meanwhile_is_refused() {
    let small = Small::new(false);
    small.read(&CaptureReadOptions::default()).unwrap();
    let access = CaptureReadOptions::default().access();
    let described = describe(small.folder.path(), &access).unwrap().frames;
    let settings = FrameSettings { space: ColorSpace::from_files(), invert_masks: false, board: None };
    // Nothing is stored: the disk was full.
    let files = FrameFiles::new(described, access, settings);
    assert_eq!(files.frame(1).unwrap().photograph.data[17], [1.0, 1.0, 1.0]);
    let mut longer = fs::read(small.path("1.exr")).unwrap();
    longer.push(0);
    fs::write(small.path("1.exr"), longer).unwrap();
    let error = files.frame(1).unwrap_err().to_string();
    assert!(error.contains("1.exr") && error.contains("was changed while the capture was being encoded"), "{error}");
    assert!(files.frame(2).is_ok());
}
