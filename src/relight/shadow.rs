//! Which surface points a point light reaches: a depth map drawn from the light.

use super::cameras::look_at;
use crate::mesh::Mesh;
use crate::surface::raster::rasterise;
use crate::views::Camera;

/// Width and height of the depth map.
const SIDE: u32 = 1024;
/// A point is in shadow where the mesh is nearer to the light by this many widths of a depth-map pixel.
const MARGIN_PIXELS: f64 = 5.0;
/// Margin in pixels where the mesh itself is shaded and casts the shadow, not a surface that was photographed.
const NARROW_MARGIN_PIXELS: f64 = 1.5;

/// The mesh as a light sees it.
pub(super) struct ShadowMap {
    camera: Camera,
    /// Depth of the nearest surface; infinite where there is none.
    depth: Vec<f32>,
    /// Least depth.
    nearest: f64,
    margin_pixels: f64,
}

impl ShadowMap {
    /// `None` for a light within the sphere around the mesh: nothing is shadowed then.
    pub(super) fn new(mesh: &Mesh, light: [f64; 3]) -> Option<Self> {
        let (middle, radius) = mesh.bounding_sphere();
        let gap: [f64; 3] = std::array::from_fn(|k| light[k] - middle[k]);
        let squared = gap.iter().map(|x| x * x).sum::<f64>();
        let clear = squared - 1.05 * radius * radius;
        // Any direction across the light's serves as up.
        let least = (0..3).min_by(|&a, &b| gap[a].abs().total_cmp(&gap[b].abs())).unwrap_or(0);
        let up = std::array::from_fn(|k| if k == least { 1.0 } else { 0.0 });
        (clear > 0.0 && radius > 0.0).then(|| {
            let focal = SIDE as f64 / 2.0 * clear.sqrt() / radius;
            let camera = look_at(light, middle, up, focal, SIDE, SIDE);
            let raster = rasterise(mesh, &camera);
            let depth = |k: usize| if raster.is_covered(k) { raster.depth[k] as f32 } else { f32::INFINITY };
            let depth: Vec<f32> = (0..raster.depth.len()).map(depth).collect();
            let nearest = depth.iter().copied().fold(f32::INFINITY, f32::min) as f64;
            ShadowMap { camera, depth, nearest, margin_pixels: MARGIN_PIXELS }
        })
    }

    /// Draws the depth map of a light so far away that all its rays are nearly parallel, with a narrow margin.
    pub(super) fn for_distant_light(mesh: &Mesh, light: [f64; 3]) -> Option<Self> {
        Self::new(mesh, light).map(|map| ShadowMap { margin_pixels: NARROW_MARGIN_PIXELS, ..map })
    }

    /// Whether the light reaches all of a triangle or nothing of it; `None` where [`Self::visibility`] has to tell point by point.
    pub(super) fn triangle_visibility(&self, corners: [[f64; 3]; 3], cos_light: f64) -> Option<bool> {
        const MAX_PIXELS: f64 = 4096.0;
        let mut places = [([0.0; 2], 0.0); 3];
        for (place, corner) in places.iter_mut().zip(corners) {
            *place = self.camera.project(corner)?;
        }
        let [(a, za), (b, zb), (c, zc)] = places;
        let bounds: [[f64; 2]; 2] = std::array::from_fn(|k| {
            [(a[k].min(b[k]).min(c[k]) - 0.5).floor(), (a[k].max(b[k]).max(c[k]) - 0.5).floor() + 1.0]
        });
        let within = bounds.iter().all(|&[low, high]| low >= 0.0 && high < SIDE as f64);
        let pixels = (bounds[0][1] - bounds[0][0] + 1.0) * (bounds[1][1] - bounds[1][0] + 1.0);
        // The triangle's depth over the map, flat as its rays are all but parallel.
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if !within || pixels > MAX_PIXELS || area.abs() < 1e-9 {
            return None;
        }
        let along = ((zb - za) * (c[1] - a[1]) - (zc - za) * (b[1] - a[1])) / area;
        let down = ((zc - za) * (b[0] - a[0]) - (zb - za) * (c[0] - a[0])) / area;
        let nearest = za.min(zb).min(zc);
        let margin = |depth: f64| self.margin_pixels * depth / self.camera.focal[0] / cos_light.clamp(0.2, 1.0);
        // A point is compared with pixels up to one away from it.
        let slack = along.abs() + down.abs();
        let (mut lit, mut dark) = (true, true);
        for y in bounds[1][0] as usize..=bounds[1][1] as usize {
            for x in bounds[0][0] as usize..=bounds[0][1] as usize {
                let depth = za + along * (x as f64 + 0.5 - a[0]) + down * (y as f64 + 0.5 - a[1]);
                let found = self.depth[y * SIDE as usize + x] as f64;
                lit &= found > depth + slack - margin(nearest);
                dark &= found <= depth - slack - margin(nearest) * 1.1;
            }
        }
        if lit { Some(true) } else { dark.then_some(false) }
    }

