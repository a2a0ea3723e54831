//! Checksums of what a file decodes to: a line for each part, its name and the CRC-32 of its values, numbers little-endian, rows from the
//! top, both zeros written as +0. The same lines as `tools/reference/decode.py --checksums`.

use std::fmt::Write;
use tsuya::Asset;
use tsuya::{Camera, View};

/// Collects the values of one part.
#[derive(Default)]
struct Values(crc32fast::Hasher);

impl Values {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }
    fn integers(&mut self, values: impl IntoIterator<Item = u32>) {
        values.into_iter().for_each(|value| self.bytes(&value.to_le_bytes()));
    }
    fn singles(&mut self, values: impl IntoIterator<Item = f32>) {
        values.into_iter().for_each(|value| self.bytes(&(value + 0.0).to_le_bytes()));
    }
    fn doubles(&mut self, values: impl IntoIterator<Item = f64>) {
        values.into_iter().for_each(|value| self.bytes(&(value + 0.0).to_le_bytes()));
    }
    /// Name, size, focal lengths, principal point, rotation, translation; light: 0, or 1, position, intensity.
    fn view(&mut self, View { name, camera, light }: &View) {
        let Camera { width, height, focal, principal, rotation, translation } = camera;
        self.integers([name.len() as u32]);
        self.bytes(name.as_bytes());
        self.integers([*width, *height]);
        self.doubles(focal.iter().chain(principal).chain(rotation.iter().flatten()).chain(translation).copied());
        self.integers([light.is_some() as u32]);
        light.iter().for_each(|light| self.doubles(light.position.into_iter().chain(light.intensity)));
    }
    fn end(self, lines: &mut String, name: &str) {
        // Writing to a string does not fail.
        let _ = writeln!(lines, "{name} {:08x}", self.0.finalize());
    }
}

/// A part of its values.
fn part(lines: &mut String, name: &str, fill: impl FnOnce(&mut Values)) {
    let mut values = Values::default();
    fill(&mut values);
    values.end(lines, name);
}

/// All lines of a decoded file.
pub fn checksums(asset: &Asset) -> String {
    let mut lines = String::new();
    if !asset.mesh.positions.is_empty() {
        part(&mut lines, "mesh positions", |v| v.singles(asset.mesh.positions.iter().flatten().copied()));
        part(&mut lines, "mesh triangles", |v| v.integers(asset.mesh.triangles.iter().flatten().copied()));
    }
    if !asset.views.is_empty() {
        part(&mut lines, "views", |v| {
            v.doubles(asset.white);
            asset.views.iter().for_each(|view| v.view(view));
        });
    }
    if let Some(surface) = &asset.surface {
        part(&mut lines, "surface positions", |v| v.singles(surface.mesh().positions.iter().flatten().copied()));
    }
    if let Some(maps) = &asset.reflectance {
        part(&mut lines, "reflectance diffuse", |v| v.singles(maps.diffuse.data.iter().flatten().copied()));
        for (number, map) in maps.lobes.iter().enumerate() {
            part(&mut lines, &format!("reflectance lobe-{number}"), |v| v.singles(map.data.iter().flatten().copied()));
        }
        if !maps.specular.data.is_empty() {
            part(&mut lines, "reflectance specular", |v| v.singles(maps.specular.data.iter().flatten().copied()));
            part(&mut lines, "reflectance sigma", |v| v.singles(maps.sigma.data.iter().copied()));
        }
    }
    for (index, photograph) in asset.photographs.iter().enumerate() {
        let Some(photograph) = photograph else { continue };
        let set = photograph.mask.data.iter().map(|&set| set as u8).collect::<Vec<u8>>();
        part(&mut lines, &format!("view {index} mask"), |v| v.bytes(&set));
        for (component, image) in asset.components.iter().zip(&photograph.images) {
            let name = format!("view {index} {}", format!("{component:?}").to_lowercase());
            part(&mut lines, &name, |v| v.singles(image.data.iter().flatten().copied()));
        }
    }
    if let Some(binding) = &asset.binding {
        let numbers: Vec<u8> = binding.of_triangle.iter().flat_map(|number| number.to_le_bytes()).collect();
        part(&mut lines, "binding", |v| v.bytes(&numbers));
    }
    if let Some(coordinates) = &asset.coordinates {
        let values = coordinates.as_flattened().as_flattened();
        part(&mut lines, "texture coordinates", |v| v.singles(values.iter().copied()));
    }
    if let Some(visibility) = &asset.visibility {
        part(&mut lines, "visibility bases", |v| v.singles(visibility.bases().iter().copied()));
        let weights: Vec<u8> = visibility.all_weights().iter().map(|&weight| weight as u8).collect();
        part(&mut lines, "visibility weights", |v| v.bytes(&weights));
    }
    if let Some(light) = &asset.light {
        part(&mut lines, "light lobes", |v| {
            for lobe in &light.diffuse {
                v.doubles(lobe.axis.into_iter().chain([lobe.sharpness]).chain(lobe.amplitude));
            }
        });
        for (index, level) in light.prefiltered.iter().enumerate() {
            part(&mut lines, &format!("light level {index}"), |v| v.singles(level.cells().iter().flatten().copied()));
        }
    }
    lines
}

/// Decodes a file; an error's text where that fails.
pub fn checksums_of(file: &[u8]) -> String {
    match tsuya::decoder::decode(file, &Default::default()) {
        Ok(asset) => checksums(&asset),
        Err(error) => format!("error: {error}\n"),
    }
}
