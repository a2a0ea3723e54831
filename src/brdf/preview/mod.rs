//! A sphere of a material, rendered under a point light and under an environment, and the PSNR of one material's pictures against
//! another's.
//!
//! The camera looks at the unit sphere from the direction `(0, 0, 1)`, far away (parallel rays), `y` up. Both lights are the same for
//! both materials, and so are all sample positions, so that what differs in the pictures differs in the materials.
//!
//! - **Point light**: at `(-2, 2, 3)`, no shadow; 3 x 3 samples a pixel.
//! - **Environment**: for each pixel, the integral of `f L cos` over half vectors: 40 angles to the normal (the cube of equal steps, so
//!   that sharp highlights are met) times 32 azimuths, each with the radiance of the environment averaged over about the solid angle that
//!   it stands for. The BRDF is sampled for 48 angles of view, linear in their sine between.
//!
//! **PSNR**: over the pixels of the sphere and their colours, of sRGB-encoded values `s(clamp(x / white, 0, 1))`, peak 1. `white` is the
//! measured picture's 95th percentile of each pixel's greatest colour: what is brighter, the core of a highlight, is white in both.

mod environment;
mod psnr;

pub use environment::{PreviewEnvironment, studio_environment};
pub(crate) use psnr::psnr_db;
pub use psnr::sphere_exposure;

use super::Brdf;
use crate::image::{Grid, Mask, RgbImage};
use crate::parallel;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Place of the point light.
pub const POINT_LIGHT: [f64; 3] = [-2.0, 2.0, 3.0];
const ANGLES: usize = 40;
const AZIMUTHS: usize = 32;
const SAMPLES: usize = ANGLES * AZIMUTHS;
const VIEWS: usize = 48;
/// Sine of the last angle of view.
const LAST_SINE: f64 = 0.9995;
const POINT_SAMPLES: usize = 3;
/// 16 KB a pixel: 50 MB.
const MAX_KEPT_SIDE: usize = 64;

/// Lights and sampling directions that all images of spheres share.
#[derive(Debug, Clone)]
pub struct SphereScenes {
    side: usize,
    mask: Mask,
    /// Pixels of the sphere: index, sine of the angle of view.
    pixels: Vec<(usize, f64)>,
    environment: Option<PreviewEnvironment>,
    half: HalfVectors,
    /// Radiance from each sample's direction, for each pixel of the sphere; empty for large pictures, which look it up each time.
    radiance: Vec<[f32; 3]>,
}

/// Pictures of a measured and a fitted material.
#[derive(Debug, Clone)]
pub struct SpherePair {
    /// The measured material.
    pub measured: RgbImage,
    /// The fitted one.
    pub fitted: RgbImage,
    /// Radiance shown as white.
    pub white: f64,
}

/// A material's two pictures.
#[derive(Debug, Clone)]
pub struct SphereImages {
    /// Under the point light.
    pub point: RgbImage,
    /// In the environment.
    pub environment: RgbImage,
}

impl SphereScenes {
    /// Pictures of `side * side` pixels; 64 is what error reports use.
    pub fn new(side: usize, environment: &PreviewEnvironment) -> Self {
        let mut scenes = Self::point_lights(side);
        scenes.environment = Some(environment.clone());
        if side <= MAX_KEPT_SIDE {
            scenes.radiance = parallel::map(scenes.pixels.len(), |p| scenes.radiance_of(p)).concat();
        }
        scenes
    }

    /// Radiance from each sample's direction for a pixel of the sphere.
    fn radiance_of(&self, pixel: usize) -> Vec<[f32; 3]> {
        let (Some(environment), Some(&(k, sine))) = (&self.environment, self.pixels.get(pixel)) else {
            return Vec::new();
        };
        let place = |k: usize| (2 * k + 1) as f64 / self.side as f64 - 1.0;
        let frame = SphereBasis::at_position([place(k % self.side), -place(k / self.side)]);
        let outgoing = [sine, 0.0, (1.0 - sine * sine).sqrt()];
        let sample = |s: usize| {
            let (incoming, dot) = self.half.reflect(s, outgoing);
            if incoming[2] <= 0.0 || dot <= 0.0 {
                return [0.0; 3];
            }
            environment.average_radiance(frame.to_world(incoming), 4.0 * dot * self.half.areas[s])
        };
        (0..SAMPLES).map(sample).collect()
    }

