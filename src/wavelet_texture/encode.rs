//! Writing the section from samples.

use super::WaveletHeader;
use super::decode::{self, DecodedWaveletTexture, code_sides, predicted};
use super::model::{CodedReflectionModel, ReflectionModel};
use super::samples::WaveletSamples;
use super::stream::{VolumeModels, code_volume};
use crate::container::Tag;
use crate::entropy::RangeEncoder;
use crate::error::{Error, Result};
use crate::limits::{Budget, Limits};
use crate::options::{EncodeOptions, EncodeTarget};
use crate::parallel;
use crate::quantise::dead_zone::DeadZone;
use crate::rate::{self, Candidate, CodedPhotographs, CodedView};
use crate::residual::volume::{FillEffort, VolumeScratch, truncate};
use crate::separate::{MaskedPhotographs, check_shown};
use crate::transform::colour::{self, ColourRotation, IDENTITY};
use crate::transform::daubechies::VolumeShape;
use crate::views::Component;

/// Encoder options of profile `wavelet-texture`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveletOptions {
    /// Coefficients kept, per cent of all (of both components, seen or not), `0..=100`.
    pub keep_percent: f64,
    /// Levels of the transform along the views; 0 transforms each view for itself.
    pub view_levels: u8,
    /// Width of the levels relative to the smallest kept magnitude.
    pub relative_step: f32,
    /// Effort of filling what no photograph shows.
    pub effort: FillEffort,
}

impl Default for WaveletOptions {
    fn default() -> Self {
        WaveletOptions { keep_percent: 5.0, view_levels: 2, relative_step: 0.5, effort: FillEffort::default() }
    }
}

/// Step of `sqrt(K_d / max K_d)` that [`fit_model`] quantises with.
pub(crate) const DIFFUSE_STEP: f32 = 1.0 / 128.0;

/// A written section.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodedWaveletTexture {
    /// The section.
    pub bytes: Vec<u8>,
    /// Bytes of it that hold the patches' sides and the model.
    pub model_bytes: usize,
    /// Coefficients kept.
    pub kept: usize,
    /// All coefficients.
    pub coefficients: usize,
}

impl EncodedWaveletTexture {
    /// Coefficients kept, per cent of all.
    pub fn kept_percent(&self) -> f64 {
        100.0 * self.kept as f64 / self.coefficients.max(1) as f64
    }
}

/// Figures of a finished encoding that only this profile has.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WaveletFigures {
    /// Error on the samples, per component.
    pub sample_psnr: Vec<(Component, WaveletSampleError)>,
    /// Coefficients kept, per cent of all.
    pub kept_percent: f64,
}

/// Samples of a patch for one pixel of the photographs.
const PATCH_DENSITY: f64 = 1.0;

/// Encodes photographs with as few coefficients as reach the target of `options`, by default 5 %. `other_bytes` are the bytes
/// of the file beside the returned section.
/// # Errors
/// [`Error::Parameter`] if the target is out of its range or can't be reached.
pub(crate) fn encode_to_target(
    source: &MaskedPhotographs,
    other_bytes: u64,
    options: &EncodeOptions,
    warnings: &mut Vec<String>,
) -> Result<(CodedPhotographs, WaveletFigures)> {
    let &MaskedPhotographs { mesh, views, components, white, photographs, .. } = source;
    let samples = WaveletSamples::gather(mesh, views, photographs, PATCH_DENSITY)?;
    check_shown(&samples.shown, warnings)?;
    let model = fit_model(&samples, components);
    let best = rate::search_keep_percent(options.target.unwrap_or(EncodeTarget::KeepPercent(5.0)), |keep_percent| {
        let settings = WaveletOptions { keep_percent, ..Default::default() };
        let encoded = encode(&samples, components, Some(&model), &settings)?;
        let unlimited = Budget::new(Limits::UNLIMITED);
        let decoded = decode::decode(&encoded.bytes, mesh, components, views.len(), &unlimited)?;
        let mut coded: Vec<CodedView> = Vec::with_capacity(views.len());
        let mut is_shown = false;
        source.for_each(|index, original| {
            let decoded = decode::photograph(&decoded, mesh, &views[index], index);
            let first = !is_shown && decoded.mask.data.contains(&true);
            is_shown |= first;
            coded.push(source.coded_view(index, original, &decoded, first));
            Ok(())
        })?;
        let (distortion, bytes) = (rate::total(&coded), other_bytes + encoded.bytes.len() as u64);
        let errors = sample_errors(&samples, &decoded, white);
        Ok(Candidate { distortion, bytes, content: (encoded, errors, coded) })
    })?;
    let (encoded, errors, views) = best.content;
    let sample_psnr = components.iter().copied().zip(errors).collect();
    let figures = WaveletFigures { sample_psnr, kept_percent: encoded.kept_percent() };
    let sections = vec![(Tag::WAVELET_TEXTURE, encoded.bytes)];
    Ok((CodedPhotographs { sections, views, distortion: best.distortion }, figures))
}

