//! Description of a file as JSON.

use serde_json::{Value, json};
use tsuya::View;
use tsuya::container::{Section, VERSION, metres_per_unit};
use tsuya::decoder::{FileHeader, PhotographCoding};

/// Facts, views and coding order.
pub fn opened(opened: &FileHeader) -> Value {
    let FileHeader { metadata, capture, photographs } = opened;
    let profile = match photographs {
        PhotographCoding::None => None,
        PhotographCoding::Predictive { .. } => Some("predictive"),
        PhotographCoding::WaveletTexture => Some("wavelet-texture"),
    };
    let order: Vec<Value> = match photographs {
        PhotographCoding::Predictive(planes) => {
            let entries = planes.header.entries.iter().map(|coded| {
                let streams = planes.stream_range(coded);
                let bytes = streams.end - streams.start;
                let mut needs: Vec<usize> = coded.entry.dependencies().collect();
                needs.sort_unstable();
                needs.dedup();
                json!({"view": coded.entry.view, "needs": needs, "offset": streams.start, "bytes": bytes})
            });
            entries.collect()
        }
        _ => Vec::new(),
    };
    let views: Vec<Value> = (capture.views.iter())
        .map(|view| json!({"name": view.name, "camera": view.camera, "light": view.light}))
        .collect();
    json!({
        "facts": {
            "version": format!("{}.{}", VERSION.0, VERSION.1),
            "profile": profile,
            "metadata": metadata.0,
            "title": metadata.title(),
            "licence": metadata.licence(),
            "units": metadata.units(),
            "statedError": metadata.achieved_error(),
            "components": capture.components,
            "white": capture.white,
            "upright": View::upright_rotation(&capture.views),
            "metres_per_unit": metres_per_unit(&metadata.0),
        },
        "views": views,
        "order": order,
    })
}

/// Sections known so far, and whether these are all.
pub fn sections((sections, is_complete): (&[Section], bool)) -> Value {
    let list: Vec<Value> = (sections.iter())
        .map(|s| json!({"tag": s.tag.to_string(), "offset": s.offset, "bytes": s.header_bytes() + s.stored}))
        .collect();
    json!({"sections": list, "sectionsComplete": is_complete})
}
