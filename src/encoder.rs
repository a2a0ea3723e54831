//! From a capture to a file: the stages in the order of the data's way. [`crate::decoder`] runs them backwards.

use crate::brdf::materials::{self, NamedMaterial};
use crate::capture::Capture;
use crate::container::{ContainerWriter, SectionCodec, Tag, metadata, thumbnail};
use crate::error::{Error, Result};
use crate::image::{Mask, RgbImage};
use crate::limits::{Budget, Limits};
use crate::metrics;
use crate::metrics::{ImagePsnr, PhotographError};
use crate::options::{EncodeOptions, EncodeTarget, Profile};
use crate::reflectance::{codec as reflectance_code, gather, maps};
pub use crate::separate::{Observations, ObservedView, recombine, separate};
use crate::surface::{atlas, charts, raster};
use crate::views::codec;
use crate::views::codec::ViewsSection;
use crate::views::{Component, Photograph, View};
use crate::{mesh, predictive, rate, wavelet_texture};

mod check;

/// A finished file and what is known of it.
#[derive(Debug)]
pub struct EncodedFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// Each section's four letters and bytes in the file, in file order.
    pub sections: Vec<(String, u64)>,
    /// Image PSNR of the coded views, as a decoder will reach it.
    pub image_psnr: ImagePsnr,
    /// PSNR on surface samples, per component: linear and sqrt. Profile `paper` only.
    pub sample_psnr: Option<Vec<(Component, wavelet_texture::WaveletSampleError)>>,
    /// Coefficients kept, per cent. Profile `paper` only.
    pub kept_percent: Option<f64>,
    /// Share of the masks' pixels that the mesh covers.
    pub coverage: f64,
    /// Bytes of memory within which the file was decoded again, where it was checked: what readers grant by default if that suffices.
    pub reader_memory: Option<u64>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Encodes a capture.
pub fn encode(mut capture: Capture, options: &EncodeOptions) -> Result<EncodedFile> {
    let mut warnings = std::mem::take(&mut capture.warnings);
    // 1. Separate: photographs to components of reflection.
    let mut observations = separate(&mut capture)?;
    hold_out(&mut observations, options)?;
    // 2. Mesh: order and quantise. All later stages see the mesh and the views that the decoder will see.
    let position_bits = options.position_bits.unwrap_or_else(|| position_bits(&capture, &observations));
    let coded_mesh = mesh::codec::encode(&capture.mesh, &mesh::codec::MeshOptions { position_bits })?;
    let mesh = coded_mesh.mesh;
    let (views_bytes, section) = code_views(&observations, &mesh)?;
    let (views, components) = (&section.views, &section.components);
    // 3. Surface: which pixels show the object.
    let covered = raster::coverage(&mesh, views);
    let photographs = photographs(std::mem::take(&mut observations.views), &covered, &mut warnings)?;
    let judge = DistortionMeter { originals: &photographs, covered: &covered, section: &section };
    // 4. Reflectance: fit on an atlas, code as images.
    let mut file = SectionList::default();
    file.push(Tag::MESH, SectionCodec::Own, coded_mesh.bytes);
    file.push(Tag::VIEWS, SectionCodec::Own, views_bytes);
    // 5. Residual: what the profile makes of the photographs, at the quality that the target asks for.
    let (decoded, total, sample_psnr, kept_percent) = match options.profile {
        Profile::Predictive => {
            let maps = ReflectanceStage::new(&mesh, views, components, &photographs, options)?;
            let signed = options.signed_specular;
            let encoder = predictive::encode::PlaneEncoder::new(
                &mesh,
                views,
                section.white,
                components,
                &photographs,
                &covered,
                signed,
            );
            let outcome = rate::search_step(options.target.unwrap_or(EncodeTarget::Quality(75.0)), |step| {
                let quality =
                    predictive::encode::PlaneQuality { step, decode_speed: options.decode_speed, ..Default::default() };
                let planes = encoder.encode(&quality)?;
                let reflectance = maps.code(step)?;
                let bytes =
                    file.bytes() + maps.chart_bytes.len() as u64 + (reflectance.len() + planes.bytes.len()) as u64;
                let (measured, total) = judge.measure(&planes.photographs);
                Ok(rate::Candidate { distortion: measured, bytes, content: (planes, reflectance, total) })
            })?;
            let (planes, reflectance, total) = outcome;
            file.push(Tag::CHARTS, SectionCodec::Own, maps.chart_bytes);
            file.push(Tag::REFLECTANCE, SectionCodec::Own, reflectance);
            file.push(Tag::PLANES, SectionCodec::Own, planes.bytes);
            (planes.photographs, total, None, None)
        }
        Profile::WaveletTexture => {
            let frames: Vec<wavelet_texture::PosedPhotograph> = (views.iter().zip(&photographs))
                .map(|(view, taken)| wavelet_texture::PosedPhotograph {
                    view,
                    mask: Some(&taken.mask),
                    images: &taken.images,
                })
                .collect();
            let samples = wavelet_texture::WaveletSamples::gather(&mesh, &frames, PATCH_DENSITY);
            let model = wavelet_texture::encode::fit_model(&samples, components);
            let outcome =
                rate::search_keep_percent(options.target.unwrap_or(EncodeTarget::KeepPercent(5.0)), |keep_percent| {
                    let settings = wavelet_texture::WaveletOptions { keep_percent, ..Default::default() };
                    let encoded = wavelet_texture::encode(&samples, components, Some(&model), &settings)?;
                    let decoded = wavelet_texture::decode(
                        &encoded.bytes,
                        &mesh,
                        components,
                        views.len(),
                        &Budget::new(Limits::UNLIMITED),
                    )?;
                    let photographs = crate::wavelet_texture::decode::photographs(&decoded, &mesh, views, |_| true);
                    let photographs: Vec<Photograph> = photographs.into_iter().flatten().collect();
                    let (measured, total) = judge.measure(&photographs);
                    let bytes = file.bytes() + encoded.bytes.len() as u64;
                    let errors = wavelet_texture::encode::sample_errors(&samples, &decoded, section.white);
                    Ok(rate::Candidate { distortion: measured, bytes, content: (encoded, errors, photographs, total) })
                })?;
            let (encoded, errors, decoded, total) = outcome;
            let kept = encoded.kept_percent();
            file.push(Tag::WAVELET_TEXTURE, SectionCodec::Own, encoded.bytes);
            (decoded, total, Some(components.iter().copied().zip(errors).collect()), Some(kept))
        }
    };
    // 6. Container.
    let thumbnail = thumbnail_png(&decoded, section.white)?;
    let metadata = describe(&capture, options, &total);
    let (bytes, sections) = file.write(&metadata, &thumbnail)?;
    // Back again.
    let reader_memory = match options.check {
        true => Some(check::check(&bytes, &decoded, &mut warnings)?),
        false => None,
    };
    let (image_psnr, coverage) = (total.psnr(), total.coverage());
    Ok(EncodedFile { bytes, sections, image_psnr, sample_psnr, kept_percent, coverage, reader_memory, warnings })
}

