//! Radiance of lobes on a diffuse layer in single precision: the model of `spec/planes.md`, section 12.
//!
//! The same terms as [`crate::reflectance::lobes`], in an order and precision that a decoder can afford at each pixel.

use crate::reflectance::geometry::MIN_COS_VIEW;
use crate::reflectance::lobes::{LOBES, NORMAL_REFLECTANCE, ROUGHNESS, grazing_share};
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::atlas::bilinear_place;
use crate::vector::{DoubleLanes, LANES, dot_lanes, lanes, towards};
use crate::views::{Component, PointLight};
use glam::Vec4;

/// Parameters of a texel: the diffuse colour, then the lobes' weights.
pub(super) type Texel = [Vec4; 1 + LOBES];

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
        let colour = |[r, g, b]: [f32; 3]| Vec4::new(r, g, b, 0.0);
        let texel = |at: usize| -> Texel {
            std::array::from_fn(|k| colour(if k == 0 { maps.diffuse.data[at] } else { maps.lobes[k - 1].data[at] }))
        };
        is_alike.then(|| TexelTable { width, height, texels: (0..width * height).map(texel).collect() })
    }

    /// Bilinear reading at an atlas position.
    #[inline(always)]
    pub(super) fn read(&self, at: [f64; 2]) -> Texel {
        let ([x0, y0], [x1, y1], [s, t]) = bilinear_place(self.width, self.height, at);
        let [s, t] = [s as f32, t as f32];
        let taps = [(y0, x0, (1.0 - s) * (1.0 - t)), (y0, x1, s * (1.0 - t)), (y1, x0, (1.0 - s) * t), (y1, x1, s * t)];
        let mut sum = [Vec4::ZERO; 1 + LOBES];
        for (y, x, weight) in taps {
            let texel = &self.texels[y * self.width + x];
            sum.iter_mut().zip(texel).for_each(|(sum, texel)| *sum += Vec4::splat(weight) * *texel);
        }
        sum
    }
}

/// A number of each of the points that are lit side by side.
type SingleLanes = [f32; LANES];

#[inline(always)]
fn singles(of: impl FnMut(usize) -> f32) -> SingleLanes {
    std::array::from_fn(of)
}
/// Unit vectors from points to a place, and the squared distances.
#[inline(always)]
fn direction(points: &[DoubleLanes; 3], place: [f64; 3]) -> ([DoubleLanes; 3], DoubleLanes) {
    let v = towards(points, place);
    let squared = dot_lanes(&v, &v);
    let scale = lanes(|i| if squared[i] > 0.0 { 1.0 / squared[i].sqrt() } else { 0.0 });
    (v.map(|v| lanes(|i| v[i] * scale[i])), squared)
}

/// Surface points under a view's light.
pub(super) struct LitPoints {
    irradiance: [SingleLanes; 3],
    /// Cosine of the angle of the light, at least 0.
    cosine: SingleLanes,
    /// Share of the light that passes the surface in and out.
    transmission: SingleLanes,
    /// Lobes of weight 1.
    lobes: [SingleLanes; LOBES],
    /// How far reflection is on the way to that of grazing light.
    grazing: SingleLanes,
    /// Whether light and camera are on the surface's outer side.
    is_lit: [bool; LANES],
}

/// What passes the surface above the diffuse layer at normal incidence.
const NORMAL_TRANSMISSION: f32 = 0.96;

