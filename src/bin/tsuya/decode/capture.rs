//! A decoded asset as a folder that `tsuya encode` reads.

use super::Format;
use super::names::view_names;
use crate::output::Folder;
use crate::{pictures, ply};
use anyhow::Result;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::OnceLock;
use tsuya::Asset;
use tsuya::PaletteEntry;
use tsuya::brdf::{FittedMaterial, NamedMaterial};
use tsuya::container::Metadata;
use tsuya::encoder::{encode_materials, recombine};
use tsuya::image::RgbImage;
use tsuya::metrics::to_display;
use tsuya::{Component, Photograph, View};

/// The file that is there only when all that it names is there.
pub const INDEX: &str = "transforms.json";

/// What the index says of a view, and the view's number.
pub type Frame = (usize, Value);

/// Where a decoded capture goes.
pub struct CaptureFolder {
    pub folder: Folder,
    pub format: Format,
    pub half: bool,
    /// What the views' files are called, once the views are known.
    pub names: OnceLock<Vec<String>>,
}

impl CaptureFolder {
    fn put(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.folder.write(name, bytes)
    }

    fn put_picture(&self, name: &str, image: &RgbImage, white: [f64; 3]) -> Result<()> {
        let bytes = match self.format {
            Format::Exr => pictures::exr(image, self.half)?,
            Format::Png16 => pictures::png16(image, white)?,
            Format::Png => pictures::png(&to_display(image, white))?,
        };
        self.put(name, &bytes)
    }

    /// Writes some views' photographs; returns what the index says of them.
    pub fn write_views(&self, asset: &Asset, decoded: &[(usize, Photograph)], preview: bool) -> Result<Vec<Frame>> {
        let names = self.names.get_or_init(|| view_names(&asset.views));
        let one = |(index, photograph): &(usize, Photograph)| {
            let view = (&asset.views[*index], &names[*index][..]);
            Ok((*index, self.write_view(asset, view, photograph, preview)?))
        };
        decoded.par_iter().map(one).collect()
    }

    /// Writes everything else that the asset has, and the index, and puts the folder into its place.
    pub fn finish(self, asset: &Asset, mut frames: Vec<Frame>) -> Result<()> {
        self.put("mesh.ply", &ply::write(&asset.mesh))?;
        if let Some(surface) = &asset.surface {
            self.put("surface.ply", &ply::write(surface.mesh()))?;
        }
        let white = asset.white.map(|w| w as f32);
        let white_file = format!("white.{}", self.extension());
        self.put_picture(&white_file, &RgbImage::filled(8, 8, white), asset.white)?;
        if let Some(maps) = &asset.reflectance {
            self.put("maps/diffuse.exr", &pictures::exr(&maps.diffuse, self.half)?)?;
            for (number, lobe) in maps.lobes.iter().enumerate() {
                self.put(&format!("maps/lobe-{number}.exr"), &pictures::exr(lobe, self.half)?)?;
            }
            if !maps.specular.data.is_empty() {
                self.put("maps/specular.exr", &pictures::exr(&maps.specular, self.half)?)?;
                self.put("maps/sigma.exr", &pictures::exr_grey(&maps.sigma)?)?;
            }
            if !maps.palette.is_empty() {
                let materials: Vec<NamedMaterial> = maps.palette.iter().map(palette_material).collect();
                self.put("maps/palette.tsuya", &encode_materials(&materials, &Metadata::default())?)?;
            }
        }
        let polarised = asset.components.contains(&Component::Diffuse);
        let mut reference = json!({"file_path": white_file});
        if polarised {
            // Decoded diffuse images are divided by the board's ratio already.
            reference["cross_file_path"] = json!(white_file);
        }
        let linear = asset.metadata.get("color_space").and_then(Value::as_str).unwrap_or("linear-rec709");
        frames.sort_by_key(|(index, _)| *index);
        let transforms = json!({
            "camera_model": "PINHOLE",
            "mesh_file": "mesh.ply",
            "color_space": if self.format == Format::Exr { linear } else { "srgb" },
            "white_reference": reference,
            "frames": frames.into_iter().map(|(_, frame)| frame).collect::<Vec<Value>>(),
        });
        let metadata = Value::Object(asset.metadata.clone());
        self.put("metadata.json", format!("{metadata:#}\n").as_bytes())?;
        self.put(INDEX, format!("{transforms:#}\n").as_bytes())?;
        self.folder.commit()
    }

    fn extension(&self) -> &'static str {
        if self.format == Format::Exr { "exr" } else { "png" }
    }

    fn write_view(
        &self,
        asset: &Asset,
        (view, name): (&View, &str),
        photograph: &Photograph,
        preview: bool,
    ) -> Result<Value> {
        let (white, extension) = (asset.white, self.extension());
        let (whole, _) = recombine(&asset.components, &photograph.images, None)?;
        let file_path = format!("{name}.{extension}");
        self.put_picture(&file_path, &whole, white)?;
        let mask_path = format!("mask/{name}.png");
        self.put(&mask_path, &pictures::mask_png(&photograph.mask)?)?;
        let camera = &view.camera;
        let mut frame = json!({
            "file_path": file_path,
            "mask_path": mask_path,
            "w": camera.width,
            "h": camera.height,
            "fl_x": camera.focal[0],
            "fl_y": camera.focal[1],
            "cx": camera.principal[0],
            "cy": camera.principal[1],
            "transform_matrix": camera_to_world(view),
        });
        if asset.components == [Component::Diffuse, Component::Specular] {
            let cross = format!("diffuse/{name}.{extension}");
            self.put_picture(&cross, &photograph.images[0], white)?;
            frame["cross_file_path"] = json!(cross);
            self.put_picture(&format!("specular/{name}.{extension}"), &photograph.images[1], white)?;
        }
        if let Some(light) = view.light {
            // Display-referred pictures are relative to the white board, and so is their light.
            let unit = if self.format == Format::Exr { [1.0; 3] } else { white };
            let intensity: [f64; 3] = std::array::from_fn(|c| light.intensity[c] / unit[c]);
            frame["light"] = json!({"type": "point", "position": light.position, "intensity": intensity});
        }
        if preview {
            let picture = to_display(&photograph.sum(), white);
            self.put(&format!("preview/{name}.png"), &pictures::png(&picture)?)?;
        }
        Ok(frame)
    }
}

/// An entry of a palette as a material, called by the width that it stands for.
fn palette_material(entry: &PaletteEntry) -> NamedMaterial {
    let name = format!("sigma {:.4}", entry.sigma());
    NamedMaterial { name, material: FittedMaterial::Dsbrdf(entry.lobes.clone()) }
}

/// Camera to world with OpenGL's axes (x right, y up, z backward).
fn camera_to_world(view: &View) -> [[f64; 4]; 4] {
    let (rotation, centre) = (&view.camera.rotation, view.camera.centre());
    let row = |i: usize| [rotation[0][i], -rotation[1][i], -rotation[2][i], centre[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}