/// A file of nothing but materials and metadata.
/// # Errors
/// [`Error::Parameter`] where a name is empty, too long or there twice.
pub fn encode_materials(materials: &[NamedMaterial], metadata: &metadata::Metadata) -> Result<Vec<u8>> {
    let mut described = metadata.clone();
    described.0.insert("generator".into(), concat!("tsuya ", env!("CARGO_PKG_VERSION")).into());
    let mut writer = ContainerWriter::new(Vec::new())?;
    writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(&described)?)?;
    writer.write_section(Tag::MATERIALS, SectionCodec::Own, &materials::encode_materials(materials)?)?;
    writer.finish()
}

/// Samples of a patch for one pixel of the photographs.
const PATCH_DENSITY: f64 = 1.0;
/// Longest side of the thumbnail in pixels.
const THUMBNAIL_SIDE: usize = 48;

fn hold_out(observations: &mut Observations, options: &EncodeOptions) -> Result<()> {
    let Some(every) = options.hold_out else { return Ok(()) };
    if every < 2 {
        return Err(Error::parameter("--hold-out takes 2 or more: every k-th view is left out"));
    }
    let mut index = 0;
    observations.views.retain(|_| {
        index += 1;
        index % every != 0
    });
    Ok(())
}

/// Bits that move no vertex by more than an eighth of a pixel in the view that shows the object largest.
fn position_bits(capture: &Capture, observations: &Observations) -> u8 {
    let per_pixel = atlas::texels_per_unit(
        &capture.mesh,
        &observations.views.iter().map(|f| f.view.camera).collect::<Vec<_>>(),
        1.0,
    );
    let (_, radius) = capture.mesh.bounding_sphere();
    let steps = 8.0 * 2.0 * radius * per_pixel;
    (steps.log2().ceil().clamp(8.0, 20.0)) as u8
}

fn code_views(observations: &Observations, mesh: &crate::mesh::Mesh) -> Result<(Vec<u8>, ViewsSection)> {
    let section = ViewsSection {
        white: observations.white,
        components: observations.components.clone(),
        views: observations.views.iter().map(|f| f.view.clone()).collect(),
    };
    let bytes = codec::encode(&section, &mesh.positions)?;
    let decoded = codec::decode(&bytes, &Budget::new(Limits::UNLIMITED))?;
    Ok((bytes, decoded))
}