impl LitPoints {
    /// Places and unit normals of the points, the camera's centre, and the light.
    #[inline(always)]
    pub(super) fn new(
        points: &[DoubleLanes; 3],
        normals: &[DoubleLanes; 3],
        centre: [f64; 3],
        light: &PointLight,
    ) -> Self {
        let (to_light, squared) = direction(points, light.position);
        let (to_view, _) = direction(points, centre);
        let half = [0, 1, 2].map(|k| lanes(|i| to_light[k][i] + to_view[k][i]));
        let length = dot_lanes(&half, &half).map(f64::sqrt);
        let along = dot_lanes(normals, &half);
        let half = singles(|i| if length[i] > 0.0 { (along[i] / length[i]) as f32 } else { 0.0 });
        let half = half.map(|cosine| limited(cosine, -1.0));
        let irradiance = |l: f64| singles(|i| if squared[i] > 0.0 { (l / squared[i]) as f32 } else { 0.0 });
        let (light_along, view_along) = (dot_lanes(normals, &to_light), dot_lanes(normals, &to_view));
        let (cos_light, cos_view) = (singles(|i| light_along[i] as f32), singles(|i| view_along[i] as f32));
        let view = cos_view.map(|view| if view > MIN_COS_VIEW { view } else { MIN_COS_VIEW });
        let lobes = std::array::from_fn(|k| {
            let a = (ROUGHNESS[k] * ROUGHNESS[k]) as f32;
            let rest = 1.0 - a;
            singles(|i| {
                let (light, view) = (cos_light[i], view[i]);
                let t = 1.0 - half[i] * half[i] * rest;
                let light_root = (a + rest * light * light).sqrt();
                let view_root = (a + rest * view * view).sqrt();
                a / (std::f32::consts::PI * t * t) * (light / (light + light_root)) / (view + view_root)
            })
        });
        LitPoints {
            irradiance: light.intensity.map(irradiance),
            cosine: cos_light.map(|cosine| if cosine > 0.0 { cosine } else { 0.0 }),
            transmission: singles(|i| transmission(cos_light[i]) * transmission(cos_view[i])),
            lobes,
            grazing: singles(|i| grazing_share(limited((0.5 * length[i]) as f32, 0.0))),
            is_lit: std::array::from_fn(|i| cos_light[i] > 0.0 && cos_view[i] > 0.0),
        }
    }

    /// Radiance of a component at a point of these parameters; red, green, blue.
    #[inline(always)]
    pub(super) fn radiance(&self, component: Component, point: usize, texel: &Texel) -> Vec4 {
        match component {
            Component::Diffuse => self.diffuse(point, texel),
            Component::Specular => self.specular(point, texel),
            Component::Combined => self.diffuse(point, texel) + self.specular(point, texel),
        }
    }

    #[inline(always)]
    fn irradiance(&self, point: usize) -> Vec4 {
        let [r, g, b] = self.irradiance.each_ref().map(|colour| colour[point]);
        Vec4::new(r, g, b, 0.0)
    }

    #[inline(always)]
    fn diffuse(&self, point: usize, texel: &Texel) -> Vec4 {
        let [transmission, cosine] = [self.transmission[point], self.cosine[point]].map(Vec4::splat);
        texel[0] * transmission * self.irradiance(point) * cosine
    }

    #[inline(always)]
    fn specular(&self, point: usize, texel: &Texel) -> Vec4 {
        if !self.is_lit[point] {
            return Vec4::ZERO;
        }
        let (mut sum, mut normal) = (Vec4::ZERO, Vec4::ZERO);
        for (weight, lobe) in texel[1..].iter().zip(&self.lobes) {
            sum += *weight * Vec4::splat(lobe[point]);
            normal += *weight;
        }
        // The weights' sum is what the surface reflects at normal incidence; towards grazing light it reflects all.
        let least = Vec4::splat(NORMAL_REFLECTANCE as f32);
        let normal = Vec4::select(normal.cmpgt(least), normal, least);
        let gain = Vec4::select(normal.cmplt(Vec4::ONE), Vec4::ONE / normal - Vec4::ONE, Vec4::ZERO);
        sum * (Vec4::ONE + gain * Vec4::splat(self.grazing[point])) * self.irradiance(point)
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
    NORMAL_TRANSMISSION - NORMAL_TRANSMISSION * grazing_share(limited(cosine, 0.0))
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
            let (lane, texel) = (k % LANES, table.read(at));
            let only = |v: [f64; 3]| v.map(|x| lanes(|i| if i == lane { x } else { 0.0 }));
            let found = LitPoints::new(&only(point), &only(normal), centre, &light);
            for component in [Component::Diffuse, Component::Specular, Component::Combined] {
                let expected = maps::evaluate(&maps, component, at, Some(&expected));
                for (a, b) in found.radiance(component, lane, &texel).to_array().into_iter().zip(expected) {
                    assert!((a - b).abs() <= 1e-4 * b.abs() + 1e-6, "{component:?}: {a} {b}");
                    (compared, lit) = (compared + 1, lit + (b > 0.1) as usize);
                }
            }
        }
        assert!(lit * 3 > compared);
    }
}
