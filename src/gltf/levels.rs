//! Prefixes of a stream from which more can be shown than from shorter ones.

use crate::container::{Container, Tag};
use crate::error::Result;
use crate::limits::Limits;
use crate::predictive::header::{PREFIX_BYTES, PlaneHeader};
use crate::views::codec;

/// Lengths in bytes, ascending: all that comes before the pictures (mesh and reflectance); then 1, 2, 4, 8 ... views; the whole stream.
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
            let prefix = file.read_range(Tag::PLANES, 0, PREFIX_BYTES as u64)?;
            let length = PREFIX_BYTES as u64 + PlaneHeader::head_bytes(&prefix)?;
            let head = file.read_range(Tag::PLANES, 0, length)?;
            let header = PlaneHeader::parse(&head, capture.views.len(), capture.components.len(), &budget)?;
            let start = section.offset + section.header_bytes() + length;
            for (index, step) in header.entries.iter().enumerate() {
                let end = start + step.offset + step.lengths.iter().map(|&l| l as u64).sum::<u64>();
                if (index + 1).is_power_of_two() && index + 1 < header.entries.len() {
                    found.push(end);
                }
            }
        }
    }
    found.push(stream.len() as u64);
    found.retain(|&level| level <= stream.len() as u64);
    found.dedup();
    Ok(found)
}
