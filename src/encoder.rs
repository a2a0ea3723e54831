//! From a capture to a file: the stages in the order of the data's way. [`crate::decoder`] runs them backwards.

use crate::brdf::binding::{self, TriangleBinding};
use crate::brdf::materials::{self, NamedMaterial};
use crate::capture::OpenCapture;
use crate::container::metadata::{AchievedError, Metadata};
use crate::container::{ContainerWriter, SectionCodec, Tag, metadata, thumbnail, write_file};
use crate::error::{Error, Result};
use crate::illumination::{self, AssumedLight, EnvironmentEstimate, LightSources};
use crate::limits::{Budget, Limits};
use crate::mesh::codec::MeshOptions;
use crate::mesh::{EncodedMesh, Mesh};
use crate::metrics::{Distortion, ImagePsnr, to_display};
use crate::options::{CaptureLight, EncodeOptions, Profile};
use crate::rate::{self, CodedView};
use crate::reflectance::stage::ReflectanceSurface;
use crate::separate::{FramesToCode, MaskedPhotographs, SeparatedFrames};
pub use crate::separate::{Observations, ObservedView, recombine, separate};
use crate::surface::{atlas, raster};
use crate::views::codec::ViewsSection;
use crate::views::{Camera, Component, View};
pub use crate::wavelet_texture::WaveletSampleError;
use crate::{mesh, predictive, refine, views, wavelet_texture};

mod check;

/// A finished file and figures about it.
#[derive(Debug)]
pub struct EncodedFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// Each section's four letters and bytes in the file, in file order.
    pub sections: Vec<(String, u64)>,
    /// Image PSNR of the coded views, as a decoder will reach it.
    pub image_psnr: ImagePsnr,
    /// PSNR on surface samples, per component: linear and sqrt. Profile `wavelet-texture` only.
    pub sample_psnr: Option<Vec<(Component, WaveletSampleError)>>,
    /// Coefficients kept, per cent. Profile `wavelet-texture` only.
    pub kept_percent: Option<f64>,
    /// Share of the masks' pixels that the mesh covers, 0 to 1.
    pub coverage: f64,
    /// Bytes of memory within which the file was decoded again, if it was checked: the default of readers if that suffices.
    pub reader_memory: Option<u64>,
    /// Light that was taken for that of the photographs, where [`EncodeOptions::light`] asks for it.
    pub assumed_light: Option<AssumedLight>,
    /// Non-fatal problems found while encoding, one sentence each.
    pub warnings: Vec<String>,
}

/// Encodes a capture, in memory or open. Of an open one the photographs in use are in memory, and few of those that others are predicted from,
/// however many there are.
/// # Errors
/// [`Error::Parameter`] if an option is out of its range, the capture has no pixel of the object or the target can't be
/// reached; [`Error::Check`] if the finished file is not decoded to what was encoded; those of reading photographs.
pub fn encode(capture: impl Into<OpenCapture>, options: &EncodeOptions) -> Result<EncodedFile> {
    encode_open(capture.into(), options)
}

