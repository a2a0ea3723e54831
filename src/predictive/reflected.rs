//! Radiance of lobes on a diffuse layer in single precision: the model of `spec/planes.md`, section 12.
//!
//! The same terms as [`crate::reflectance::lobes`], in an order and precision that a decoder can afford at each pixel.

use crate::reflectance::lobes::{LOBES, ROUGHNESS};
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::atlas::bilinear_place;
use crate::vector::{direction, dot};
use crate::views::{Component, PointLight};

/// Parameters of a texel: diffuse red, green, blue, then the red weights of the lobes, the green and the blue ones.
const PARAMETERS: usize = 3 + 3 * LOBES;
/// With as many more that vectors have equal lengths.
type Texel = [f32; PARAMETERS.next_multiple_of(4)];

/// Parameters of all texels, those of each together.
#[derive(Debug)]
pub(super) struct TexelTable {
    width: usize,
    height: usize,
    texels: Vec<Texel>,
}

impl TexelTable {
    pub(super) const BYTES_A_TEXEL: usize = size_of::<Texel>();

    /// Gathers the parameters; `None` for reflectance without lobes.
    pub(super) fn new(maps: &ReflectanceMaps) -> Option<Self> {
        let (width, height) = (maps.diffuse.width, maps.diffuse.height);
        let is_alike =
            maps.lobes.len() == LOBES && maps.lobes.iter().all(|map| (map.width, map.height) == (width, height));
        let texel = |at: usize| {
            let mut texel = Texel::default();
            for c in 0..3 {
                texel[c] = maps.diffuse.data[at][c];
                (0..LOBES).for_each(|k| texel[3 + c * LOBES + k] = maps.lobes[k].data[at][c]);
            }
            texel
        };
        is_alike.then(|| TexelTable { width, height, texels: (0..width * height).map(texel).collect() })
    }

    /// Bilinear reading at an atlas position.
    #[inline(always)]
    pub(super) fn read(&self, at: [f64; 2]) -> Texel {
        let ([x0, y0], [x1, y1], [s, t]) = bilinear_place(self.width, self.height, at);
        let [s, t] = [s as f32, t as f32];
        let taps = [(y0, x0, (1.0 - s) * (1.0 - t)), (y0, x1, s * (1.0 - t)), (y1, x0, (1.0 - s) * t), (y1, x1, s * t)];
        let mut sum = Texel::default();
        for (y, x, weight) in taps {
            let texel = &self.texels[y * self.width + x];
            (0..sum.len()).for_each(|k| sum[k] += weight * texel[k]);
        }
        sum
    }
}

/// A surface point under a view's light.
pub(super) struct LitPoint {
    irradiance: [f32; 3],
    cos_light: f32,
    cos_view: f32,
    cos_half: f32,
    cos_difference: f32,
}

/// Reflectance at normal incidence of the surface above the diffuse layer.
const NORMAL_REFLECTANCE: f32 = 0.04;
/// What passes it there.
const NORMAL_TRANSMISSION: f32 = 0.96;
/// Smallest cosine of the view that a lobe is evaluated at.
const MIN_COS_VIEW: f32 = 0.05;

impl LitPoint {
    #[inline(always)]
    pub(super) fn new(point: [f64; 3], normal: [f64; 3], centre: [f64; 3], light: &PointLight) -> Self {
        let (to_light, squared) = direction(point, light.position);
        let (to_view, _) = direction(point, centre);
        let half: [f64; 3] = std::array::from_fn(|i| to_light[i] + to_view[i]);
        let length = dot(half, half).sqrt();
        LitPoint {
            irradiance: light.intensity.map(|l| if squared > 0.0 { (l / squared) as f32 } else { 0.0 }),
            cos_light: dot(normal, to_light) as f32,
            cos_view: dot(normal, to_view) as f32,
            cos_half: limited(if length > 0.0 { (dot(normal, half) / length) as f32 } else { 0.0 }, -1.0),
            cos_difference: limited((0.5 * length) as f32, 0.0),
        }
    }

    /// Radiance of a component.
    #[inline(always)]
    pub(super) fn radiance(&self, component: Component, texel: &Texel) -> [f32; 3] {
        match component {
            Component::Diffuse => self.diffuse(texel),
            Component::Specular => self.specular(texel),
            Component::Combined => {
                let (diffuse, specular) = (self.diffuse(texel), self.specular(texel));
                std::array::from_fn(|c| diffuse[c] + specular[c])
            }
        }
    }

