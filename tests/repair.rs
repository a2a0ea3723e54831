//! What is saved of damaged files.

use crate::support;
use crate::support::{complaint, read, text, tsuya, variant};
use std::sync::OnceLock;
use tsuya::Asset;
use tsuya::Photograph;
use tsuya::container::{Container, Section, Tag, verify};
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::encoder::encode;
use tsuya::{DecodeSpeed, EncodeOptions, Profile};
use tsuya::{Error, Limits};
use tsuya::{RepairedFile, repair};

struct Whole {
    name: &'static str,
    bytes: Vec<u8>,
    asset: Asset,
    sections: Vec<Section>,
}

impl Whole {
    fn section(&self, tag: Tag) -> Option<&Section> {
        self.sections.iter().find(|section| section.tag == tag)
    }
    /// First byte of what a section stores.
    fn content(&self, tag: Tag) -> usize {
        let section = self.section(tag).unwrap();
        (section.offset + section.header_bytes()) as usize
    }
    /// The file with a part replaced.
    fn spliced(&self, range: std::ops::Range<usize>, with: &[u8]) -> Vec<u8> {
        [&self.bytes[..range.start], with, &self.bytes[range.end..]].concat()
    }
    fn flipped(&self, at: usize) -> Vec<u8> {
        self.spliced(at..at + 1, &[self.bytes[at] ^ 0x24])
    }
}

/// Both profiles, all decoding modes, and masks that are what the mesh covers.
fn whole_files() -> &'static [Whole] {
    static FILES: OnceLock<Vec<Whole>> = OnceLock::new();
    FILES.get_or_init(|| {
        let capture = variant(7, |_, _| {});
        let unmasked = variant(5, |description, _| {
            for frame in description["frames"].as_array_mut().unwrap() {
                frame.as_object_mut().unwrap().remove("mask_path");
            }
        });
        let file = |name, capture: &tempfile::TempDir, options: EncodeOptions| {
            let bytes = encode(read(capture.path()).unwrap(), &options).unwrap().bytes;
            let asset = decode(&bytes, &DecodeOptions::default()).unwrap();
            let sections = Container::open_slice(&bytes, Limits::default()).unwrap().sections().to_vec();
            Whole { name, bytes, asset, sections }
        };
        let with = |decoding| EncodeOptions { decode_speed: decoding, ..Default::default() };
        vec![
            file("small", &capture, with(DecodeSpeed::Normal)),
            file("fast", &capture, with(DecodeSpeed::Fast)),
            file("fastest", &capture, with(DecodeSpeed::Fastest)),
            file("coverage", &unmasked, with(DecodeSpeed::Normal)),
            file("paper", &capture, EncodeOptions { profile: Profile::WaveletTexture, ..Default::default() }),
        ]
    })
}

fn is_same(one: &Photograph, other: &Photograph) -> bool {
    let bits = |photograph: &Photograph| -> Vec<u32> {
        photograph.images.iter().flat_map(|image| image.data.as_flattened().iter().map(|x| x.to_bits())).collect()
    };
    one.mask == other.mask && bits(one) == bits(other)
}

/// Repairs, checks that the new file is whole and that the views it keeps are as they were; `None` where nothing is saved.
fn mended(whole: &Whole, damaged: &[u8], what: &str) -> Option<RepairedFile> {
    let what = format!("{}: {what}", whole.name);
    let repaired = match repair(damaged, Limits::default()) {
        Ok(repaired) => repaired,
        Err(Error::Format { message, .. }) if message.starts_with("nothing can be saved") => return None,
        Err(error) => panic!("{what}: {error}"),
    };
    verify(&repaired.bytes[..], Limits::default()).unwrap_or_else(|error| panic!("{what}: {error}"));
    let asset = decode(&repaired.bytes, &DecodeOptions::default()).unwrap_or_else(|error| panic!("{what}: {error}"));
    assert_eq!(asset.views.len(), repaired.views, "{what}");
    for (index, photograph) in asset.photographs.iter().enumerate() {
        let lost = repaired.lost_views.iter().any(|(view, ..)| *view == index);
        assert_eq!(photograph.is_none(), lost, "{what}: view {index}");
        if let (Some(kept), Some(before)) = (photograph, &whole.asset.photographs[index]) {
            assert!(is_same(kept, before), "{what}: view {index} is another");
        }
    }
    if !repaired.lost_views.is_empty() {
        assert!(!asset.metadata.contains_key("achieved_error") && asset.metadata.contains_key("repaired"), "{what}");
    }
    Some(repaired)
}