/// Fits the reflection model to the samples and quantises it.
pub fn fit_model(samples: &WaveletSamples, components: &[Component]) -> CodedReflectionModel {
    CodedReflectionModel::quantise(
        &crate::wavelet_texture::fit::fit(samples, components),
        &samples.layout,
        DIFFUSE_STEP,
    )
}

/// Writes the section. Without a `model` the residual is the radiance itself.
pub fn encode(
    samples: &WaveletSamples,
    components: &[Component],
    model: Option<&CodedReflectionModel>,
    options: &WaveletOptions,
) -> Result<EncodedWaveletTexture> {
    if components.len() != samples.components || !(1..=2).contains(&components.len()) {
        return Err(Error::parameter("one or two components expected, as many as the samples have"));
    }
    if !(0.0..=100.0).contains(&options.keep_percent) {
        return Err(Error::parameter("the share of coefficients to keep lies between 0 and 100 per cent"));
    }
    if options.view_levels > crate::wavelet_texture::MAX_VIEW_LEVELS
        || options.relative_step.is_nan()
        || options.relative_step <= 0.0
    {
        return Err(Error::parameter("at most 7 levels along the views, and a step above zero"));
    }
    let views = samples.views.len();
    let relightable = samples.views.iter().all(|v| v.light.is_some());
    let decoded_model = model.map(|m| m.dequantise(&samples.layout, relightable));
    let shapes: Vec<VolumeShape> =
        samples.layout.side_log2.iter().map(|&log2| VolumeShape::padded(log2, views, options.view_levels)).collect();
    let coefficients = samples.coefficients();
    let wanted = (coefficients as f64 * options.keep_percent / 100.0) as usize;
    let residuals = parallel::map(shapes.len(), |patch| residual(samples, components, decoded_model.as_ref(), patch));
    let mut rotations = [model.map_or(IDENTITY, |m| m.rotation), IDENTITY, IDENTITY];
    for component in 0..components.len() {
        rotations[component + 1] = principal_colours(residuals.iter().map(|patch| &patch[component]));
    }
    let kept = if components.len() == 2 {
        PatchVolumes::<6>::new(samples, &residuals, &rotations, &shapes, options.effort).keep_largest(wanted)
    } else {
        PatchVolumes::<3>::new(samples, &residuals, &rotations, &shapes, options.effort).keep_largest(wanted)
    };
    let quantiser = DeadZone { threshold: kept.threshold, step: kept.threshold * options.relative_step };

    let header = WaveletHeader {
        modelled: model.is_some(),
        relightable,
        lobes: model.is_some_and(|m| !m.lobes.is_empty()),
        components: components.len() as u8,
        view_levels: options.view_levels,
        views: views as u32,
        patches: samples.layout.patches.len() as u32,
        quantiser,
        diffuse_scale: model.map_or(0.0, |m| m.diffuse_scale),
        diffuse_step: model.map_or(0.0, |m| m.diffuse_step),
        specular_scale: model.map_or(0.0, |m| m.specular_scale),
        rotations,
    };
    let mut bytes = header.to_bytes();
    let mut coder = RangeEncoder::new();
    code_sides(&mut coder, &mut samples.layout.side_log2.clone());
    if let Some(model) = model {
        model.clone().code(&mut coder, &samples.layout, |_| true);
    }
    let model_bytes = coder.len();
    let mut models = VolumeModels::new(components.len());
    let mut count = 0;
    for (coefficients, &shape) in kept.coefficients.iter().zip(&shapes) {
        let mut levels = vec![vec![0; shape.len()]; components.len() * 3];
        for &(index, coefficient) in coefficients {
            let level = quantiser.quantise(coefficient);
            count += (level != 0) as usize;
            levels[index as usize % (components.len() * 3)][index as usize / (components.len() * 3)] = level;
        }
        code_volume(&mut coder, &mut models, &mut levels, components.len(), shape);
    }
    bytes.extend(coder.finish());
    Ok(EncodedWaveletTexture { bytes, model_bytes, kept: count, coefficients })
}

