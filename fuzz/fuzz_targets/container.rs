//! Any bytes as a file: by directory, as a stream, as a prefix, and verified.

use tsuya::container::{Container, Tag, read_prefix, read_stream, verify};
use tsuya::{Limits, container, internals};

pub fn fuzz(bytes: &[u8]) {
    let limits = Limits { memory_bytes: 1 << 24, views: 64, image_side: 1024, mesh_elements: 1 << 12 };
    let verified = verify(bytes, limits);
    let streamed = read_stream(bytes, limits);
    let _ = read_prefix(bytes, limits);
    let Ok(mut container) = Container::open_slice(bytes, limits) else {
        assert!(verified.is_err() && streamed.is_err());
        return;
    };
    for section in container.sections().to_vec() {
        let _ = container.read_range(section.tag, 1, 3);
        let Ok(content) = container.read_content(&section) else {
            assert!(verified.is_err());
            continue;
        };
        match section.tag {
            Tag::METADATA => drop(internals::container::metadata::decode(&content, &container.budget())),
            Tag::THUMBNAIL => drop(container::decode_thumbnail(content)),
            _ => {}
        }
    }
}