fn lost(repaired: &RepairedFile) -> Vec<Tag> {
    repaired.lost_sections.iter().map(|(tag, _)| *tag).collect()
}

#[test]
fn of_cut_files_all_before_the_cut_is_saved() {
    for whole in whole_files() {
        for (index, section) in whole.sections.iter().enumerate() {
            let (start, end) = (section.offset as usize, section.end().unwrap() as usize);
            for at in
                [start, start + 3, start + section.header_bytes() as usize, start + (end - start) * 3 / 5, end - 1]
            {
                let what = format!("cut at {at} in {}", section.tag);
                let before: Vec<Tag> = whole.sections[..index].iter().map(|section| section.tag).collect();
                let Some(repaired) = mended(whole, &whole.bytes[..at], &what) else {
                    assert!(!before.contains(&Tag::MESH), "{what}");
                    continue;
                };
                assert!(repaired.has_losses() && before.iter().all(|tag| repaired.kept.contains(tag)), "{what}");
            }
        }
        // Nothing but the directory is lost.
        let end = whole.sections.last().unwrap().end().unwrap() as usize;
        for at in [end + 4, end + 20, whole.bytes.len() - 1] {
            let repaired = mended(whole, &whole.bytes[..at], "no directory").unwrap();
            assert!(!repaired.has_losses() && repaired.bytes == whole.bytes, "{} cut at {at}", whole.name);
        }
        assert!(mended(whole, &whole.bytes[..60], "hardly begun").is_none());
        assert!(repair(&whole.bytes, Limits::default()).unwrap().was_whole);
    }
}

#[test]
fn a_changed_byte_costs_its_section_or_its_views_alone() {
    for whole in whole_files() {
        for section in &whole.sections {
            let content = whole.content(section.tag);
            for at in [section.offset as usize, section.offset as usize + 6, content + section.stored as usize / 2] {
                let what = format!("byte {at} of {} changed", section.tag);
                let repaired = mended(whole, &whole.flipped(at), &what).unwrap();
                if at < content {
                    // The directory says what the header should.
                    assert!(!repaired.has_losses() && repaired.bytes == whole.bytes, "{what}");
                    continue;
                }
                let kept = repaired.views - repaired.lost_views.len();
                match section.tag {
                    Tag::PLANES => {
                        assert!(repaired.lost_sections.is_empty() && kept > 0 && kept < repaired.views, "{what}")
                    }
                    Tag::WAVELET_TEXTURE => assert!(lost(&repaired) == [Tag::WAVELET_TEXTURE] && kept == 0, "{what}"),
                    Tag::CHARTS => {
                        assert!(lost(&repaired) == [Tag::CHARTS, Tag::REFLECTANCE] && kept == repaired.views)
                    }
                    Tag::MESH => assert!(kept == 0 && repaired.kept.contains(&Tag::VIEWS), "{what}"),
                    Tag::VIEWS => assert!(repaired.views == 0 && repaired.kept.contains(&Tag::MESH), "{what}"),
                    tag => assert!(lost(&repaired) == [tag] && kept == repaired.views, "{what}: {:?}", lost(&repaired)),
                }
            }
        }
        // What stands around the sections costs nothing.
        for at in [0, 3, 9, whole.bytes.len() - 30, whole.bytes.len() - 6, whole.bytes.len() - 1] {
            let repaired = mended(whole, &whole.flipped(at), "outside").unwrap();
            assert!(!repaired.has_losses() && repaired.bytes == whole.bytes, "{}: byte {at}", whole.name);
        }
    }
}

