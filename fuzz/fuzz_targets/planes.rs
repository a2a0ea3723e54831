//! Any bytes as section `PLAN` of a small object, checksums put right; and any bytes as the streams of a sound head.

use tsuya::internals::{
    self,
    predictive::{PREFIX_BYTES, PlaneHeader},
};
use tsuya::{Budget, Limits};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let components = 1 + kind as usize % 2;
    let limits = Limits { memory_bytes: 1 << 26, views: 64, image_side: 1024, mesh_elements: 1 << 12 };
    let budget = Budget::new(limits);
    let (mesh, views) = (scene::mesh(), scene::views_of(&scene::sizes(kind & 2 != 0)));
    let mut section = bytes.to_vec();
    if let Ok(length) = PlaneHeader::head_bytes(bytes)
        && let Some(head) = bytes.get(PREFIX_BYTES..PREFIX_BYTES + length as usize)
    {
        section[4..8].copy_from_slice(&crc32fast::hash(head).to_le_bytes());
    }
    let Ok(mut header) = PlaneHeader::parse(&section, &views, components, &budget) else { return };
    let streams = &section[PREFIX_BYTES + PlaneHeader::head_bytes(&section).unwrap_or(0) as usize..];
    // What the head claims may be more than there is: each stream gets what is left of its length.
    let mut rest = streams;
    let mut parts = Vec::new();
    for step in &mut header.entries {
        let mut all = Vec::new();
        let mut cut = |lengths: &mut [u32]| {
            let start = all.len();
            for length in lengths {
                let (part, after) = rest.split_at(rest.len().min(*length as usize));
                *length = part.len() as u32;
                all.extend_from_slice(part);
                rest = after;
            }
            crc32fast::hash(&all[start..])
        };
        step.checksum = cut(&mut step.lengths);
        step.tiles.iter_mut().for_each(|tile| tile.checksum = cut(&mut tile.lengths));
        parts.push(all);
    }
    let mut next = parts.into_iter();
    let read = |_: std::ops::Range<u64>| Ok(next.next());
    let decoded = internals::predictive::decode(&header, &mesh, (&views, scene::WHITE), |_| true, read, &budget);
    for (photograph, view) in decoded.into_iter().flatten().zip(&views) {
        let photograph = photograph.expect("all were asked for");
        let pixels = view.camera.width as usize * view.camera.height as usize;
        assert!(photograph.images.len() == components && photograph.mask.data.len() == pixels);
    }
}