    /// Creates scenes for point lights only: the environment is black.
    pub fn point_lights(side: usize) -> Self {
        let place = |k: usize| (2 * k + 1) as f64 / side as f64 - 1.0;
        let away = |k: usize| place(k % side).hypot(place(k / side));
        let pixels: Vec<(usize, f64)> =
            (0..side * side).filter(|&k| away(k) < LAST_SINE).map(|k| (k, away(k))).collect();
        let mut mask = Grid::filled(side, side, false);
        pixels.iter().for_each(|&(k, _)| mask.data[k] = true);
        SphereScenes { side, mask, pixels, environment: None, half: HalfVectors::new(), radiance: Vec::new() }
    }

    /// Pixels that show the sphere.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// A sphere under a point light of unit irradiance at the distance of the sphere's centre.
    pub fn render_point_light(&self, material: &impl Brdf, light: [f64; 3]) -> RgbImage {
        let squared = light.iter().map(|x| x * x).sum::<f64>();
        let step = 2.0 / (self.side * POINT_SAMPLES) as f64;
        let rows = parallel::map(self.side, |y| {
            let pixel = |x: usize| {
                let mut sum = [0.0; 3];
                for s in 0..POINT_SAMPLES * POINT_SAMPLES {
                    let at = |k: usize, s: usize| ((k * POINT_SAMPLES + s) as f64 + 0.5) * step - 1.0;
                    let (px, py) = (at(x, s % POINT_SAMPLES), -at(y, s / POINT_SAMPLES));
                    let Some(value) = shade(material, [px, py], light) else { continue };
                    (0..3).for_each(|c| sum[c] += value[c] * squared);
                }
                sum.map(|x| (x / (POINT_SAMPLES * POINT_SAMPLES) as f64) as f32)
            };
            (0..self.side)
                .map(|x| if self.mask.data[y * self.side + x] { pixel(x) } else { [0.0; 3] })
                .collect::<Vec<_>>()
        });
        Grid { width: self.side, height: self.side, data: rows.concat() }
    }

    /// A sphere in the environment.
    pub fn render_environment(&self, material: &impl Brdf) -> RgbImage {
        let half = &self.half;
        let lobes = parallel::map(VIEWS, |view| {
            let sine = view as f64 / (VIEWS - 1) as f64 * LAST_SINE;
            let outgoing = [sine, 0.0, (1.0 - sine * sine).sqrt()];
            let sample = |s: usize| {
                let (incoming, dot) = half.reflect(s, outgoing);
                if incoming[2] <= 0.0 || dot <= 0.0 {
                    return [0.0; 3];
                }
                let weight = incoming[2] * 4.0 * dot * half.areas[s];
                material.evaluate(incoming, outgoing).map(|f| (f * weight) as f32)
            };
            (0..SAMPLES).map(sample).collect::<Vec<[f32; 3]>>()
        });
        let colours = parallel::map(self.pixels.len(), |p| {
            let at = self.pixels[p].1 / LAST_SINE * (VIEWS - 1) as f64;
            let view = (at as usize).min(VIEWS - 2);
            let part = (at - view as f64) as f32;
            let mut sum = [0.0f32; 3];
            let looked_up;
            let radiance = match self.radiance.get(p * SAMPLES..(p + 1) * SAMPLES) {
                Some(kept) => kept,
                None => {
                    looked_up = self.radiance_of(p);
                    &looked_up
                }
            };
            for ((light, low), high) in radiance.iter().zip(&lobes[view]).zip(&lobes[view + 1]) {
                (0..3).for_each(|c| sum[c] += light[c] * (low[c] + (high[c] - low[c]) * part));
            }
            sum
        });
        let mut image = Grid::filled(self.side, self.side, [0.0; 3]);
        self.pixels.iter().zip(colours).for_each(|(&(k, _), colour)| image.data[k] = colour);
        image
    }

    /// Both materials under a point light.
    pub fn point_pair(&self, measured: &impl Brdf, fitted: &impl Brdf) -> SpherePair {
        self.pair(self.render_point_light(measured, POINT_LIGHT), self.render_point_light(fitted, POINT_LIGHT))
    }

    /// Both materials in the environment.
    pub fn environment_pair(&self, measured: &impl Brdf, fitted: &impl Brdf) -> SpherePair {
        self.pair(self.render_environment(measured), self.render_environment(fitted))
    }

    fn pair(&self, measured: RgbImage, fitted: RgbImage) -> SpherePair {
        let white = sphere_exposure(&measured, &self.mask);
        SpherePair { measured, fitted, white }
    }

    /// A material under the point light and in the environment.
    pub fn images(&self, material: &impl Brdf) -> SphereImages {
        SphereImages {
            point: self.render_point_light(material, POINT_LIGHT),
            environment: self.render_environment(material),
        }
    }

