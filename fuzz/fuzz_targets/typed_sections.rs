//! Any value of any section is written and comes back; then its bytes are damaged and read.

use arbitrary::{Result, Unstructured};
use tsuya_fuzz::damage::Damage;
use tsuya_fuzz::values::{Object, TAGS, planes_header};

pub fn fuzz(bytes: &[u8]) {
    let _ = run(&mut Unstructured::new(bytes));
}

fn run(u: &mut Unstructured) -> Result<()> {
    let tag = TAGS[u.int_in_range(0..=TAGS.len() - 1)?];
    let damages: Vec<Damage> = (0..u.int_in_range(0..=4)?).map(|_| u.arbitrary()).collect::<Result<_>>()?;
    let object = Object::arbitrary(u)?;
    if u.ratio(1, 16)? {
        planes_header(u)?;
    }
    let Some(mut section) = object.section(tag, u)? else { return Ok(()) };
    for damage in damages {
        damage.apply(&mut section);
    }
    object.read(tag, &section);
    Ok(())
}
