//! Any file of any sections decodes in every way alike; then its sections are damaged, checksums put right, and it is decoded again.

use arbitrary::{Result, Unstructured};
use tsuya::Error;
use tsuya::container::Tag;
use tsuya_fuzz::compare::decode_in_every_way;
use tsuya_fuzz::damage::{FileDamage, RawSection};
use tsuya_fuzz::repair::assemble;
use tsuya_fuzz::values::{LIMITS, Object, TAGS, codec};

pub fn fuzz(bytes: &[u8]) {
    let _ = run(&mut Unstructured::new(bytes));
}

fn run(u: &mut Unstructured) -> Result<()> {
    // A few of the sections at a time, photographs of one profile.
    let wanted = u.arbitrary::<u16>()? & u.arbitrary::<u16>()?;
    let profile = *u.choose(&[None, Some(Tag::PLANES), Some(Tag::WAVELET_TEXTURE)])?;
    let damages: Vec<FileDamage> = (0..u.int_in_range(1..=6)?).map(|_| u.arbitrary()).collect::<Result<_>>()?;
    let object = Object::arbitrary(u)?;
    let mut sections: Vec<RawSection> = Vec::new();
    for (index, tag) in TAGS.into_iter().enumerate() {
        let taken = match tag {
            Tag::MESH | Tag::VIEWS => true,
            Tag::PLANES | Tag::WAVELET_TEXTURE => profile == Some(tag),
            Tag::BINDING => wanted >> index & 1 == 1 && sections.iter().any(|section| section.0 == Tag::MATERIALS.0),
            _ => wanted >> index & 1 == 1,
        };
        if taken && let Some(section) = object.section(tag, u)?.filter(|section| !section.is_empty()) {
            sections.push((tag.0, codec(tag), section));
        }
    }
    match decode_in_every_way(&assemble(&sections), LIMITS) {
        Ok(_) | Err(Error::Limits { .. }) => {}
        Err(error) => panic!("our own file: {error}"),
    }
    for damage in &damages {
        damage.apply(&mut sections);
    }
    // With the checksums of the streams, too.
    let _ = decode_in_every_way(&assemble(&sections), LIMITS);
    Ok(())
}