fn encode_open(mut capture: OpenCapture, options: &EncodeOptions) -> Result<EncodedFile> {
    let mut warnings = std::mem::take(&mut capture.warnings);
    options.light.as_ref().map_or(Ok(()), illumination::check)?;
    if matches!(options.light, Some(CaptureLight::Environment { .. })) && options.profile == Profile::WaveletTexture {
        return Err(Error::parameter("option `light`: an environment is estimated in profile `predictive` only"));
    }
    if options.position_bits.is_some_and(|bits| !(8..=20).contains(&bits)) {
        return Err(Error::parameter("option `position_bits` goes from 8 to 20"));
    }
    // 1. Photographs as components of reflection.
    let frames = SeparatedFrames::new(&capture, options.hold_out)?;
    // 2. Mesh: ordered and quantised. All later stages work with the mesh and the views that the decoder will have.
    let mut captured = frames.views();
    let cameras: Vec<Camera> = captured.iter().map(|view| view.camera).collect();
    let position_bits = options.position_bits.unwrap_or_else(|| atlas::position_bits(&capture.mesh, &cameras));
    let coded_mesh = mesh::codec::encode(&capture.mesh, &MeshOptions { position_bits })?;
    let mesh = coded_mesh.mesh;
    // 3. Views: cameras and lights, which may have to be found first, on lattices.
    let assumed = match &options.light {
        Some(light) => Some(assume_light(light, &capture, &mesh, &frames, &mut captured, &mut warnings)?),
        None => None,
    };
    let (assumed_light, environment) = assumed.map_or((None, None), |(light, environment)| (Some(light), environment));
    let described = ViewsSection { white: capture.white, components: frames.components.clone(), views: captured };
    let views_bytes = views::codec::encode(&described, &mesh.positions)?;
    let views = views::codec::decode(&views_bytes, &Budget::new(Limits::UNLIMITED))?;
    // 4. The surface, as far as the photographs show more of it than the mesh does.
    let refined = refine::refined_surface(&mesh, &described.views, &frames, options, &mut warnings)?;
    // 5. Pixels to code.
    let covered = raster::coverage_runs(&mesh, &views.views);
    let photographs = FramesToCode { frames: &frames, covered: &covered };
    // 6. Photographs at the quality that reaches the target.
    let mut sections = vec![(Tag::MESH, coded_mesh.bytes), (Tag::VIEWS, views_bytes)];
    let source = MaskedPhotographs {
        mesh: &mesh,
        views: &views.views,
        components: &views.components,
        white: views.white,
        covered: &covered,
        photographs: &photographs,
    };
    let light_section = environment.as_ref().map(|environment| &environment.section);
    let other = other_bytes(sections.iter().map(|(_, bytes)| bytes).chain(light_section));
    let (coded, figures) = match options.profile {
        Profile::Predictive => {
            let displacements = refined
                .as_ref()
                .map(|surface| surface.displacements(rate::expected_step(options.target, samples(&views))));
            let irradiance = environment.as_ref().map(|environment| &environment.irradiance[..]);
            let surface = ReflectanceSurface { displacements: displacements.as_ref(), irradiance };
            (predictive::encode_to_target(&source, other, &surface, options, &mut warnings)?, None)
        }
        Profile::WaveletTexture => {
            let (coded, figures) = wavelet_texture::encode_to_target(&source, other, options, &mut warnings)?;
            (coded, Some(figures))
        }
    };
    sections.extend(coded.sections);
    sections.extend(environment.map(|environment| (Tag::LIGHT, environment.section)));
    // 7. Container.
    let metadata = describe(&capture, options, &coded.distortion, assumed_light.as_ref());
    let (bytes, sections) = write_file(&metadata, &thumbnail_png(&coded.views, views.white)?, &sections)?;
    // The finished file, read back.
    let reader_memory = match options.check {
        true => Some(check::check(&bytes, &coded.views, &mut warnings)?),
        false => None,
    };
    let (image_psnr, coverage) = (coded.distortion.error.psnr(), coded.distortion.error.coverage());
    let (sample_psnr, kept_percent) = figures.map(|f| (f.sample_psnr, f.kept_percent)).unzip();
    Ok(EncodedFile {
        bytes,
        sections,
        image_psnr,
        sample_psnr,
        kept_percent,
        coverage,
        reader_memory,
        assumed_light,
        warnings,
    })
}

/// Samples of the photographs that views show: pixels of each component.
fn samples(section: &ViewsSection) -> u64 {
    let pixels = section.views.iter().map(|view| u64::from(view.camera.width) * u64::from(view.camera.height));
    section.components.len() as u64 * pixels.sum::<u64>()
}

/// Finds what is not known of the photographs' light, and gives it to the views.
fn assume_light(
    light: &CaptureLight,
    capture: &OpenCapture,
    mesh: &Mesh,
    frames: &SeparatedFrames,
    views: &mut [View],
    warnings: &mut Vec<String>,
) -> Result<(AssumedLight, Option<EnvironmentEstimate>)> {
    let covered = raster::coverage_runs(mesh, views);
    let photographs = FramesToCode { frames, covered: &covered };
    let components = &frames.components[..];
    let sources = LightSources { mesh, views, components, photographs: &photographs, origin: capture.origin };
    let (found, environment) = illumination::assume(light, &sources, warnings)?;
    found.apply(views, capture.origin);
    Ok((found, environment))
}