/// The residual of one patch, one vector a component; zero where not visible.
fn residual(
    samples: &WaveletSamples,
    components: &[Component],
    model: Option<&ReflectionModel>,
    patch: usize,
) -> Vec<Vec<[f32; 3]>> {
    let data = &samples.patches[patch];
    let mut residual = data.radiance.clone();
    let Some(model) = model else { return residual };
    let layout = &samples.layout;
    let (side, area) = (1usize << layout.side_log2[patch], 1usize << (2 * layout.side_log2[patch]));
    for i in 0..area {
        let Some(point) = layout.grid_point(patch, i % side, i / side) else { continue };
        for (view, captured) in samples.views.iter().enumerate() {
            let at = view * area + i;
            if !data.visible[at] {
                continue;
            }
            for (component, residual) in residual.iter_mut().enumerate() {
                let modelled = predicted(Some(model), layout, components, component, patch, i, &point, captured);
                (0..3).for_each(|c| residual[at][c] -= modelled[c]);
            }
        }
    }
    residual
}

/// Colour axes of one component's residual.
fn principal_colours<'a>(residuals: impl Iterator<Item = &'a Vec<[f32; 3]>>) -> ColourRotation {
    let mut moments = [[0.0f64; 3]; 3];
    for x in residuals.flatten() {
        (0..9).for_each(|k| moments[k / 3][k % 3] += x[k / 3] as f64 * x[k % 3] as f64);
    }
    colour::principal_axes(moments)
}

/// The residual volumes of all patches, `L` planes (components and colour axes) interleaved.
struct PatchVolumes<'a, const L: usize> {
    samples: &'a WaveletSamples,
    residuals: &'a [Vec<Vec<[f32; 3]>>],
    rotations: &'a [ColourRotation; 3],
    shapes: &'a [VolumeShape],
    effort: FillEffort,
}

/// Coefficients kept by [`PatchVolumes::keep_largest`].
struct KeptCoefficients {
    /// Per patch the coefficients: their place, interleaved by planes, and value.
    coefficients: Vec<Vec<(u32, f32)>>,
    /// The smallest magnitude among them.
    threshold: f32,
}

