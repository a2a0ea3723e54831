//! A view as the refinement reads it: square roots of grey radiance with their slopes, which pixels to trust, what the light reaches.

use crate::image::{Grid, Mask, RgbImage, catmull_rom};
use crate::mesh::Mesh;
use crate::surface::raster::rasterise;
use crate::vector::{cross, direction, dot, unit};
use crate::views::{Camera, PointLight, View};

/// Added to the specular radiance before its root: keeps the slope of dark pixels, which are noise, small.
pub(super) const SPECULAR_FLOOR: f64 = 5e-4;
/// Pixels from borders and depth edges beyond which a pixel is trusted in full.
const FEATHER: u16 = 4;
/// Difference of depth between neighbours that makes an edge, in pixel widths.
const EDGE_PIXELS: f64 = 6.0;
/// Least trust of a pixel that is read.
const MIN_TRUST: f32 = 0.7;
/// Distance between the surface and the depth seen beyond which a point is hidden, in pixel widths.
const MARGIN_PIXELS: f64 = 3.0;
/// The same as the light sees it.
const SHADOW_MARGIN_PIXELS: f64 = 4.0;
/// Least cosine of the light.
const MIN_COS_LIGHT: f64 = 0.1;

/// A photograph and the surface as it is known so far.
pub(super) struct SignalView {
    camera: Camera,
    centre: [f64; 3],
    light: PointLight,
    /// Radiant intensity over the white board's radiance, mean of the colours.
    pub(super) intensity: f64,
    mask: Mask,
    /// Roots of diffuse and specular radiance, the slopes of the first by x and y, those of the second.
    signal: Vec<[f32; 6]>,
    depth: Vec<f32>,
    trust: Vec<f32>,
    light_camera: Camera,
    light_depth: Vec<f32>,
}

/// A surface point as a view sees it.
pub(super) struct Sighting {
    /// Directions to the view, to the light and between them.
    pub(super) directions: [[f64; 3]; 3],
    /// Cosines between these and the normal: view, light, half vector.
    pub(super) cosines: [f64; 3],
    /// Grey irradiance of a surface that faces the light, over white.
    pub(super) irradiance: f64,
    /// Cosine of the view times the pixels' trust.
    pub(super) weight: f64,
    /// Camera coordinates.
    camera_point: [f64; 3],
    /// Position between pixel centres: column and row of the pixel above to the left, and the rest.
    pixel: [usize; 2],
    rest: [f64; 2],
}

impl SignalView {
    /// Prepares a view with photographs of its diffuse and specular component, reduced by an integer factor. `None` where its light
    /// is unknown.
    pub(super) fn new(
        view: &View,
        mask: &Mask,
        images: [&RgbImage; 2],
        white: [f64; 3],
        factor: usize,
    ) -> Option<Self> {
        let light = view.light?;
        let camera = reduced_camera(&view.camera, factor);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut inside = Mask::filled(width, height, false);
        let mut roots = vec![[0f32; 2]; width * height];
        for index in 0..width * height {
            let (x, y) = (index % width * factor, index / width * factor);
            let block = || (0..factor * factor).map(|k| (y + k / factor) * mask.width + x + k % factor);
            let usable = |at: usize| mask.data[at] && images.iter().all(|i| i.data[at].iter().all(|v| v.is_finite()));
            if !block().all(usable) {
                continue;
            }
            inside.data[index] = true;
            let grey = |image: &RgbImage| {
                let sum: f64 = block().map(|at| (0..3).map(|c| image.data[at][c] as f64 / white[c]).sum::<f64>()).sum();
                (sum / (3 * factor * factor) as f64).max(0.0)
            };
            roots[index] = [grey(images[0]).sqrt() as f32, (grey(images[1]) + SPECULAR_FLOOR).sqrt() as f32];
        }
        let slope = |index: usize, stride: usize, at: usize, size: usize, k: usize| {
            let (before, after) = (if at > 0 { stride } else { 0 }, if at + 1 < size { stride } else { 0 });
            (roots[index + after][k] - roots[index - before][k]) * if before > 0 && after > 0 { 0.5 } else { 1.0 }
        };
        let signal = (0..width * height).map(|index| {
            let by =
                |k: usize| [slope(index, 1, index % width, width, k), slope(index, width, index / width, height, k)];
            let ([diffuse_x, diffuse_y], [specular_x, specular_y]) = (by(0), by(1));
            [roots[index][0], roots[index][1], diffuse_x, diffuse_y, specular_x, specular_y]
        });
        let signal = signal.collect();
        let intensity = (0..3).map(|c| light.intensity[c] / white[c]).sum::<f64>() / 3.0;
        let (depth, trust, light_depth) = (Vec::new(), Vec::new(), Vec::new());
        let (light_camera, centre) = (Camera::default(), camera.centre());
        Some(SignalView {
            camera,
            centre,
            light,
            intensity,
            mask: inside,
            signal,
            depth,
            trust,
            light_camera,
            light_depth,
        })
    }

