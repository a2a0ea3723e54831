//! `tsuya gltf`: GLB files that every viewer shows, with the stream inside.

mod written;

use crate::comparison::compare;
use crate::make::Make;
use crate::source::{has_extension, limits, name, read};
use crate::values::{CaptureArguments, OutsideArgument, find_view};
use crate::{Failed, output, pictures, progress};
use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use rayon::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsuya::Asset;
use tsuya::brdf::NamedMaterial;
use tsuya::container;
use tsuya::decoder::{DecodeOptions, ViewSelection, decode};
use tsuya::gltf::{self, ExportOptions, Fallback, GltfDocument, MeshFit, StreamPlacement};
use tsuya::input::{FileAccess, Folder};
use tsuya::metrics::{PhotographError, coverage, to_display};
use tsuya::relight::{AssetRenderer, RenderLayers, RenderLighting, RenderOptions};
use tsuya::{Budget, Error};
use tsuya::{Component, Photograph};
use written::DocumentFiles;

/// Exports to glTF and back: the file's stream travels in the extension TSUYA_materials_appearance, with a material that every viewer shows.
#[derive(Args)]
pub struct Gltf {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Export(Export),
    Import(Import),
    Inject(Inject),
    Extract(Extract),
}

impl Gltf {
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Export(export) => export.run(),
            Command::Import(import) => import.run(),
            Command::Inject(inject) => inject.run(),
            Command::Extract(extract) => extract.run(),
        }
    }
}