#[test]
fn holes_and_bytes_lost_or_added_cost_what_they_hit() {
    let garbage: Vec<u8> = (0..1000u32).map(|k| ((k * k) >> 3) as u8).collect();
    for whole in whole_files() {
        let views = whole.asset.views.len();
        let kept = |damaged: &[u8], what: &str| {
            let repaired = mended(whole, damaged, what).unwrap();
            repaired.views - repaired.lost_views.len()
        };
        assert_eq!(kept(&[&garbage, &whole.bytes[..], &garbage].concat(), "garbage around"), views);
        let text_mode =
            whole.bytes.iter().flat_map(|&byte| if byte == b'\n' { vec![b'\r', b'\n'] } else { vec![byte] });
        let repaired = mended(whole, &text_mode.collect::<Vec<u8>>(), "text mode").unwrap();
        assert!(!repaired.has_losses() && repaired.bytes == whole.bytes && repaired.faults[0].contains("text mode"));
        let mesh = whole.content(Tag::MESH);
        assert_eq!(kept(&whole.spliced(mesh - 40..mesh - 40, b"added"), "bytes added before the mesh"), views);
        if let Some(planes) = whole.section(Tag::PLANES) {
            let (start, length) = (whole.content(Tag::PLANES), planes.stored as usize);
            let half = start + length / 2;
            let parts: [(&str, Vec<u8>); 4] = [
                ("a hole", whole.spliced(half..half + 100, &[0; 100])),
                ("bytes lost", whole.spliced(half..half + 7, b"")),
                ("bytes added", whole.spliced(half..half, b"added")),
                (
                    "lost and added",
                    [
                        &whole.bytes[..half],
                        b"more",
                        &whole.bytes[half..start + length * 4 / 5],
                        &whole.bytes[start + length * 4 / 5 + 9..],
                    ]
                    .concat(),
                ),
            ];
            for (what, damaged) in parts {
                let kept = kept(&damaged, what);
                assert!(kept > 0 && kept < views, "{}: {what}: {kept}", whole.name);
            }
        }
    }
}

#[test]
fn random_damage_never_does_more_than_it_must() {
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    for whole in whole_files() {
        for round in 0..12 {
            let mut damaged = whole.bytes.clone();
            for _ in 0..1 + round % 4 {
                let at = random(damaged.len());
                damaged[at] ^= 1 << random(8);
            }
            mended(whole, &damaged, &format!("round {round}"));
            // What was repaired may be damaged again.
            if let Ok(repaired) = repair(&damaged, Limits::default()) {
                let at = random(repaired.bytes.len());
                let mut again = repaired.bytes;
                again[at] ^= 0x80;
                if let Ok(second) = repair(&again, Limits::default()) {
                    decode(&second.bytes, &DecodeOptions::default()).unwrap();
                }
            }
        }
    }
}

#[test]
fn the_program_says_what_is_lost() {
    let whole = &whole_files()[0];
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (broken, file) = (path("broken.tsuya"), path("mended.tsuya"));
    let write = |bytes: &[u8]| std::fs::write(&broken, bytes).unwrap();
    write(&whole.bytes[..whole.bytes.len() * 4 / 5]);
    let said = complaint(4, &["repair", text(&broken), "-o", text(&file), "--json"]);
    assert!(said.contains("lost: ") && said.contains("off/0"), "{said}");
    let verified = support::output(&["verify", text(&file), "--deep"]);
    assert!(verified.contains(" of 7 views decode\nlost before the file was repaired: off/0"), "{verified}");
    assert!(complaint(1, &["repair", text(&broken), "-o", text(&broken), "--force"]).contains("would be overwritten"));
    assert!(complaint(2, &["repair", text(&broken), "-o", text(&file)]).contains("--force"));

    // Decoding a damaged file is an error that says what to do, or gives what is whole and says that something is not.
    let decoded = path("decoded");
    let said = complaint(3, &["decode", text(&broken), "-o", text(&decoded)]);
    assert!(said.contains("tsuya repair makes a whole file") && !decoded.exists(), "{said}");
    let said = complaint(4, &["decode", text(&broken), "-o", text(&decoded), "--salvage"]);
    assert!(said.contains(" of 7 views (off/0"), "{said}");
    let frames: serde_json::Value =
        serde_json::from_slice(&std::fs::read(decoded.join("transforms.json")).unwrap()).unwrap();
    let frames = frames["frames"].as_array().unwrap().len();
    assert!(frames > 0 && frames < 7 && std::fs::read_dir(decoded.join("off")).unwrap().count() == frames);

    write(&whole.bytes[..100]);
    assert!(complaint(3, &["repair", text(&broken), "-o", text(&file), "--force"]).contains("nothing can be saved"));
    write(&whole.flipped(3));
    tsuya(&["repair", text(&broken), "-o", text(&file), "--force"])
        .code(0)
        .stdout("the signature is damaged\nkept: sections mETA tHMB MESH VIEW CHRT RFLC PLAN\nkept: 7 of 7 views\n");
    assert_eq!(std::fs::read(&file).unwrap(), whole.bytes);
    let mut later = whole.bytes.clone();
    later[10] = 9;
    write(&later[..later.len() - 9]);
    assert!(complaint(5, &["repair", text(&broken), "-o", text(&file), "--force"]).contains("version 0.9"));
}