    /// Draws the surface as camera and light see it.
    pub(super) fn look(&mut self, mesh: &Mesh) {
        let raster = rasterise(mesh, &self.camera);
        let focal = 0.5 * (self.camera.focal[0] + self.camera.focal[1]);
        self.trust = trust(&self.mask, &raster.depth, EDGE_PIXELS / focal);
        self.depth = raster.depth.iter().map(|&depth| depth as f32).collect();
        self.light_camera = light_camera(mesh, self.light.position, self.camera.width.max(self.camera.height));
        self.light_depth = match self.light_camera.width {
            0 => Vec::new(),
            _ => rasterise(mesh, &self.light_camera).depth.iter().map(|&depth| depth as f32).collect(),
        };
    }

    /// The camera at the size of the signal.
    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns a surface point with a normal as this view shows it; `None` where it can't be trusted: seen at less than `min_cos_view`,
    /// hidden, near a border, or in shadow.
    #[inline]
    pub(super) fn sight(&self, point: [f64; 3], normal: [f64; 3], min_cos_view: f64) -> Option<Sighting> {
        let to_view = direction(point, self.centre).0;
        let cos_view = dot(normal, to_view);
        if cos_view.is_nan() || cos_view < min_cos_view {
            return None;
        }
        let camera_point = self.camera.to_camera(point);
        let [x, y] = std::array::from_fn(|k| {
            self.camera.focal[k] * camera_point[k] / camera_point[2] + self.camera.principal[k] - 0.5
        });
        let (width, height) = (self.mask.width, self.mask.height);
        let inside = x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 && y < height as f64 - 2.0;
        if !inside || camera_point[2] <= 0.0 {
            return None;
        }
        let pixel = [x as usize, y as usize];
        let margin = MARGIN_PIXELS * camera_point[2] / self.camera.focal[0];
        let mut least = 1f32;
        for at in [0, 1, width, width + 1].map(|step| pixel[1] * width + pixel[0] + step) {
            least = least.min(self.trust[at]);
            if self.trust[at] < MIN_TRUST || (self.depth[at] as f64 - camera_point[2]).abs() > margin {
                return None;
            }
        }
        let (to_light, squared) = direction(point, self.light.position);
        let cos_light = dot(normal, to_light);
        if cos_light < MIN_COS_LIGHT || self.is_dark(point) {
            return None;
        }
        let half = unit(std::array::from_fn(|k| to_light[k] + to_view[k])).0;
        Some(Sighting {
            directions: [to_view, to_light, half],
            cosines: [cos_view, cos_light, dot(normal, half).min(1.0)],
            irradiance: self.intensity / squared,
            weight: cos_view * least as f64,
            camera_point,
            pixel,
            rest: [x - pixel[0] as f64, y - pixel[1] as f64],
        })
    }

    /// Whether something lies between a point and the light, by the nine pixels of the light's depth around it.
    fn is_dark(&self, point: [f64; 3]) -> bool {
        let camera = &self.light_camera;
        let Some((at, depth)) = camera.project(point).filter(|_| camera.width > 0) else { return false };
        let margin = SHADOW_MARGIN_PIXELS * depth / camera.focal[0];
        let (x, y) = (at[0].floor(), at[1].floor());
        let size = camera.width as f64;
        if x < 1.0 || y < 1.0 || x + 1.0 >= size || y + 1.0 >= size {
            return false;
        }
        let corner = (y as usize - 1) * camera.width as usize + x as usize - 1;
        (0..9).any(|k| {
            let nearest = self.light_depth[corner + k / 3 * camera.width as usize + k % 3] as f64;
            nearest > 0.0 && nearest < depth - margin
        })
    }

    /// Roots of diffuse and specular radiance, read with Catmull and Rom's cubic (1974).
    #[inline]
    pub(super) fn roots(&self, sighting: &Sighting) -> [f64; 2] {
        let [columns, rows] = sighting.rest.map(catmull_rom);
        let width = self.mask.width;
        let mut sum = [0.0; 2];
        for (j, row) in rows.into_iter().enumerate() {
            let at = (sighting.pixel[1] + j - 1) * width + sighting.pixel[0] - 1;
            for (signal, column) in self.signal[at..at + 4].iter().zip(columns) {
                sum[0] += row * column * signal[0] as f64;
                sum[1] += row * column * signal[1] as f64;
            }
        }
        sum
    }