/// Writes a file of nothing but materials and metadata.
/// # Errors
/// [`Error::Parameter`] if a name is empty, too long or given twice.
pub fn encode_materials(materials: &[NamedMaterial], metadata: &Metadata) -> Result<Vec<u8>> {
    let mut described = metadata.clone();
    described.set_generator(GENERATOR);
    let mut writer = ContainerWriter::new(Vec::new())?;
    writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(&described)?)?;
    writer.write_section(Tag::MATERIALS, SectionCodec::Own, &materials::encode_materials(materials)?)?;
    writer.finish()
}

/// Writes a file of an object that was modelled: its mesh, what its triangles are made of, and the coded texture coordinates, if it has any.
/// `binding` is in the order of the coded mesh's triangles.
/// # Errors
/// [`Error::Parameter`] if a name is empty, too long or given twice, the binding is another mesh's, or names a material that is not given.
pub fn encode_modelled(
    mesh: &EncodedMesh,
    materials: &[NamedMaterial],
    binding: &TriangleBinding,
    coordinates: Option<&[u8]>,
    metadata: &Metadata,
) -> Result<Vec<u8>> {
    if binding.of_triangle.len() != mesh.mesh.triangles.len() {
        return Err(Error::parameter("a binding has a material for each triangle of its mesh"));
    }
    if let Some(name) = binding.names.iter().find(|name| materials.iter().all(|named| named.name != **name)) {
        return Err(Error::parameter(format!("triangles are bound to material '{name}', which is not given")));
    }
    let mut described = metadata.clone();
    described.set_generator(GENERATOR);
    let mut writer = ContainerWriter::new(Vec::new())?;
    writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(&described)?)?;
    writer.write_section(Tag::MESH, SectionCodec::Own, &mesh.bytes)?;
    writer.write_section(Tag::MATERIALS, SectionCodec::Own, &materials::encode_materials(materials)?)?;
    writer.write_section(Tag::BINDING, SectionCodec::Own, &binding::encode_binding(binding)?)?;
    if let Some(coordinates) = coordinates {
        writer.write_section(Tag::COORDINATES, SectionCodec::Own, coordinates)?;
    }
    writer.finish()
}

/// Metadata key `generator`.
const GENERATOR: &str = concat!("tsuya ", env!("CARGO_PKG_VERSION"));

/// Bytes of a file with these sections, of the container and of the metadata, about.
fn other_bytes<'a>(sections: impl Iterator<Item = &'a Vec<u8>>) -> u64 {
    sections.map(|bytes| bytes.len() as u64 + 48).sum::<u64>() + 4096
}

fn describe(
    capture: &OpenCapture,
    options: &EncodeOptions,
    distortion: &Distortion,
    assumed_light: Option<&AssumedLight>,
) -> Metadata {
    let mut described = Metadata(options.metadata.clone());
    if let Some(Ok(light)) = assumed_light.map(serde_json::to_value) {
        described.0.insert("assumed_light".into(), light);
    }
    if !capture.name.is_empty() {
        described.0.entry("title").or_insert_with(|| capture.name.clone().into());
    }
    described.set_color_space(capture.color_space.clone());
    described.set_generator(GENERATOR);
    let psnr = distortion.error.psnr();
    let round = |db: Option<f64>| db.map(|db| (db * 100.0).round() / 100.0);
    described.set_achieved_error(AchievedError {
        diffuse_psnr_db: round(psnr.diffuse),
        specular_psnr_db: round(psnr.specular),
        sum_psnr_db: round(psnr.sum),
        ..Default::default()
    });
    described
}

/// The first photograph that shows the object, as a small PNG file.
fn thumbnail_png(views: &[CodedView], white: [f64; 3]) -> Result<Vec<u8>> {
    let Some(shown) = views.iter().find_map(|view| view.thumbnail.as_ref()) else {
        return Err(Error::parameter("no view shows the object"));
    };
    thumbnail::write_png(&to_display(shown, white))
}