    /// PSNR of a fitted material's pictures against the measured one's.
    pub fn psnr_of(&self, measured: &SphereImages, fitted: &impl Brdf) -> SpherePsnr {
        let fitted = self.images(fitted);
        let db = |measured: &RgbImage, fitted: &RgbImage| {
            psnr_db(measured, fitted, &self.mask, sphere_exposure(measured, &self.mask))
        };
        SpherePsnr {
            point: db(&measured.point, &fitted.point),
            environment: db(&measured.environment, &fitted.environment),
        }
    }

    /// Computes the PSNR of a fitted material's spheres against those of a measured one.
    pub fn psnr(&self, measured: &impl Brdf, fitted: &impl Brdf) -> SpherePsnr {
        self.psnr_of(&self.images(measured), fitted)
    }
}

/// Radiance of the sphere's point at a place of the picture, for a light of unit intensity; `None` beside the sphere.
fn shade(material: &impl Brdf, place: [f64; 2], light: [f64; 3]) -> Option<[f64; 3]> {
    let squared = place[0] * place[0] + place[1] * place[1];
    if squared >= 1.0 {
        return None;
    }
    let normal = [place[0], place[1], (1.0 - squared).sqrt()];
    let frame = SphereBasis::at_position(place);
    let to_light: [f64; 3] = std::array::from_fn(|k| light[k] - normal[k]);
    let distance2 = to_light.iter().map(|x| x * x).sum::<f64>();
    let incoming = frame.to_local(to_light.map(|x| x / distance2.sqrt()));
    if incoming[2] <= 0.0 {
        return Some([0.0; 3]);
    }
    let outgoing = frame.to_local([0.0, 0.0, 1.0]);
    Some(material.evaluate(incoming, outgoing).map(|f| f * incoming[2] / distance2))
}

/// The surface's axes at a place of the sphere: the viewer lies in the plane of the first and the normal.
struct SphereBasis {
    axes: [[f64; 3]; 3],
}

impl SphereBasis {
    fn at_position([x, y]: [f64; 2]) -> Self {
        let sine = x.hypot(y);
        let cosine = (1.0 - sine * sine).max(0.0).sqrt();
        let (cos_p, sin_p) = if sine > 1e-12 { (x / sine, y / sine) } else { (1.0, 0.0) };
        let first = [-cosine * cos_p, -cosine * sin_p, sine];
        let second = [sin_p, -cos_p, 0.0];
        SphereBasis { axes: [first, second, [x, y, cosine]] }
    }
    fn to_local(&self, v: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2])
    }
    fn to_world(&self, v: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.axes[0][k] * v[0] + self.axes[1][k] * v[1] + self.axes[2][k] * v[2])
    }
}

/// Half vectors of the quadrature and the solid angles they stand for.
#[derive(Debug, Clone)]
struct HalfVectors {
    directions: Vec<[f64; 3]>,
    areas: Vec<f64>,
}

impl HalfVectors {
    fn new() -> Self {
        let (mut directions, mut areas) = (Vec::with_capacity(SAMPLES), Vec::with_capacity(SAMPLES));
        for a in 0..ANGLES {
            let at = (a as f64 + 0.5) / ANGLES as f64;
            let (sine, cosine) = (FRAC_PI_2 * at.powi(3)).sin_cos();
            for p in 0..AZIMUTHS {
                let (sin_p, cos_p) = ((p as f64 + 0.5) / AZIMUTHS as f64 * 2.0 * PI).sin_cos();
                directions.push([sine * cos_p, sine * sin_p, cosine]);
                areas.push(sine * FRAC_PI_2 * 3.0 * at * at / ANGLES as f64 * 2.0 * PI / AZIMUTHS as f64);
            }
        }
        HalfVectors { directions, areas }
    }

    /// The incident direction of a sample, and the cosine between half vector and viewer.
    fn reflect(&self, sample: usize, outgoing: [f64; 3]) -> ([f64; 3], f64) {
        let half = self.directions[sample];
        let dot = half[0] * outgoing[0] + half[1] * outgoing[1] + half[2] * outgoing[2];
        (std::array::from_fn(|k| 2.0 * dot * half[k] - outgoing[k]), dot)
    }
}

#[cfg(test)]
mod tests;

/// PSNR of a rendered sphere against the measured material's, see [`SphereScenes`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpherePsnr {
    /// Under a point light.
    pub point: f64,
    /// Under an environment.
    pub environment: f64,
}