impl<'a, const L: usize> PatchVolumes<'a, L> {
    fn new(
        samples: &'a WaveletSamples,
        residuals: &'a [Vec<Vec<[f32; 3]>>],
        rotations: &'a [ColourRotation; 3],
        shapes: &'a [VolumeShape],
        effort: FillEffort,
    ) -> Self {
        PatchVolumes { samples, residuals, rotations, shapes, effort }
    }
    /// Coefficients of one patch above a threshold.
    fn coefficients(&self, patch: usize, threshold: f32) -> Vec<[f32; L]> {
        let components = &self.residuals[patch];
        let mut planes = vec![[0.0f32; L]; components.first().map_or(0, |c| c.len())];
        for (component, residual) in components.iter().enumerate() {
            let rotation = &self.rotations[component + 1];
            for (planes, x) in planes.iter_mut().zip(residual) {
                planes[component * 3..component * 3 + 3].copy_from_slice(&colour::forward(rotation, *x));
            }
        }
        let visible = &self.samples.patches[patch].visible;
        truncate(&planes, visible, self.shapes[patch], threshold, self.effort, &mut VolumeScratch::default())
    }
    /// The `wanted` largest coefficients of all patches.
    fn keep_largest(&self, wanted: usize) -> KeptCoefficients {
        let count = self.shapes.len();
        if wanted == 0 || count == 0 {
            return KeptCoefficients { coefficients: vec![Vec::new(); count], threshold: 1.0 };
        }
        // Which samples are free depends on the threshold, and the threshold on the filling: it is sought on some of the
        // patches, a little too low, and the last coefficients are taken out of all.
        let some: Vec<usize> = (0..count).step_by((count / 100).clamp(1, 23)).collect();
        let area =
            |patches: &mut dyn Iterator<Item = usize>| patches.map(|p| self.shapes[p].area()).sum::<usize>() as f64;
        let share = area(&mut some.iter().copied()) / area(&mut (0..count));
        let kept = |threshold: f32| -> usize {
            let count =
                |i: usize| self.coefficients(some[i], threshold).iter().flatten().filter(|c| **c != 0.0).count();
            parallel::map(some.len(), count).iter().sum()
        };
        let target = 1.02 * share * wanted as f64;
        let sampled = some.iter().flat_map(|&p| self.residuals[p].iter().flatten().flatten());
        let largest = sampled.fold(0.0f32, |m, x| m.max(x.abs()));
        let (mut low, mut high) = ((largest * 1e-6).max(1e-20).ln(), (largest.max(1e-12) * 100.0).ln());
        while high - low > 0.02 {
            let middle = 0.5 * (low + high);
            if kept(middle.exp()) as f64 > target { low = middle } else { high = middle }
        }
        let threshold = low.exp();
        let coefficients = parallel::map(count, |patch| {
            let coefficients = self.coefficients(patch, threshold);
            let places = coefficients.iter().flatten().enumerate().filter(|(_, c)| **c != 0.0);
            places.map(|(i, &c)| (i as u32, c)).collect::<Vec<_>>()
        });
        let mut magnitudes: Vec<f32> = coefficients.iter().flatten().map(|(_, c)| c.abs()).collect();
        if magnitudes.len() <= wanted {
            return KeptCoefficients { coefficients, threshold };
        }
        let (_, least, _) = magnitudes.select_nth_unstable_by(wanted - 1, |a, b| b.total_cmp(a));
        KeptCoefficients { coefficients, threshold: *least }
    }
}

/// Error of decoded samples against the photographs', over all visible ones, in dB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveletSampleError {
    /// PSNR of `x / white`.
    pub linear_db: f64,
    /// PSNR of `x / white` limited to 0..=1, as photographs of 8 bits are: few samples of a highlight (or of a renderer's
    /// noise) far above white decide over `linear_db`.
    pub clipped_db: f64,
    /// PSNR of `sqrt(max(x, 0) / white)`.
    pub sqrt_db: f64,
}

/// Compares decoded samples with what the photographs show there; one result a component.
pub fn sample_errors(
    samples: &WaveletSamples,
    decoded: &DecodedWaveletTexture,
    white: [f64; 3],
) -> Vec<WaveletSampleError> {
    let count = samples.components;
    let sums = parallel::map(samples.patches.len(), |patch| {
        let data = &samples.patches[patch];
        let area = 1usize << (2 * samples.layout.side_log2[patch]);
        let mut sums = vec![[0.0f64; 4]; count];
        for (at, _) in data.visible.iter().enumerate().filter(|(_, visible)| **visible) {
            let (view, sample) = (at / area, at % area);
            for (component, sum) in sums.iter_mut().enumerate() {
                let Some(found) = decoded.radiance_at_sample(component, view, &samples.views[view], patch, sample)
                else {
                    continue;
                };
                for c in 0..3 {
                    let measured = data.radiance[component][at][c] as f64 / white[c];
                    let found = found[c] as f64 / white[c];
                    sum[0] += (measured - found).powi(2);
                    sum[1] += (measured.max(0.0).sqrt() - found.max(0.0).sqrt()).powi(2);
                    sum[2] += (measured.clamp(0.0, 1.0) - found.clamp(0.0, 1.0)).powi(2);
                    sum[3] += 1.0;
                }
            }
        }
        sums
    });
    let psnr = |squares: f64, count: f64| -10.0 * (squares / count.max(1.0)).max(1e-30).log10();
    (0..count)
        .map(|component| {
            let total = sums.iter().fold([0.0; 4], |sum, s| std::array::from_fn(|k| sum[k] + s[component][k]));
            let [linear_db, sqrt_db, clipped_db] = [0, 1, 2].map(|k| psnr(total[k], total[3]));
            WaveletSampleError { linear_db, clipped_db, sqrt_db }
        })
        .collect()
}