/// The pixels to code: the mask (all that the mesh covers where there is none) without missing ones, whose values become 0.
fn photographs(frames: Vec<ObservedView>, covered: &[Mask], warnings: &mut Vec<String>) -> Result<Vec<Photograph>> {
    let mut empty = 0;
    let photographs: Vec<Photograph> = frames
        .into_iter()
        .zip(covered)
        .map(|(mut frame, covered)| {
            let mut mask = frame.mask.take().unwrap_or_else(|| covered.clone());
            for (at, inside) in mask.data.iter_mut().enumerate() {
                if frame.images.iter().any(|image| image.data[at].iter().any(|v| !v.is_finite())) {
                    *inside = false;
                    frame.images.iter_mut().for_each(|image| image.data[at] = [0.0; 3]);
                }
            }
            empty += (mask.count() == 0) as usize;
            Photograph { mask, images: frame.images }
        })
        .collect();
    if empty == photographs.len() {
        return Err(Error::parameter(
            "no photograph shows a pixel of the object: check masks, mesh position and missing (NaN) pixels",
        ));
    }
    if empty > 0 {
        warnings.push(format!("{empty} views show no pixel of the object"));
    }
    Ok(photographs)
}

/// Compares decoded photographs with the captured ones.
struct DistortionMeter<'a> {
    originals: &'a [Photograph],
    covered: &'a [Mask],
    section: &'a ViewsSection,
}

impl DistortionMeter<'_> {
    fn measure(&self, decoded: &[Photograph]) -> (rate::Distortion, PhotographError) {
        let mut total = PhotographError::default();
        for ((original, decoded), covered) in self.originals.iter().zip(decoded).zip(self.covered) {
            total.merge(&PhotographError::compare(
                original,
                decoded,
                &self.section.components,
                covered,
                self.section.white,
            ));
        }
        let psnr_db = total.psnr().sum.unwrap_or(f64::INFINITY);
        (rate::Distortion { psnr_db, largest_error: self.largest_error(decoded) }, total)
    }
    /// Largest difference of a component's signal.
    fn largest_error(&self, decoded: &[Photograph]) -> f64 {
        let white = self.section.white;
        let mut largest = 0.0f64;
        for ((original, decoded), covered) in self.originals.iter().zip(decoded).zip(self.covered) {
            for (wanted, got) in original.images.iter().zip(&decoded.images) {
                for at in (0..covered.data.len()).filter(|&at| covered.data[at] && original.mask.data[at]) {
                    for c in 0..3 {
                        let [wanted, got] = [wanted, got].map(|image| metrics::signal(image.data[at][c], white[c]));
                        largest = largest.max((wanted - got).abs());
                    }
                }
            }
        }
        largest
    }
}

/// Fitted maps, coded anew for each trial of the rate control.
struct ReflectanceStage<'a> {
    mesh: &'a crate::mesh::Mesh,
    charts: crate::surface::charts::Charts,
    chart_bytes: Vec<u8>,
    maps: crate::reflectance::maps::ReflectanceMaps,
}

impl<'a> ReflectanceStage<'a> {
    fn new(
        mesh: &'a crate::mesh::Mesh,
        views: &[View],
        components: &[Component],
        photographs: &[Photograph],
        options: &EncodeOptions,
    ) -> Result<Self> {
        let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
        let density = atlas::texels_per_unit(mesh, &cameras, options.atlas_density);
        // More than a few texels for a pixel of all photographs together say nothing.
        let pixels: f64 = cameras.iter().map(|camera| f64::from(camera.width) * f64::from(camera.height)).sum();
        let per_pixel = 4.0 + 16.0 * options.atlas_density.powi(2);
        let charts = atlas::layout_within(mesh, density, (1 << 20) as f64 + per_pixel * pixels)?;
        let chart_bytes = charts::encode(mesh, &charts)?;
        let raster = atlas::rasterise_atlas(mesh, &charts)?;
        let photographs = photographs.iter().map(Some).collect();
        let sources = gather::ReflectanceSources { mesh, views, components, photographs, specular: options.specular };
        let maps = gather::fit_maps(&sources, &charts, &raster);
        Ok(ReflectanceStage { mesh, charts, chart_bytes, maps })
    }
    /// The maps carry the look between captured views; they are coded a little coarser than the photographs.
    fn code(&self, step: f32) -> Result<Vec<u8>> {
        let relative = (step * 2.0).clamp(0.08, 0.25);
        let colour = relative * maps::COLOUR_LEVELS as f32;
        let sigma = 2.0 * relative * crate::reflectance::torrance_sparrow::SIGMA_LEVELS as f32;
        let steps = reflectance_code::MapSteps { diffuse: 0.5 * colour, specular: colour, sigma };
        Ok(reflectance_code::encode(&self.maps, self.mesh, &self.charts, &steps, MAP_LAMBDA)?.0)
    }
}