    /// Returns the visible share of a light whose parts lie within `angle` (radians) of its middle, on a surface of this unit normal: the mean
    /// over a disc as wide as the light is from the mean of what blocks it there (Fernando 2005).
    pub(super) fn soft_visibility(&self, point: [f64; 3], normal: [f64; 3], angle: f64) -> f64 {
        const PLACES: usize = 24;
        let Some((at, depth)) = self.camera.project(point) else { return 1.0 };
        let turned = self.camera.rotation.map(|row| row[0] * normal[0] + row[1] * normal[1] + row[2] * normal[2]);
        let cosine = turned[2].abs().clamp(0.2, 1.0);
        let pixel = depth / self.camera.focal[0];
        let radius = |gap: f64| angle * gap.max(0.0) / pixel;
        let widest = radius(depth - self.nearest);
        if widest < 0.75 {
            return self.visibility(point, cosine);
        }
        // The surface's own depth beside the point.
        let slope = [turned[0], turned[1]].map(|n| n / cosine * -turned[2].signum() * pixel);
        let margin = self.margin_pixels * pixel / cosine;
        // Places of a spiral: depth of the map and of the surface.
        let places = |radius: f64| {
            (0..PLACES).map(move |k| {
                let (sine, cosine) = (k as f64 * 2.399_963_229_728_653).sin_cos();
                let distance = radius * ((k as f64 + 0.5) / PLACES as f64).sqrt();
                [distance * cosine, distance * sine]
            })
        };
        let surface = |[dx, dy]: [f64; 2]| depth + slope[0] * dx + slope[1] * dy - margin;
        let (mut gaps, mut blocked) = (0.0, 0.0);
        for place in places(widest) {
            let found = self.nearest_depth([at[0] + place[0], at[1] + place[1]]);
            if found <= surface(place) {
                (gaps, blocked) = (gaps + surface(place) - found, blocked + 1.0);
            }
        }
        if blocked == 0.0 {
            return self.visibility(point, cosine);
        }
        let wide = radius(gaps / blocked).max(0.75);
        let sum: f64 = places(wide).map(|p| self.lit([at[0] + p[0], at[1] + p[1]], surface(p))).sum();
        sum / PLACES as f64
    }

    fn nearest_depth(&self, at: [f64; 2]) -> f64 {
        let within = |x: f64| (0.0..SIDE as f64).contains(&x);
        let index = |at: [f64; 2]| at[1] as usize * SIDE as usize + at[0] as usize;
        if within(at[0]) && within(at[1]) { self.depth[index(at)] as f64 } else { f64::INFINITY }
    }

    /// Share of the light that reaches a surface point, 0 to 1: bilinear between the four depth tests around it.
    pub(super) fn visibility(&self, point: [f64; 3], cos_light: f64) -> f64 {
        let Some((at, depth)) = self.camera.project(point) else { return 1.0 };
        let margin = self.margin_pixels * depth / self.camera.focal[0] / cos_light.clamp(0.2, 1.0);
        self.lit(at, depth - margin)
    }

    /// Share of the four pixels around a place, bilinear, that are no nearer than `depth`.
    fn lit(&self, at: [f64; 2], depth: f64) -> f64 {
        let (x, y) = ((at[0] - 0.5).floor(), (at[1] - 0.5).floor());
        if !(x >= 0.0 && y >= 0.0 && x + 1.0 < SIDE as f64 && y + 1.0 < SIDE as f64) {
            return 1.0;
        }
        let (s, t) = (at[0] - 0.5 - x, at[1] - 0.5 - y);
        let first = y as usize * SIDE as usize + x as usize;
        let lit = |index: usize| (self.depth[index] as f64 > depth) as u8 as f64;
        let upper = lit(first) * (1.0 - s) + lit(first + 1) * s;
        let lower = lit(first + SIDE as usize) * (1.0 - s) + lit(first + SIDE as usize + 1) * s;
        upper * (1.0 - t) + lower * t
    }
}
