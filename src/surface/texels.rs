//! Texels fitted to photographs: not sampled from them, but solved for, so that bilinear reading reproduces the photograph.
//!
//! Sampling onto texels and reading them loses twice; the least-squares fit loses little from one texel per pixel on. It runs after
//! decoding, for renderers and export, and works on the signed square-root signal.

use super::atlas::{AtlasRaster, atlas_position, bilinear_taps};
use super::charts::Charts;
use super::charts::NONE;
use super::raster::Raster;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask, RgbImage};
use crate::mesh::Mesh;
use crate::views::Camera;
use glam::DVec3;

/// Weight of the squared differences between neighbouring texels against the squared errors at pixels.
const GRADIENT_PENALTY: f32 = 0.0025;
/// Iterations of conjugate gradients.
const ITERATIONS: usize = 12;

/// `sign(x) sqrt(|x| / white)` per colour.
pub fn to_signal(radiance: [f32; 3], white: [f64; 3]) -> [f32; 3] {
    std::array::from_fn(|c| (radiance[c].abs() as f64 / white[c]).sqrt().copysign(radiance[c] as f64) as f32)
}

/// Inverse of [`to_signal`].
pub fn from_signal(signal: [f32; 3], white: [f64; 3]) -> [f32; 3] {
    std::array::from_fn(|c| signal[c] * signal[c].abs() * white[c] as f32)
}

/// Four texels and weights.
type BilinearTaps = [(u32, f32); 4];

/// The texels of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewTexels {
    /// Signals ([`to_signal`]); 0 where not fitted.
    pub texels: Grid<[f32; 3]>,
    /// Texels that the view determines.
    pub fitted: Mask,
}

/// How the pixels of one view read the atlas: for each pixel that shows the surface four texels and weights.
#[derive(Debug, Clone)]
pub struct TexelReading {
    width: usize,
    height: usize,
    atlas: (usize, usize),
    /// Pixel index and taps.
    pixels: Vec<(u32, BilinearTaps)>,
}

impl TexelReading {
    /// The reading of the pixels of `mask` that meet the mesh.
    pub fn new(mesh: &Mesh, charts: &Charts, camera: &Camera, raster: &Raster, mask: &Mask) -> Result<Self> {
        if mask.data.len() != raster.triangle.len() || charts.chart_of_triangle.len() != mesh.triangles.len() {
            return Err(Error::parameter("mesh, charts, raster and mask do not belong together"));
        }
        let (width, height) = (charts.width as usize, charts.height as usize);
        let centre = DVec3::from_array(camera.centre());
        let mut pixels = Vec::new();
        for k in (0..mask.data.len()).filter(|&k| mask.data[k] && raster.is_covered(k)) {
            let pixel = [(k % raster.width) as f64 + 0.5, (k / raster.width) as f64 + 0.5];
            let point = centre + DVec3::from_array(camera.ray(pixel)) * raster.depth[k];
            let at = atlas_position(charts, raster.triangle[k] as usize, point);
            let taps = bilinear_taps(width, height, at).map(|(texel, weight)| (texel as u32, weight as f32));
            pixels.push((k as u32, taps));
        }
        Ok(TexelReading { width: raster.width, height: raster.height, atlas: (width, height), pixels })
    }