    #[inline(always)]
    fn diffuse(&self, texel: &Texel) -> [f32; 3] {
        let factor = transmission(self.cos_light) * transmission(self.cos_view);
        let cosine = if self.cos_light > 0.0 { self.cos_light } else { 0.0 };
        std::array::from_fn(|c| texel[c] * factor * self.irradiance[c] * cosine)
    }

    #[inline(always)]
    fn specular(&self, texel: &Texel) -> [f32; 3] {
        if !(self.cos_light > 0.0 && self.cos_view > 0.0) {
            return [0.0; 3];
        }
        let (light, half) = (self.cos_light, self.cos_half);
        let view = if self.cos_view > MIN_COS_VIEW { self.cos_view } else { MIN_COS_VIEW };
        let values: [f32; LOBES] = std::array::from_fn(|k| {
            let a = (ROUGHNESS[k] * ROUGHNESS[k]) as f32;
            let rest = 1.0 - a;
            let t = 1.0 - half * half * rest;
            let light_root = (a + rest * light * light).sqrt();
            let view_root = (a + rest * view * view).sqrt();
            a / (std::f32::consts::PI * t * t) * (light / (light + light_root)) / (view + view_root)
        });
        let x = 1.0 - self.cos_difference;
        let share = x * x * (x * x) * x;
        std::array::from_fn(|c| {
            let weights = &texel[3 + c * LOBES..][..LOBES];
            let (mut sum, mut normal) = (0.0, 0.0);
            for k in 0..LOBES {
                sum += weights[k] * values[k];
                normal += weights[k];
            }
            let normal = if normal > NORMAL_REFLECTANCE { normal } else { NORMAL_REFLECTANCE };
            let gain = if normal < 1.0 { 1.0 / normal - 1.0 } else { 0.0 };
            sum * (1.0 + gain * share) * self.irradiance[c]
        })
    }
}

/// A cosine between `least` and 1.
#[inline(always)]
fn limited(cosine: f32, least: f32) -> f32 {
    let cosine = if cosine > least { cosine } else { least };
    if cosine < 1.0 { cosine } else { 1.0 }
}

/// Share of the light that passes the surface at the cosine of an angle.
#[inline(always)]
fn transmission(cosine: f32) -> f32 {
    let x = 1.0 - limited(cosine, 0.0);
    NORMAL_TRANSMISSION - NORMAL_TRANSMISSION * (x * x * (x * x) * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Grid;
    use crate::reflectance::{ReflectionGeometry, maps};

    /// The terms are those that images are rendered by.
    #[test]
    fn radiance_is_that_of_the_rendered_model() {
        let map = |scale: f32| Grid {
            width: 6,
            height: 5,
            data: (0..30).map(|k| [scale, 0.7 * scale * (k % 7) as f32, 0.1 * (k / 6) as f32]).collect(),
        };
        let mut maps = ReflectanceMaps { relightable: true, diffuse: map(0.3), ..ReflectanceMaps::default() };
        maps.lobes = (0..LOBES).map(|k| map(0.05 * k as f32)).collect();
        let table = TexelTable::new(&maps).unwrap();
        let light = PointLight { position: [1.0, 2.0, 3.0], intensity: [20.0, 18.0, 15.0] };
        let (mut compared, mut lit) = (0, 0);
        for k in 0..200 {
            let turn = k as f64 * 0.37;
            let normal = [turn.sin() * 0.6, turn.cos() * 0.6, 0.8];
            let (point, centre) = ([0.1 * turn.sin(), 0.2, 0.0], [0.3, 2.5 * (turn * 0.3).cos(), 3.0]);
            let at = [3.0 + 3.2 * (turn * 1.7).sin(), 2.5 + 2.7 * (turn * 0.9).cos()];
            let expected = ReflectionGeometry::new(point, normal, centre, &light);
            let (texel, found) = (table.read(at), LitPoint::new(point, normal, centre, &light));
            for component in [Component::Diffuse, Component::Specular, Component::Combined] {
                let expected = maps::evaluate(&maps, component, at, Some(&expected));
                for (a, b) in found.radiance(component, &texel).into_iter().zip(expected) {
                    assert!((a - b).abs() <= 1e-4 * b.abs() + 1e-6, "{component:?}: {a} {b}");
                    (compared, lit) = (compared + 1, lit + (b > 0.1) as usize);
                }
            }
        }
        assert!(lit * 3 > compared);
    }
}
