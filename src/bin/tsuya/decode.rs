//! `tsuya decode`: a file becomes photographs, mesh and maps again, as a capture that `tsuya encode` reads.

use crate::source::{limits, name, open, open_container};
use crate::values::{find_view, stem};
use crate::{Failed, output, pictures, ply, progress};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Error;
use tsuya::asset::{Asset, Component, Photograph, View};
use tsuya::brdf::materials::{FittedMaterial, NamedMaterial};
use tsuya::container::metadata::Metadata;
use tsuya::container::{Container, Tag, Writer, read_prefix, views};
use tsuya::decoder::{DecodeOptions, Selection, decode_from};
use tsuya::encoder::{encode_materials, sum_of_components};
use tsuya::image::RgbImage;
use tsuya::measure::to_display;
use tsuya::reflectance::palette::{PaletteEntry, sigma_of_level};
use tsuya::separate::recombine;

/// Decodes a file into a folder: photographs, masks, mesh, reflectance maps and a transforms.json that `tsuya encode` reads.
#[derive(Args)]
pub struct Decode {
    /// The file; - is standard input.
    file: PathBuf,
    /// The folder to write; with --mesh-only a .ply file, with --section a file; - is standard output for these two.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Only these views, by number or name, with commas between; of the others nothing is read that these don't need.
    #[arg(long, value_name = "VIEW,...", value_delimiter = ',')]
    views: Vec<String>,
    /// What photographs are written as.
    #[arg(long, value_enum, default_value = "exr")]
    format: Format,
    /// EXR with 16-bit floats instead of 32-bit ones.
    #[arg(long)]
    half: bool,
    /// Also an 8-bit PNG of each photograph, to look at.
    #[arg(long)]
    preview: bool,
    /// Only the mesh, as a PLY file.
    #[arg(long, conflicts_with_all = ["views", "section"])]
    mesh_only: bool,
    /// Only the content of this section, checked and decompressed.
    #[arg(long, value_name = "TAG", conflicts_with = "views")]
    section: Option<String>,
    /// Decodes what is whole of a cut or damaged file.
    #[arg(long)]
    salvage: bool,
    /// Writes into a folder that is not empty, over existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Format {
    /// Linear radiance, all of it.
    Exr,
    /// 16-bit sRGB; the white board is the brightest.
    Png16,
    /// 8-bit sRGB; the white board is the brightest.
    Png,
}

impl Decode {
    pub fn run(self) -> Result<()> {
        let start = Instant::now();
        if self.salvage {
            let (bytes, damage) = salvage(&self.file)?;
            if let Some(damage) = &damage {
                output::complain(&format!("warning: {}: {damage}; decoding what stands before", name(&self.file)));
            }
            let mut file = Container::open_seek(std::io::Cursor::new(bytes), limits())?;
            return self.decode(&mut file, start);
        }
        self.decode(&mut open_container(&self.file)?, start)
    }

    fn decode<R: std::io::Read + std::io::Seek>(&self, file: &mut Container<R>, start: Instant) -> Result<()> {
        let context = || name(&self.file);
        if let Some(tag) = &self.section {
            let tag = <[u8; 4]>::try_from(tag.as_bytes()).map(Tag).ok().filter(|tag| tag.is_valid());
            let tag = tag.ok_or_else(|| Error::parameter("a section's tag has four letters; tsuya info lists them"))?;
            let content = file.read_section(tag).with_context(context)?;
            return output::write(&self.output, &content, self.force);
        }
        let selection = self.selection(file).with_context(context)?;
        let to_stream = output::is_stream(&self.output);
        if self.mesh_only {
            output::check_free(&self.output, self.force)?;
        } else if to_stream {
            return Err(Error::parameter("only --mesh-only and --section can go to standard output").into());
        } else {
            output::folder(&self.output, self.force)?;
        }
        let asset = {
            let _busy = progress::busy("decoding");
            let options = DecodeOptions { selection, limits: limits() };
            decode_from(file, &options).with_context(context)?
        };
        let seconds = start.elapsed().as_secs_f64();
        if self.mesh_only {
            output::write(&self.output, &ply::write(&asset.mesh), self.force)?;
        } else {
            let _busy = progress::busy("writing");
            Folder { path: &self.output, format: self.format, half: self.half, force: self.force }
                .write(&asset, self.preview)?;
        }
        let decoded = asset.photographs.iter().flatten().count();
        let (read, bytes) = (file.bytes_read(), file.file_bytes());
        if self.json {
            return output::say_json(&json!({
                "views": decoded,
                "views_in_file": asset.views.len(),
                "bytes_read": read,
                "bytes": bytes,
                "decode_seconds": seconds,
                "seconds": start.elapsed().as_secs_f64(),
            }));
        }
        if to_stream {
            return Ok(());
        }
        output::say(&format!(
            "{decoded} of {} views, {read} of {bytes} bytes read, decoded in {seconds:.2} s, written in {:.2} s\n",
            asset.views.len(),
            start.elapsed().as_secs_f64() - seconds
        ))
    }

