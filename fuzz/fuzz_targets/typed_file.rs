//! Any file of any sections decodes in every way alike; then its sections are damaged, checksums put right, and it is decoded again.
#![no_main]
use libfuzzer_sys::arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use tsuya::Error;
use tsuya::container::Tag;
use tsuya_fuzz::compare::decode_in_every_way;
use tsuya_fuzz::damage::{FileDamage, RawSection};
use tsuya_fuzz::repair::assemble;
use tsuya_fuzz::values::{LIMITS, Object, TAGS, codec};

fuzz_target!(|bytes: &[u8]| {
    let _ = run(&mut Unstructured::new(bytes));
});

fn run(u: &mut Unstructured) -> Result<()> {
    let wanted: u16 = u.arbitrary()?;
    let damages: Vec<FileDamage> = (0..u.int_in_range(1..=6)?).map(|_| u.arbitrary()).collect::<Result<_>>()?;
    let object = Object::arbitrary(u)?;
    let mut sections: Vec<RawSection> = Vec::new();
    for (index, tag) in TAGS.into_iter().enumerate() {
        // Profiles exclude each other; maps without their atlas are nothing.
        let excluded = tag == Tag::PAPER && wanted >> index & 3 == 3 || tag == Tag::PLANES && wanted >> index & 3 == 3;
        let needed = matches!(tag, Tag::MESH | Tag::VIEWS);
        if needed || wanted >> index & 1 == 1 && !excluded {
            let Some(section) = object.section(tag, u)? else { continue };
            if !section.is_empty() {
                sections.push((tag.0, codec(tag), section));
            }
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
