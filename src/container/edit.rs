//! Sections added to a file, the others kept.

use super::{Container, ContainerWriter, SectionCodec, Tag};
use crate::Result;
use crate::limits::Limits;

/// Returns the file with `sections` in place of those of the same tags, or at its end. All others stay as they are, also
/// those that this build does not know.
/// # Errors
/// [`crate::Error::Format`] if the file or a section is invalid, [`crate::Error::Limits`] if the memory budget is exceeded.
pub fn with_sections(file: &[u8], sections: &[(Tag, SectionCodec, Vec<u8>)], limits: Limits) -> Result<Vec<u8>> {
    let mut old = Container::open_slice(file, limits)?;
    let mut writer = ContainerWriter::new(Vec::with_capacity(file.len()))?;
    for section in old.sections().to_vec() {
        if sections.iter().all(|(tag, ..)| *tag != section.tag) {
            let content = old.read_content(&section)?;
            old.budget().release(section.decoded);
            writer.write_section(section.tag, section.codec, &content)?;
        }
    }
    for (tag, codec, content) in sections {
        writer.write_section(*tag, *codec, content)?;
    }
    writer.finish()
}
