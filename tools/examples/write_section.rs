//! Adds a private section to a file and reads it back: `write_section [FILE [TEXT]]`. Readers that don't know the section keep it and decode the
//! rest as before.

use std::error::Error;
use tsuya::container::{Container, SectionCodec, Tag, with_sections};
use tsuya::{DecodeOptions, Limits, decode};

/// Lower case: ancillary (readers may ignore it), private, and (last letter) safe to keep when other sections change.
const INVENTORY: Tag = Tag(*b"inVt");

/// Returns the file with this text in a section of its own.
pub fn add(file: &[u8], text: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    assert!(INVENTORY.is_valid() && !INVENTORY.is_critical() && INVENTORY.is_private() && INVENTORY.is_safe_to_copy());
    let section = (INVENTORY, SectionCodec::Zstd, text.as_bytes().to_vec());
    Ok(with_sections(file, &[section], Limits::default())?)
}

/// Returns the text of the section, checked by its checksum; `None` in a file without it.
pub fn read(file: &[u8]) -> Result<Option<String>, Box<dyn Error>> {
    let content = Container::open_slice(file, Limits::default())?.read_optional(INVENTORY)?;
    Ok(content.map(String::from_utf8).transpose()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/spec/vectors/ring-small.tsuya");
    let file = std::fs::read(arguments.next().unwrap_or_else(|| sample.to_string()))?;
    let text = arguments.next().unwrap_or_else(|| r#"{"inventory": "1897.12"}"#.to_string());
    let changed = add(&file, &text)?;
    let asset = decode(&changed, &DecodeOptions::default())?;
    let found = read(&changed)?.ok_or("the section is not there")?;
    println!("{} bytes, {} with {found}; {} views decode", file.len(), changed.len(), asset.views.len());
    Ok(())
}
