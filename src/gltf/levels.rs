//! Prefixes of a stream, each of which shows more than the one before.

use crate::container::{Container, Tag};
use crate::error::Result;
use crate::limits::Limits;
use crate::predictive::header;
use crate::views::codec;

/// Returns the lengths of a stream's prefixes in bytes, ascending: up to the photographs (mesh and reflectance); with 1, 2, 4,
/// 8 ... views; the whole stream.
/// # Errors
/// As [`Container::open_slice`], and [`crate::Error::Format`] if sections VIEW or PLAN are damaged.
pub fn prefix_lengths(stream: &[u8], limits: Limits) -> Result<Vec<u64>> {
    let mut file = Container::open_slice(stream, limits)?;
    let mut found = Vec::new();
    let pictures = [Tag::PLANES, Tag::WAVELET_TEXTURE]
        .into_iter()
        .filter_map(|tag| file.find(tag).copied())
        .min_by_key(|s| s.offset);
    if let Some(section) = pictures {
        let model = [Tag::REFLECTANCE, Tag::CHARTS, Tag::MESH].into_iter().find_map(|tag| file.find(tag)?.end());
        found.extend(model.filter(|&end| end <= section.offset));
        if section.tag == Tag::PLANES {
            let budget = file.budget();
            let capture = codec::decode(&file.read_section(Tag::VIEWS)?, &budget)?;
            let components = capture.components.len();
            let planes = file.drive(|file| header::open(file, &section, &capture.views, components))?;
            let entries = &planes.header.entries;
            let shown = (1..entries.len()).filter(|count| count.is_power_of_two());
            found.extend(shown.map(|count| planes.stream_range(&entries[count - 1]).end));
        }
    }
    found.push(stream.len() as u64);
    found.retain(|&level| level <= stream.len() as u64);
    found.dedup();
    Ok(found)
}