    /// Pixels read.
    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Whether no pixel shows the surface.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }

    /// The picture that texels show: linear radiance, 0 where the surface is not shown.
    pub fn render_texels(&self, texels: &Grid<[f32; 3]>, white: [f64; 3]) -> RgbImage {
        let mut image = Grid::filled(self.width, self.height, [0f32; 3]);
        for (pixel, taps) in &self.pixels {
            image.data[*pixel as usize] = from_signal(gather(&texels.data, taps), white);
        }
        image
    }

    /// Fits texels to a photograph (linear radiance; pixels that are not finite are left out).
    pub fn fit(&self, atlas: &AtlasRaster, image: &RgbImage, white: [f64; 3]) -> Result<ViewTexels> {
        let (width, height) = self.atlas;
        if image.data.len() != self.width * self.height || atlas.triangle.data.len() != width * height {
            return Err(Error::parameter("the photograph has not the size that was read"));
        }
        let observed: Vec<(&BilinearTaps, [f32; 3])> = self
            .pixels
            .iter()
            .map(|(pixel, taps)| (taps, to_signal(image.data[*pixel as usize], white)))
            .filter(|(_, signal)| signal.iter().all(|x| x.is_finite()))
            .collect();
        // Start: the mean of the pixels that read a texel, weighted.
        let mut values = vec![[0f32; 3]; width * height];
        let mut weights = vec![0f32; width * height];
        let mut diagonal = vec![0f32; width * height];
        for (taps, signal) in &observed {
            for &(texel, weight) in taps.iter() {
                let texel = texel as usize;
                (0..3).for_each(|c| values[texel][c] += weight * signal[c]);
                weights[texel] += weight;
                diagonal[texel] += weight * weight;
            }
        }
        let fitted: Vec<bool> =
            (0..weights.len()).map(|k| weights[k] > 0.0 && atlas.triangle.data[k] != NONE).collect();
        for k in 0..values.len() {
            values[k] = if fitted[k] { values[k].map(|x| x / weights[k]) } else { [0.0; 3] };
        }
        // Pairs of neighbours: charts are a texel apart at least, so pairs never span two.
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for k in (0..fitted.len()).filter(|&k| fitted[k]) {
            for (there, inside) in [(k + 1, (k + 1) % width != 0), (k + width, k + width < fitted.len())] {
                if inside && fitted[there] {
                    pairs.push((k as u32, there as u32));
                    diagonal[k] += GRADIENT_PENALTY;
                    diagonal[there] += GRADIENT_PENALTY;
                }
            }
        }
        let apply = |x: &[[f32; 3]]| {
            let mut y = vec![[0f32; 3]; x.len()];
            for (taps, _) in &observed {
                scatter(&mut y, taps, gather(x, taps));
            }
            for &(a, b) in &pairs {
                let (a, b) = (a as usize, b as usize);
                for c in 0..3 {
                    let pull = GRADIENT_PENALTY * (x[a][c] - x[b][c]);
                    y[a][c] += pull;
                    y[b][c] -= pull;
                }
            }
            y
        };
        let mut residual = vec![[0f32; 3]; values.len()];
        for (taps, signal) in &observed {
            scatter(&mut residual, taps, *signal);
        }
        let product = apply(&values);
        residual.iter_mut().zip(&product).for_each(|(r, p)| (0..3).for_each(|c| r[c] -= p[c]));
        residual.iter_mut().zip(&fitted).filter(|(_, f)| !**f).for_each(|(r, _)| *r = [0.0; 3]);
        conjugate_gradients(&mut values, residual, &diagonal, &fitted, apply);
        Ok(ViewTexels { texels: Grid { width, height, data: values }, fitted: Grid { width, height, data: fitted } })
    }
}

#[inline]
fn gather(x: &[[f32; 3]], taps: &BilinearTaps) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for &(texel, weight) in taps {
        (0..3).for_each(|c| sum[c] += weight * x[texel as usize][c]);
    }
    sum
}

#[inline]
fn scatter(y: &mut [[f32; 3]], taps: &BilinearTaps, value: [f32; 3]) {
    for &(texel, weight) in taps {
        (0..3).for_each(|c| y[texel as usize][c] += weight * value[c]);
    }
}