    fn selection<R: std::io::Read + std::io::Seek>(&self, file: &mut Container<R>) -> tsuya::Result<Selection> {
        if self.mesh_only {
            return Ok(Selection::None);
        }
        if self.views.is_empty() {
            return Ok(Selection::All);
        }
        let budget = file.budget();
        let views = views::decode(&file.read_section(Tag::VIEWS)?, &budget)?.views;
        let wanted: tsuya::Result<Vec<usize>> = self.views.iter().map(|wanted| find_view(wanted, &views)).collect();
        Ok(Selection::Views(wanted?))
    }
}

/// The whole sections of a damaged file, as a file.
fn salvage(path: &Path) -> Result<(Vec<u8>, Option<Error>)> {
    let prefix = read_prefix(std::io::BufReader::new(open(path)?), limits()).with_context(|| name(path))?;
    if prefix.sections.is_empty() {
        let reason = prefix.damage.map_or_else(String::new, |damage| format!(" ({damage})"));
        return Err(Failed(format!("{}: not one section is whole{reason}", name(path))).into());
    }
    let mut writer = Writer::new(Vec::new())?;
    for (section, content) in &prefix.sections {
        writer.section(section.tag, section.codec, content)?;
    }
    Ok((writer.finish()?, prefix.damage))
}

/// Where a decoded capture goes.
struct Folder<'a> {
    path: &'a Path,
    format: Format,
    half: bool,
    force: bool,
}

impl Folder<'_> {
    fn put(&self, name: &str, bytes: &[u8]) -> Result<()> {
        output::write_below(&self.path.join(name), bytes, self.force)
    }

    fn put_picture(&self, name: &str, image: &RgbImage, white: [f64; 3]) -> Result<()> {
        let bytes = match self.format {
            Format::Exr => pictures::exr(image, self.half)?,
            Format::Png16 => pictures::png16(image, white)?,
            Format::Png => pictures::png(&to_display(image, white))?,
        };
        self.put(name, &bytes)
    }

    /// Everything that the asset has. `transforms.json` comes last: where it is, all it names is there.
    fn write(&self, asset: &Asset, preview: bool) -> Result<()> {
        let extension = if self.format == Format::Exr { "exr" } else { "png" };
        let names = view_names(&asset.views);
        self.put("mesh.ply", &ply::write(&asset.mesh))?;
        let white = asset.white.map(|w| w as f32);
        let white_file = format!("white.{extension}");
        self.put_picture(&white_file, &RgbImage::filled(8, 8, white), asset.white)?;
        if let Some(maps) = &asset.reflectance {
            self.put("maps/diffuse.exr", &pictures::exr(&maps.diffuse, self.half)?)?;
            if !maps.specular.data.is_empty() {
                self.put("maps/specular.exr", &pictures::exr(&maps.specular, self.half)?)?;
                self.put("maps/sigma.exr", &pictures::exr_grey(&maps.sigma)?)?;
            }
            if !maps.palette.is_empty() {
                let materials: Vec<NamedMaterial> = maps.palette.iter().map(palette_material).collect();
                self.put("maps/palette.tsuya", &encode_materials(&materials, &Metadata::default())?)?;
            }
        }
        let one = |index: usize| {
            let photograph = asset.photographs[index].as_ref()?;
            Some(self.write_view(asset, &asset.views[index], &names[index], extension, photograph, preview))
        };
        let frames: Result<Vec<Value>> = (0..asset.views.len()).into_par_iter().filter_map(one).collect();
        let frames = frames?;
        let polarised = asset.components.contains(&Component::Diffuse);
        let mut reference = json!({"file_path": white_file});
        if polarised {
            // Decoded diffuse images are divided by the board's ratio already.
            reference["cross_file_path"] = json!(white_file);
        }
        let linear = asset.metadata.get("color_space").and_then(Value::as_str).unwrap_or("linear-rec709");
        let transforms = json!({
            "camera_model": "PINHOLE",
            "mesh_file": "mesh.ply",
            "color_space": if self.format == Format::Exr { linear } else { "srgb" },
            "white_reference": reference,
            "frames": frames,
        });
        let metadata = Value::Object(asset.metadata.clone());
        self.put("metadata.json", format!("{metadata:#}\n").as_bytes())?;
        self.put("transforms.json", format!("{transforms:#}\n").as_bytes())
    }

    fn write_view(
        &self,
        asset: &Asset,
        view: &View,
        name: &str,
        extension: &str,
        photograph: &Photograph,
        preview: bool,
    ) -> Result<Value> {
        let white = asset.white;
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
            let picture = to_display(&sum_of_components(photograph), white);
            self.put(&format!("preview/{name}.png"), &pictures::png(&picture)?)?;
        }
        Ok(frame)
    }
}

