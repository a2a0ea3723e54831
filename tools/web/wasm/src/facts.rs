//! What a file says of itself, as JSON.

use serde_json::{Value, json};
use tsuya::asset::metres;
use tsuya::container::{Section, VERSION};
use tsuya::decoder::arriving::{Opened, PictureFacts};
use tsuya::views::upright;

/// Facts, views and coding order.
pub fn opened(opened: &Opened) -> Value {
    let Opened { metadata, capture, pictures } = opened;
    let profile = match pictures {
        PictureFacts::None => None,
        PictureFacts::Tuned { .. } => Some("tuned"),
        PictureFacts::Paper => Some("paper"),
    };
    let order: Vec<Value> = match pictures {
        PictureFacts::Tuned { header, streams } => {
            let steps = header.steps.iter().map(|coded| {
                let bytes: u64 = coded.lengths.iter().map(|&length| length as u64).sum();
                let mut needs: Vec<usize> = coded.step.needs().collect();
                needs.sort_unstable();
                needs.dedup();
                json!({"view": coded.step.view, "needs": needs, "offset": streams + coded.offset, "bytes": bytes})
            });
            steps.collect()
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
            "upright": upright(&capture.views),
            "metres": metres(&metadata.0),
        },
        "views": views,
        "order": order,
    })
}

/// The sections that are known, and whether these are all.
pub fn sections((sections, is_complete): (&[Section], bool)) -> Value {
    let list: Vec<Value> = (sections.iter())
        .map(|s| json!({"tag": s.tag.to_string(), "offset": s.offset, "bytes": s.header_bytes() + s.stored}))
        .collect();
    json!({"sections": list, "sectionsComplete": is_complete})
}