/// Jacobi-preconditioned conjugate gradients on the three colours, each with its own step lengths.
fn conjugate_gradients(
    values: &mut [[f32; 3]],
    mut residual: Vec<[f32; 3]>,
    diagonal: &[f32],
    fitted: &[bool],
    apply: impl Fn(&[[f32; 3]]) -> Vec<[f32; 3]>,
) {
    let precondition = |r: &[[f32; 3]]| -> Vec<[f32; 3]> {
        r.iter().zip(diagonal).map(|(r, &d)| if d > 0.0 { r.map(|x| x / d) } else { [0.0; 3] }).collect()
    };
    let dot = |a: &[[f32; 3]], b: &[[f32; 3]]| -> [f64; 3] {
        let mut sum = [0f64; 3];
        a.iter().zip(b).for_each(|(a, b)| (0..3).for_each(|c| sum[c] += (a[c] * b[c]) as f64));
        sum
    };
    let ratio = |a: f64, b: f64| if b > 0.0 { (a / b) as f32 } else { 0.0 };
    let mut conditioned = precondition(&residual);
    let mut direction = conditioned.clone();
    let mut energy = dot(&residual, &conditioned);
    for _ in 0..ITERATIONS {
        let mut product = apply(&direction);
        product.iter_mut().zip(fitted).filter(|(_, f)| !**f).for_each(|(p, _)| *p = [0.0; 3]);
        let curvature = dot(&direction, &product);
        let step: [f32; 3] = std::array::from_fn(|c| ratio(energy[c], curvature[c]));
        for k in 0..values.len() {
            for c in 0..3 {
                values[k][c] += step[c] * direction[k][c];
                residual[k][c] -= step[c] * product[k][c];
            }
        }
        conditioned = precondition(&residual);
        let before = energy;
        energy = dot(&residual, &conditioned);
        let turn: [f32; 3] = std::array::from_fn(|c| ratio(energy[c], before[c]));
        for (direction, conditioned) in direction.iter_mut().zip(&conditioned) {
            (0..3).for_each(|c| direction[c] = conditioned[c] + turn[c] * direction[c]);
        }
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::super::atlas::{layout, rasterise_atlas, texels_per_unit};
    use super::super::raster::rasterise;
    use super::*;
    use crate::metrics::PhotographError;
    use crate::relight::test_capture::load;

    /// Image PSNR (sum) of fitted texels over some views, with texels per pixel and seconds a view.
    fn psnr(name: &str, density: f64, views: &[usize]) -> Option<(f64, f64, f64)> {
        let asset = load(name)?;
        let cameras: Vec<Camera> = asset.views.iter().map(|v| v.camera).collect();
        let charts = layout(&asset.mesh, texels_per_unit(&asset.mesh, &cameras, density)).unwrap();
        let atlas = rasterise_atlas(&asset.mesh, &charts).unwrap();
        let mut error = PhotographError::default();
        let (mut texels, mut pixels, mut seconds) = (0, 0, 0.0);
        for &k in views {
            let photograph = asset.photographs[k].as_ref().unwrap();
            let raster = rasterise(&asset.mesh, &cameras[k]);
            let start = std::time::Instant::now();
            let reading = TexelReading::new(&asset.mesh, &charts, &cameras[k], &raster, &photograph.mask).unwrap();
            let mut decoded = photograph.clone();
            for (image, original) in decoded.images.iter_mut().zip(&photograph.images) {
                let fit = reading.fit(&atlas, original, asset.white).unwrap();
                *image = reading.render_texels(&fit.texels, asset.white);
                texels += fit.fitted.count();
                pixels += reading.len();
            }
            seconds += start.elapsed().as_secs_f64();
            let covered = raster.coverage();
            error.merge(&PhotographError::compare(photograph, &decoded, &asset.components, &covered, asset.white));
        }
        Some((error.psnr().sum.unwrap(), texels as f64 / pixels as f64, seconds / views.len() as f64))
    }

    #[test]
    fn fitted_texels_reproduce_the_photograph() {
        let Some((db, texels, _)) = psnr("sample-spot", 1.5, &[0, 9, 18]) else { return };
        assert!(db > 45.0, "{db:.2} dB at {texels:.2} texels a pixel");
    }

    #[test]
    #[ignore = "figures"]
    fn figures() {
        for name in ["sample-spot", "bunny-ring"] {
            for density in [0.75, 1.0, 1.25, 1.5, 2.0] {
                let (db, texels, seconds) = psnr(name, density, &[0, 9, 18, 27]).unwrap();
                println!("{name} density {density}: {texels:.2} texels a pixel, {db:.2} dB, {seconds:.3} s a view");
            }
        }
    }
}