/// An entry of a palette as a material, called by the width that it stands for.
fn palette_material(entry: &PaletteEntry) -> NamedMaterial {
    let name = format!("sigma {:.4}", sigma_of_level(entry.level.into()));
    NamedMaterial { name, material: FittedMaterial::Lobes(entry.lobes.clone()) }
}

/// Camera to world with OpenGL's axes (x right, y up, z backward).
fn camera_to_world(view: &View) -> [[f64; 4]; 4] {
    let (rotation, centre) = (&view.camera.rotation, view.camera.centre());
    let row = |i: usize| [rotation[0][i], -rotation[1][i], -rotation[2][i], centre[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Names of views as relative paths without extension: nothing that leads out of the folder or meets another file.
fn view_names(views: &[View]) -> Vec<String> {
    const TAKEN: [&str; 9] =
        ["mask", "diffuse", "specular", "preview", "maps", "white", "mesh", "transforms", "metadata"];
    let mut used = HashSet::new();
    let name = |(index, view): (usize, &View)| {
        let plain = |c: &char| !c.is_control() && !r#":*?"<>|"#.contains(*c);
        let parts: Vec<String> = stem(&view.name)
            .split(['/', '\\'])
            .map(|part| part.chars().filter(plain).collect::<String>())
            .filter(|part| !part.is_empty() && part != "." && part != ".." && part.len() <= 120)
            .collect();
        let mut name = parts.join("/");
        if name.is_empty() || name.len() > 1000 {
            name = format!("view-{index:03}");
        }
        if parts.first().is_some_and(|first| TAKEN.contains(&first.to_lowercase().as_str())) {
            name = format!("photograph/{name}");
        }
        // Some file systems don't tell upper from lower case.
        while !used.insert(name.to_lowercase()) {
            name = format!("{name}-{index:03}");
        }
        name
    };
    views.iter().enumerate().map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder_and_apart() {
        let names = ["off/000.exr", "../../etc/x", "/abs/y.png", "mask/a", "", "OFF/000.png", "..", "C:\\z.jpg", "v.1"];
        let view = |name: &&str| View { name: name.to_string(), camera: Default::default(), light: None };
        let found = view_names(&names.iter().map(view).collect::<Vec<_>>());
        let expected =
            ["off/000", "etc/x", "abs/y", "photograph/mask/a", "view-004", "OFF/000-005", "view-006", "C/z", "v.1"];
        assert_eq!(found, expected);
    }
}
