//! `tsuya info`: what a file holds.

use crate::output;
use crate::source::{limits, name, open_container};
use anyhow::{Context, Result};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
use tsuya::container::{SectionCodec, Tag, VERSION};
use tsuya::decoder::{DecodeOptions, ViewSelection, decode_from};

/// Shows what a file holds: sections, metadata, views, mesh, error.
#[derive(Args)]
pub struct Info {
    /// The file; - is standard input.
    file: PathBuf,
    /// Prints everything as JSON.
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(self) -> Result<()> {
        let mut file = open_container(&self.file)?;
        let options = DecodeOptions { selection: ViewSelection::None, limits: limits(), ..Default::default() };
        let asset = decode_from(&mut file, &options).with_context(|| name(&self.file))?;
        let codec = |codec: SectionCodec| match codec {
            SectionCodec::None => "none",
            SectionCodec::Zstd => "zstd",
            SectionCodec::Own => "own",
        };
        let sections: Vec<Value> = (file.sections().iter())
            .map(|s| {
                let tag = s.tag.to_string();
                json!({"tag": tag, "codec": codec(s.codec), "offset": s.offset, "bytes": s.stored, "decoded_bytes": s.decoded})
            })
            .collect();
        let profile = match (file.find(Tag::PLANES), file.find(Tag::WAVELET_TEXTURE)) {
            (Some(_), _) => Some("predictive"),
            (_, Some(_)) => Some("wavelet-texture"),
            _ => None,
        };
        let maps = asset.reflectance.as_ref();
        let relightable = asset.is_modelled() || maps.is_some_and(|maps| maps.relightable);
        let entries = maps.map_or(0, |maps| maps.palette.len());
        let materials: Vec<Value> = (asset.materials.iter())
            .map(|named| json!({"name": named.name, "form": named.material.form(), "bytes": named.material.encode().len()}))
            .collect();
        let bound = asset.binding.as_ref().map(|binding| binding.names.iter().zip(binding.counts()));
        if self.json {
            let bound = bound.map(|bound| -> Vec<Value> {
                bound.map(|(name, triangles)| json!({"name": name, "triangles": triangles})).collect()
            });
            let views: Vec<Value> = (asset.views.iter())
                .map(|view| {
                    let camera = &view.camera;
                    json!({"name": view.name, "width": camera.width, "height": camera.height, "light": view.light})
                })
                .collect();
            return output::print_json(&json!({
                "bytes": file.file_bytes(),
                "version": format!("{}.{}", VERSION.0, VERSION.1),
                "profile": profile,
                "sections": sections,
                "metadata": asset.metadata,
                "achieved_error": asset.metadata.get("achieved_error"),
                "components": asset.components,
                "white": asset.white,
                "mesh": {"vertices": asset.mesh.positions.len(), "triangles": asset.mesh.triangles.len()},
                "surface": asset.surface.as_ref().map(|surface| json!({"vertices": surface.mesh().positions.len(), "triangles": surface.mesh().triangles.len()})),
                "atlas": asset.charts.as_ref().map(|c| json!({"width": c.width, "height": c.height, "charts": c.charts.len()})),
                "relightable": relightable,
                "palette_entries": entries,
                "visibility": asset.visibility.as_ref().map(|v| json!({"places": v.places().count(), "terms": v.terms(), "resolution": v.size(), "ground": v.has_ground(),
                    "rms_error_rad": v.error().rms_radians, "sign_error": v.error().wrong_signs})),
                "light": asset.light.as_ref().map(|light| json!({"lobes": light.diffuse.len(),
                    "levels": light.prefiltered.iter().map(|level| json!({"sharpness": level.sharpness(), "size": level.size()})).collect::<Vec<_>>()})),
                "views": views,
                "materials": materials,
                "binding": bound,
                "texture_coordinates": asset.coordinates.is_some(),
            }));
        }
        let mut text = String::new();
        let _ = writeln!(
            text,
            "{}: {} bytes, version {}.{}, profile {}",
            output::line(&name(&self.file)),
            file.file_bytes(),
            VERSION.0,
            VERSION.1,
            profile.unwrap_or("none")
        );
        let _ = writeln!(text, "\nsection  codec      stored     decoded");
        for section in file.sections() {
            let _ = writeln!(
                text,
                "{:7}  {:5}  {:10}  {:10}",
                section.tag.to_string(),
                codec(section.codec),
                section.stored,
                section.decoded
            );
        }
        let _ = writeln!(text);
        for (key, value) in &asset.metadata {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            // Each on its line, whatever is in it.
            let _ = writeln!(text, "{}: {}", output::line(key), output::line(&value));
        }
        let _ =
            writeln!(text, "mesh: {} vertices, {} triangles", asset.mesh.positions.len(), asset.mesh.triangles.len());
        if let Some(surface) = asset.surface.as_ref().map(|surface| surface.mesh()) {
            let _ =
                writeln!(text, "surface: {} vertices, {} triangles", surface.positions.len(), surface.triangles.len());
        }
        let components: Vec<String> = asset.components.iter().map(|c| format!("{c:?}").to_lowercase()).collect();
        let lit = asset.views.iter().filter(|view| view.light.is_some()).count();
        let sizes = asset.views.iter().map(|v| (v.camera.width, v.camera.height));
        let (small, large) = (sizes.clone().min().unwrap_or_default(), sizes.max().unwrap_or_default());
        let size = if small == large {
            format!("{} x {}", small.0, small.1)
        } else {
            format!("{} x {} to {} x {}", small.0, small.1, large.0, large.1)
        };
        if !asset.views.is_empty() {
            let _ = writeln!(text, "views: {} of {size} pixels, {}", asset.views.len(), components.join(" and "));
            let _ = writeln!(text, "lights: known for {lit} views");
        }
        if let Some(charts) = &asset.charts {
            let _ = writeln!(
                text,
                "reflectance: {} x {} texels in {} charts",
                charts.width,
                charts.height,
                charts.charts.len()
            );
        }
        if !asset.materials.is_empty() {
            let names: Vec<String> = asset.materials.iter().map(|named| output::line(&named.name)).collect();
            let _ = writeln!(text, "materials: {} ({})", names.len(), names.join(", "));
        }
        for (name, triangles) in bound.into_iter().flatten() {
            let form = asset.materials.iter().find(|m| m.name == *name).map_or("", |named| named.material.form());
            let _ = writeln!(text, "made of: {}, {form}, {triangles} triangles", output::line(name));
        }
        if asset.coordinates.is_some() {
            let _ = writeln!(text, "texture coordinates: of all corners");
        }
        if let Some(visibility) = &asset.visibility {
            let (terms, error) = (visibility.terms(), visibility.error());
            let ground = if visibility.has_ground() { ", with a ground" } else { "" };
            let (degrees, places) = (error.rms_radians.to_degrees(), visibility.places().count());
            let _ =
                writeln!(text, "visibility: {places} places, {terms} terms, error {degrees:.2} degrees rms{ground}");
        }
        if let Some(light) = &asset.light {
            let _ =
                writeln!(text, "light: {} lobes, {} prefiltered levels", light.diffuse.len(), light.prefiltered.len());
        }
        if entries > 0 {
            let _ = writeln!(text, "highlights: a palette of {entries} measured lobes");
        }
        if asset.reflectance.as_ref().is_some_and(|maps| !maps.lobes.is_empty()) {
            let _ = writeln!(text, "highlights: weights of five GGX lobes");
        }
        let _ = writeln!(text, "can be relit: {}", if relightable { "yes" } else { "no" });
        output::print(&text)
    }
}