    /// Derivatives of both roots by a shift of the point in the world, along `direction`.
    #[inline]
    pub(super) fn slopes(&self, sighting: &Sighting, direction: [f64; 3]) -> [f64; 2] {
        let r = &self.camera.rotation;
        let q = sighting.camera_point;
        let d: [f64; 3] = std::array::from_fn(|k| dot(r[k], direction));
        self.slopes_by(sighting, std::array::from_fn(|k| self.camera.focal[k] * (d[k] - q[k] / q[2] * d[2]) / q[2]))
    }

    /// Derivatives of both roots by a shift of the position in the image, in pixels.
    fn slopes_by(&self, sighting: &Sighting, shift: [f64; 2]) -> [f64; 2] {
        let [s, t] = sighting.rest;
        let width = self.mask.width;
        let at = sighting.pixel[1] * width + sighting.pixel[0];
        let mut sum = [0.0; 4];
        for (step, weight) in
            [(0, (1.0 - s) * (1.0 - t)), (1, s * (1.0 - t)), (width, (1.0 - s) * t), (width + 1, s * t)]
        {
            (0..4).for_each(|k| sum[k] += weight * self.signal[at + step][2 + k] as f64);
        }
        [sum[0] * shift[0] + sum[1] * shift[1], sum[2] * shift[0] + sum[3] * shift[1]]
    }
}

/// The camera of an image reduced by an integer factor; what is left over on the right and below is cut off.
fn reduced_camera(camera: &Camera, factor: usize) -> Camera {
    camera.scaled([camera.width, camera.height].map(|side| side / factor as u32), [1.0 / factor as f64; 2])
}

/// A camera in the light's place that sees the whole mesh, in `size` x `size` pixels; without pixels for a light inside the mesh's sphere.
fn light_camera(mesh: &Mesh, light: [f64; 3], size: u32) -> Camera {
    let (middle, radius) = mesh.bounding_sphere();
    let (forward, squared) = direction(light, middle);
    if squared.is_nan() || squared < 1.1 * radius * radius || size < 4 {
        return Camera::default();
    }
    let least = (0..3).min_by(|&a, &b| forward[a].abs().total_cmp(&forward[b].abs())).unwrap_or(0);
    let axis: [f64; 3] = std::array::from_fn(|k| (k == least) as u8 as f64);
    let right = unit(cross(forward, axis)).0;
    let down = cross(forward, right);
    let rotation = [right, down, forward];
    // The sphere's silhouette: tan of the angle whose sine is radius over distance.
    let tangent = radius / (squared - radius * radius).sqrt();
    let focal = 0.5 * (size as f64 - 4.0) / tangent;
    let translation = rotation.map(|row| -dot(row, light));
    Camera { width: size, height: size, focal: [focal; 2], principal: [0.5 * size as f64; 2], rotation, translation }
}

/// Trust in each pixel, 0 to 1: its distance (in steps between neighbours) from the mask's border and from edges of the depth.
fn trust(mask: &Mask, depth: &[f64], edge: f64) -> Vec<f32> {
    let (width, height) = (mask.width, mask.height);
    let mut steps = Grid { width, height, data: vec![FEATHER; width * height] };
    for index in 0..width * height {
        if !mask.data[index] || depth[index] == 0.0 {
            steps.data[index] = 0;
            continue;
        }
        for (other, exists) in [(index + 1, index % width + 1 < width), (index + width, index / width + 1 < height)] {
            if exists && depth[other] > 0.0 && (depth[other] - depth[index]).abs() > edge * depth[index] {
                steps.data[index] = steps.data[index].min(1);
                steps.data[other] = steps.data[other].min(1);
            }
        }
    }
    let mut relax = |index: usize, (other, exists): (usize, bool)| {
        let reached = if exists { steps.data[other] + 1 } else { 1 };
        steps.data[index] = steps.data[index].min(reached);
    };
    for index in 0..width * height {
        relax(index, (index.wrapping_sub(1), index % width > 0));
        relax(index, (index.wrapping_sub(width), index >= width));
    }
    for index in (0..width * height).rev() {
        relax(index, (index + 1, index % width + 1 < width));
        relax(index, (index + width, index / width + 1 < height));
    }
    steps.data.iter().map(|&step| step as f32 / FEATHER as f32).collect()
}