/// Makes a GLB, or glTF JSON with its buffer beside it: mesh, textures baked from the fitted reflectance, and the file itself.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya gltf export vase.tsuya -o vase.glb\n",
    "  tsuya gltf export vase.tsuya -o vase.gltf\n",
    "  tsuya gltf export vase.tsuya -o vase.glb --against vase/ --picture compared.png",
))]
pub struct Export {
    /// The .tsuya file; - is standard input.
    file: PathBuf,
    /// The GLB; - is standard output. With a name that ends with .gltf: JSON, buffer (.bin) and stream (.tsuya) beside each other.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Puts the stream beside the document, under its name with .tsuya, instead of inside; always so with .gltf.
    #[arg(long)]
    external: bool,
    /// Diffuse albedo of the capture's white board, to which colours are relative.
    #[arg(long, value_name = "A", default_value_t = 0.95)]
    white_albedo: f64,
    /// Colours as JPEG of this quality instead of PNG.
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// Measures how near the textures come to the photographs of this capture.
    #[arg(long, value_name = "CAPTURE")]
    against: Option<PathBuf>,
    /// With --against: a picture of a view's photograph, and the textured mesh under the same light.
    #[arg(long, value_name = "PNG", requires = "against")]
    picture: Option<PathBuf>,
    /// The view of --picture, by number or name.
    #[arg(long, value_name = "VIEW", default_value = "0")]
    view: String,
    #[command(flatten)]
    reading: CaptureArguments,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Export {
    fn run(self) -> Result<()> {
        let beside = beside(&self.output, self.external || has_extension(&self.output, "gltf"))?;
        let documents = DocumentFiles::of(&self.output, true)?;
        // The file itself may be the one beside the document.
        let written = beside.as_ref().filter(|path| !output::is_same_file(path, &self.file));
        let others = [written, self.picture.as_ref()].into_iter().flatten().map(|path| &**path);
        let outputs: Vec<&Path> = documents.paths().chain(others).collect();
        let capture = self.against.as_ref().map(|capture| self.reading.files(capture)).transpose()?.unwrap_or_default();
        let inputs: Vec<&Path> = capture.iter().map(|path| &**path).chain([&*self.file]).collect();
        output::check_outputs(&outputs, &inputs, self.force)?;
        let stream = read(&self.file)?;
        container::verify(&stream[..], limits()).with_context(|| name(&self.file))?;
        let asset = without_photographs(&self.file, &stream)?;
        if asset.is_modelled() {
            return self.export_modelled(&asset, &documents);
        }
        let options = ExportOptions {
            placement: placement(&beside),
            white_albedo: self.white_albedo,
            jpeg_quality: self.jpeg,
            limits: limits(),
        };
        let exported = gltf::export(&stream, &asset, &options).with_context(|| name(&self.file))?;
        let measured = self.against.as_ref().map(|capture| self.measure(capture, &exported.fallback)).transpose()?;
        let mut files = output::Files::new(self.force);
        if let Some(path) = written {
            files.add(path, &stream)?;
        }
        let bytes = documents.add(&mut files, exported.document)?;
        if let Some((path, picture)) = self.picture.as_ref().zip(measured.as_ref().and_then(|m| m.picture.as_ref())) {
            files.add(path, picture)?;
        }
        files.commit()?;
        let size = &exported.fallback.base_colour;
        if self.json {
            return output::print_json(&json!({
                "bytes": bytes,
                "stream_bytes": stream.len(),
                "stream": beside.as_ref().map(|path| path.display().to_string()),
                "sha256": exported.sha256,
                "levels": exported.levels,
                "vertices": exported.vertices,
                "triangles": exported.triangles,
                "textures": {"width": size.width, "height": size.height},
                "fallback_psnr_db": measured.as_ref().map(|m| m.fallback),
                "model_psnr_db": measured.as_ref().map(|m| m.model),
            }));
        }
        if output::is_stream(&self.output) {
            return Ok(());
        }
        let mut text = format!(
            "{}: {} bytes, {} of them the stream; {} vertices, {} triangles, textures of {} x {} texels\n",
            self.output.display(),
            bytes,
            if beside.is_some() { 0 } else { stream.len() },
            exported.vertices,
            exported.triangles,
            size.width,
            size.height
        );
        if let Some(path) = &beside {
            text += &format!("{}: {} bytes, the stream\n", path.display(), stream.len());
        }
        if let Some(Measured { fallback, model, .. }) = measured {
            let say = |db: Option<f64>| db.map_or_else(|| "none".into(), |db| format!("{db:.2} dB"));
            let (fallback, model) = (say(fallback), say(model));
            text += &format!(
                "image PSNR of the textured mesh: {fallback}; of the reflectance that it was made of: {model}\n"
            );
        }
        output::tell(&text)
    }

    /// Exports materials that are bound to the mesh: numbers, not textures, and no stream.
    fn export_modelled(&self, asset: &Asset, documents: &DocumentFiles) -> Result<()> {
        if self.external || self.jpeg.is_some() || self.against.is_some() {
            let message = "the object was modelled: its GLB has neither a stream nor textures, so that --external, --jpeg and --against have \
                           nothing to act on";
            return Err(Error::parameter(message).into());
        }
        let (document, simplified) = gltf::export_modelled(asset).with_context(|| name(&self.file))?;
        if !simplified.is_empty() {
            let names: Vec<String> = simplified.iter().map(|name| output::line(name)).collect();
            output::warn(&[format!("{}: anisotropic; the GLB has the mean of both widths", names.join(", "))]);
        }
        let (vertices, triangles) = (asset.mesh.positions.len(), asset.mesh.triangles.len());
        let materials = document.list("materials").len();
        let mut files = output::Files::new(self.force);
        let bytes = documents.add(&mut files, document)?;
        files.commit()?;
        if self.json {
            return output::print_json(
                &json!({"bytes": bytes, "vertices": vertices, "triangles": triangles, "materials": materials}),
            );
        }
        if output::is_stream(&self.output) {
            return Ok(());
        }
        output::tell(&format!("{bytes} bytes: {vertices} vertices, {triangles} triangles, {materials} materials\n"))
    }

    /// The textured mesh, and the fitted reflectance, under each photograph's light.
    fn measure(&self, capture: &Path, fallback: &Fallback) -> Result<Measured> {
        if output::is_stream(&self.file) {
            return Err(Error::parameter("--against needs a file, not standard input").into());
        }
        let comparison = compare(&self.file, capture, &self.reading, false)?;
        output::warn(&comparison.warnings);
        let asset = &comparison.asset;
        let shown = find_view(&self.view, &asset.views)?;
        let _busy = progress::busy("comparing");
        let renderer = AssetRenderer::new(asset)?;
        let errors: Vec<([PhotographError; 2], Option<Vec<u8>>)> = (comparison.frames.par_iter())
            .map(|frame| -> Result<_> {
                let view = &asset.views[frame.view];
                let covered = coverage(&asset.mesh, &view.camera);
                let photograph = |image| Photograph { mask: frame.original.mask.clone(), images: vec![image] };
                let original = frame.original.sum();
                let textured = gltf::render_fallback(asset, fallback, &view.camera, view.light.as_ref());
                let mut picture = None;
                if self.picture.is_some() && frame.view == shown {
                    let masked = pictures::masked(&original, &frame.original.mask);
                    let both = [&masked, &textured].map(|image| to_display(image, asset.white));
                    picture = Some(pictures::png(&pictures::beside(&both))?);
                }
                let layers = RenderLayers { residual: false, ..RenderLayers::default() };
                let lighting =
                    view.light.map_or(RenderLighting::Capture(0), |light| RenderLighting::Points(vec![light]));
                let options = RenderOptions { layers, lighting, shadows: false, ..RenderOptions::default() };
                let model = renderer.render(&view.camera, &options)?.image;
                let original = photograph(original);
                let error = |image| {
                    PhotographError::compare(
                        &original,
                        &photograph(image),
                        &[Component::Combined],
                        &covered,
                        asset.white,
                    )
                };
                Ok(([error(textured), error(model)], picture))
            })
            .collect::<Result<_>>()?;
        let [mut fallback, mut model] = [PhotographError::default(); 2];
        let mut picture = None;
        for ([one, two], shown) in errors {
            fallback.merge(&one);
            model.merge(&two);
            picture = picture.or(shown);
        }
        Ok(Measured { fallback: fallback.psnr().sum, model: model.psnr().sum, picture })
    }
}

/// Image PSNR over all photographs.
struct Measured {
    fallback: Option<f64>,
    model: Option<f64>,
    /// One view's photograph and the textured mesh, as PNG.
    picture: Option<Vec<u8>>,
}

/// Makes a .tsuya file of a GLB: byte for byte the one that was exported, checked (whole, undamaged, of this mesh); of any other document its mesh and
/// materials, as tsuya make has them.
#[derive(Args)]
pub struct Import {
    /// The .glb or .gltf file; - is standard input.
    file: PathBuf,
    /// The .tsuya file; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which appearance, where the file has several.
    #[arg(long, value_name = "N", default_value_t = 0)]
    appearance: usize,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
}

impl Import {
    fn run(self) -> Result<()> {
        output::check_outputs(&[&self.output], &[&self.file], self.force)?;
        let bytes = read(&self.file)?;
        let document = parse(&self.file, &bytes, self.outside.allow_outside)?;
        let has_none = gltf::appearances(&document)?.is_empty() && !gltf::has_lost_appearance(&document);
        if has_none && self.appearance == 0 {
            drop(document);
            return Make::of_document(self.file, self.output, self.outside, self.force).make(bytes);
        }
        let access = self.outside.access();
        let files = |name: &str| beside_document(&self.file, name, &access);
        let taken = gltf::extract(&document, self.appearance, &files)?;
        let of_stream = || format!("{}: the stream of appearance {}", name(&self.file), self.appearance);
        container::verify(&taken.stream[..], limits()).with_context(of_stream)?;
        let asset = decode(&taken.stream, &lightly()).with_context(of_stream)?;
        check_mesh(&document, &taken.materials, &taken.binding, &asset, &files)?;
        output::write(&self.output, &taken.stream, self.force)
    }
}

/// Puts a .tsuya file into a GLB that another program changed or made anew.
#[derive(Args)]
pub struct Inject {
    /// The .glb or .gltf file.
    file: PathBuf,
    /// The .tsuya file.
    stream: PathBuf,
    /// The new .glb or .gltf file.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The material that shows it, by name or number [default: the one that says so in its extras, or the only one].
    #[arg(long, value_name = "MATERIAL")]
    material: Option<String>,
    /// Puts the stream beside the new file, under its name with .tsuya; always so with .gltf.
    #[arg(long)]
    external: bool,
    /// Does not ask whether the mesh is the one that was captured.
    #[arg(long)]
    any_mesh: bool,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
}

impl Inject {
    fn run(self) -> Result<()> {
        let mut document = document(&self.file, self.outside)?;
        let stream = read(&self.stream)?;
        container::verify(&stream[..], limits()).with_context(|| name(&self.stream))?;
        let asset = without_photographs(&self.stream, &stream)?;
        let is_json = !document.is_glb() || has_extension(&self.output, "gltf");
        let beside = beside(&self.output, self.external || is_json)?;
        let documents = DocumentFiles::of(&self.output, document.is_glb())?;
        let written = beside.as_ref().filter(|path| !output::is_same_file(path, &self.stream));
        // The document may be changed in its place.
        let outputs: Vec<&Path> = documents.paths().chain(written.map(|path| &**path)).collect();
        output::check_outputs(&outputs, &[&self.stream], self.force)?;
        let material = gltf::find_material(&document, &gltf::sha256(&stream), self.material.as_deref())
            .with_context(|| name(&self.file))?;
        let levels = gltf::prefix_lengths(&stream, limits()).with_context(|| name(&self.stream))?;
        let uri = match placement(&beside) {
            StreamPlacement::Inside => None,
            StreamPlacement::Beside(name) => Some(gltf::reference(&name)),
        };
        let binding = gltf::inject(&mut document, material, &stream, levels, uri.as_deref())?.1;
        if !self.any_mesh {
            let access = self.outside.access();
            let files = |name: &str| beside_document(&self.file, name, &access);
            check_mesh(&document, &[material], &binding, &asset, &files)?;
        }
        let mut files = output::Files::new(self.force);
        if let Some(path) = written {
            files.add(path, &stream)?;
        }
        documents.add(&mut files, document)?;
        files.commit()
    }
}

/// Takes a .tsuya file out of a GLB as it is; only its length and SHA-256 are compared.
#[derive(Args)]
pub struct Extract {
    /// The .glb or .gltf file; - is standard input.
    file: PathBuf,
    /// The .tsuya file; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which appearance, where the file has several.
    #[arg(long, value_name = "N", default_value_t = 0)]
    appearance: usize,
    /// Also writes the document without the extension.
    #[arg(long, value_name = "FILE")]
    rest: Option<PathBuf>,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites existing files.
    #[arg(long)]
    force: bool,
}

impl Extract {
    fn run(self) -> Result<()> {
        let mut document = document(&self.file, self.outside)?;
        let rest = self.rest.as_ref().map(|path| DocumentFiles::of(path, document.is_glb())).transpose()?;
        let outputs: Vec<&Path> =
            [&*self.output].into_iter().chain(rest.iter().flat_map(|rest| rest.paths())).collect();
        output::check_outputs(&outputs, &[&self.file], self.force)?;
        let access = self.outside.access();
        let taken = gltf::extract(&document, self.appearance, &|name| beside_document(&self.file, name, &access))?;
        let mut files = output::Files::new(self.force);
        files.add(&self.output, &taken.stream)?;
        if let Some(rest) = &rest {
            gltf::strip(&mut document)?;
            rest.add(&mut files, document)?;
        }
        files.commit()
    }
}

/// An error where the stream is another mesh's; a warning where that can't be said.
fn check_mesh(
    document: &GltfDocument,
    materials: &[usize],
    binding: &gltf::MaterialBinding,
    asset: &Asset,
    files: gltf::ExternalFiles<'_>,
) -> Result<()> {
    let Some(charts) = &asset.charts else {
        return Err(Error::Unsupported("the stream has no atlas, so that no glTF mesh can show it".into()).into());
    };
    let budget = Budget::new(limits());
    match gltf::compare_mesh(document, materials, binding, &asset.mesh, charts, files, &budget)? {
        MeshFit::Same(_) => Ok(()),
        MeshFit::Unknown => {
            output::eprint_line("warning: the mesh is compressed or has no texture coordinates: not compared with the stream's");
            Ok(())
        }
        MeshFit::Other(share) => Err(Failed(format!(
            "the stream was captured with another mesh: at the texture coordinates of this one its surface lies elsewhere \
             (off by {:.0} % of its size)",
            100.0 * share
        ))
        .into()),
    }
}

fn lightly() -> DecodeOptions {
    DecodeOptions { selection: ViewSelection::None, limits: limits(), ..Default::default() }
}

fn without_photographs(path: &Path, stream: &[u8]) -> Result<Asset> {
    decode(stream, &lightly()).with_context(|| name(path))
}

/// The materials of a document that was modelled, from its file's bytes.
pub fn own_materials(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<Vec<NamedMaterial>> {
    let document = parse(path, bytes, access.allows_outside())?;
    Ok(gltf::document_materials(&document, &|name| beside_document(path, name, access), access)?)
}

fn document(path: &Path, outside: OutsideArgument) -> Result<GltfDocument> {
    parse(path, &read(path)?, outside.allow_outside)
}

fn parse(path: &Path, bytes: &[u8], allow_outside: bool) -> Result<GltfDocument> {
    let document = GltfDocument::parse(path, bytes, &Budget::new(limits()))?;
    Ok(document.allow_outside(allow_outside))
}

/// What a document's references lead to. It stays charged, so that what is referred to again and again is read no more than memory lasts.
fn beside_document(document: &Path, name: &str, access: &FileAccess) -> tsuya::Result<Vec<u8>> {
    if output::is_stream(document) {
        return Err(Error::parameter(format!(
            "the document refers to {name:?}: read it from its folder, not from standard input"
        )));
    }
    let path = Folder::containing(document, access.allows_outside()).resolve(name)?;
    Ok(access.read_bytes(&path, "referenced file", u64::MAX)?.keep())
}

/// The file beside a document that holds its stream.
fn beside(document: &Path, external: bool) -> Result<Option<PathBuf>> {
    if !external {
        return Ok(None);
    }
    let path = document.with_extension("tsuya");
    let is_name = path.file_name().is_some_and(|name| name.to_str().is_some());
    if output::is_stream(document) || !is_name || path == document {
        return Err(Error::parameter("a stream beside the document needs a document with a name, .glb or .gltf").into());
    }
    Ok(Some(path))
}

fn placement(beside: &Option<PathBuf>) -> StreamPlacement {
    let name = beside.as_ref().and_then(|path| path.file_name()).and_then(|name| name.to_str());
    name.map_or(StreamPlacement::Inside, |name| StreamPlacement::Beside(name.into()))
}