/// Value of a bit of the reflectance maps, in squared steps.
const MAP_LAMBDA: f32 = 0.15;

/// Sections in file order.
#[derive(Default)]
struct SectionList(Vec<(Tag, SectionCodec, Vec<u8>)>);

impl SectionList {
    fn push(&mut self, tag: Tag, codec: SectionCodec, bytes: Vec<u8>) {
        self.0.push((tag, codec, bytes));
    }
    /// Bytes so far, with what the container and the metadata add.
    fn bytes(&self) -> u64 {
        self.0.iter().map(|s| s.2.len() as u64 + 48).sum::<u64>() + 4096
    }
    fn write(self, metadata: &metadata::Metadata, thumbnail: &[u8]) -> Result<(Vec<u8>, Vec<(String, u64)>)> {
        let mut writer = ContainerWriter::new(Vec::new())?;
        writer.write_section(Tag::METADATA, SectionCodec::Zstd, &metadata::encode(metadata)?)?;
        writer.write_section(Tag::THUMBNAIL, SectionCodec::None, &thumbnail::encode_thumbnail(thumbnail)?)?;
        for (tag, codec, bytes) in &self.0 {
            writer.write_section(*tag, *codec, bytes)?;
        }
        let sections = writer.sections().iter().map(|s| (s.tag.to_string(), s.stored)).collect();
        Ok((writer.finish()?, sections))
    }
}

fn describe(capture: &Capture, options: &EncodeOptions, total: &PhotographError) -> metadata::Metadata {
    let mut described = metadata::Metadata(options.metadata.clone());
    if !capture.name.is_empty() {
        described.0.entry("title").or_insert_with(|| capture.name.clone().into());
    }
    described.0.insert("color_space".into(), capture.color_space.clone().into());
    described.0.insert("generator".into(), concat!("tsuya ", env!("CARGO_PKG_VERSION")).into());
    let psnr = total.psnr();
    let round = |db: Option<f64>| db.map(|db| (db * 100.0).round() / 100.0);
    described.set_achieved_error(metadata::AchievedError {
        diffuse_psnr_db: round(psnr.diffuse),
        specular_psnr_db: round(psnr.specular),
        sum_psnr_db: round(psnr.sum),
        ..Default::default()
    });
    described
}

/// The first view's decoded photograph, made small.
fn thumbnail_png(photographs: &[Photograph], white: [f64; 3]) -> Result<Vec<u8>> {
    let Some(first) = photographs.iter().find(|p| p.mask.count() > 0) else {
        return Err(Error::parameter("no view shows the object"));
    };
    let sum = sum_of_components(first);
    let scale = sum.width.max(sum.height).div_ceil(THUMBNAIL_SIDE).max(1);
    let (width, height) = ((sum.width / scale).max(1), (sum.height / scale).max(1));
    let mut small = RgbImage::filled(width, height, [0.0; 3]);
    for y in 0..height {
        for x in 0..width {
            let mut mean = [0.0f32; 3];
            let mut count = 0.0;
            for sy in (y * scale)..((y + 1) * scale).min(sum.height) {
                for sx in (x * scale)..((x + 1) * scale).min(sum.width) {
                    (0..3).for_each(|c| mean[c] += sum.value_at(sx, sy)[c]);
                    count += 1.0;
                }
            }
            *small.value_at_mut(x, y) = mean.map(|v| v / f32::max(count, 1.0));
        }
    }
    let display = metrics::to_display(&small, white);
    let mut png = std::io::Cursor::new(Vec::new());
    let pixels: Vec<u8> = display.data.into_iter().flatten().collect();
    ::image::write_buffer_with_format(
        &mut png,
        &pixels,
        width as u32,
        height as u32,
        ::image::ExtendedColorType::Rgb8,
        ::image::ImageFormat::Png,
    )
    .map_err(|error| Error::parameter(format!("thumbnail: {error}")))?;
    Ok(png.into_inner())
}

/// All components of a photograph together; specular radiance below zero counts as none.
pub fn sum_of_components(photograph: &Photograph) -> RgbImage {
    let mut images = photograph.images.iter();
    let mut sum = images.next().cloned().unwrap_or_default();
    for image in images {
        for (total, pixel) in sum.data.iter_mut().zip(&image.data) {
            (0..3).for_each(|c| total[c] += pixel[c].max(0.0));
        }
    }
    sum
}
