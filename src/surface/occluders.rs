//! Visibility of surface points in photographs: ray casting against the mesh, the mask, and a margin to depth edges.

use crate::image::{Grid, Mask, RgbImage};
use crate::mesh::{Mesh, is_within_range};
use crate::vector::{cross, dot};
use crate::views::Camera;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

/// A mesh made ready for ray casting.
pub(crate) struct Occluders {
    hierarchy: CwBvh,
    /// In the order of the hierarchy's leaves.
    triangles: Vec<Triangle>,
    /// Distance that shadow rays keep from the surface they start on.
    bias: f64,
}

/// First intersection of a ray with the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SurfaceHit {
    /// Index of the triangle.
    pub triangle: u32,
    /// Weights of its three vertices.
    pub barycentric: [f64; 3],
    /// Distance in units of the ray's direction: for [`Camera::ray`] the depth.
    pub depth: f64,
}

impl Occluders {
    /// Builds the hierarchy. Vertices that no mesh of a file or capture has (not finite, or beyond 1e12) lie in the origin.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let vertex = |v: u32| -> [f32; 3] {
            let p = mesh.positions[v as usize];
            if is_within_range(&p) { p } else { [0.0; 3] }
        };
        let triangles: Vec<Triangle> = mesh
            .triangles
            .iter()
            .map(|&[a, b, c]| Triangle { v0: vertex(a).into(), v1: vertex(b).into(), v2: vertex(c).into() })
            .collect();
        let hierarchy = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Default::default());
        let triangles = hierarchy.primitive_indices.iter().map(|&k| triangles[k as usize]).collect();
        Occluders { hierarchy, triangles, bias: 2e-4 * mesh.diagonal() }
    }
    /// Whether the segment between a surface point and a camera is free. The point's own surroundings do not block it.
    pub(crate) fn is_visible(&self, point: [f64; 3], camera_centre: [f64; 3]) -> bool {
        let (direction, squared) = crate::vector::direction(point, camera_centre);
        let distance = squared.sqrt();
        if self.triangles.is_empty() || distance.is_nan() || distance <= self.bias {
            return true;
        }
        ray(point, direction, distance as f32).is_none_or(|ray| self.misses(ray, self.bias as f32))
    }
    /// Whether a ray from a surface point leaves the object. The point's own surroundings do not block it.
    pub(crate) fn is_free(&self, point: [f32; 3], direction: [f32; 3]) -> bool {
        self.is_free_beyond(self.bias as f32, point, direction)
    }
    /// Whether a ray leaves the object, whatever it meets nearer than `bias`.
    #[inline]
    pub(crate) fn is_free_beyond(&self, bias: f32, point: [f32; 3], direction: [f32; 3]) -> bool {
        self.triangles.is_empty() || self.misses(Ray::new_inf(point.into(), direction.into()), bias)
    }
    /// The bias applies in the intersection: the hierarchy's `t` starts at zero.
    #[inline]
    fn misses(&self, ray: Ray, bias: f32) -> bool {
        self.hierarchy.ray_traverse_miss(ray, |ray, id| {
            let t = self.triangles[id].intersect(ray);
            if t > bias { t } else { f32::INFINITY }
        })
    }
    /// Returns the triangle that a ray from a surface point meets first, and the weights of its corners there; not the point's own
    /// surroundings.
    pub(crate) fn first_hit_from(&self, point: [f32; 3], direction: [f32; 3]) -> Option<(u32, [f64; 3])> {
        if self.triangles.is_empty() {
            return None;
        }
        let bias = self.bias as f32;
        let mut hit = RayHit::none();
        let found = self.hierarchy.ray_traverse(Ray::new_inf(point.into(), direction.into()), &mut hit, |ray, id| {
            let t = self.triangles[id].intersect(ray);
            if t > bias { t } else { f32::INFINITY }
        });
        if !found {
            return None;
        }
        let t = &self.triangles[hit.primitive_id as usize];
        let corners = [t.v0, t.v1, t.v2].map(|p| p.to_array().map(f64::from));
        let (barycentric, _) = intersect(corners, point.map(f64::from), direction.map(f64::from));
        Some((self.hierarchy.primitive_indices[hit.primitive_id as usize], barycentric))
    }
    /// Returns the first intersection of the ray through an image position.
    pub(crate) fn first_hit(&self, camera: &Camera, pixel: [f64; 2]) -> Option<SurfaceHit> {
        if self.triangles.is_empty() {
            return None;
        }
        let (origin, direction) = (camera.centre(), camera.ray(pixel));
        let ray = ray(origin, direction, f32::INFINITY)?;
        let mut hit = RayHit::none();
        let found = self.hierarchy.ray_traverse(ray, &mut hit, |ray, id| self.triangles[id].intersect(ray));
        if !found {
            return None;
        }
        let triangle = self.hierarchy.primitive_indices[hit.primitive_id as usize];
        let t = &self.triangles[hit.primitive_id as usize];
        let corners = [t.v0.to_array(), t.v1.to_array(), t.v2.to_array()].map(|p| p.map(|x| x as f64));
        let (barycentric, depth) = intersect(corners, origin, direction);
        Some(SurfaceHit { triangle, barycentric, depth })
    }
    /// Depth of every pixel's central ray; infinite where it misses the mesh.
    pub(crate) fn depth_map(&self, camera: &Camera) -> Grid<f32> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let depth = |x: usize, y: usize| {
            self.first_hit(camera, [x as f64 + 0.5, y as f64 + 0.5]).map_or(f32::INFINITY, |hit| hit.depth as f32)
        };
        let rows = crate::parallel::map(height, |y| (0..width).map(|x| depth(x, y)).collect::<Vec<_>>());
        Grid { width, height, data: rows.concat() }
    }
}

/// A ray in single precision; `None` where that does not hold it, as for a camera whose field of view is all but half a sphere.
fn ray(origin: [f64; 3], direction: [f64; 3], far: f32) -> Option<Ray> {
    let [origin, direction] = [origin, direction].map(|v| v.map(|x| x as f32));
    let finite = origin.iter().chain(&direction).all(|x| x.is_finite());
    finite.then(|| Ray::new(origin.into(), direction.into(), 0.0, far))
}

/// Barycentric coordinates and distance where a ray meets a triangle's plane, clamped into the triangle.
fn intersect(corners: [[f64; 3]; 3], origin: [f64; 3], direction: [f64; 3]) -> ([f64; 3], f64) {
    let sub = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| a[i] - b[i]) };
    let (e1, e2, s) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]), sub(origin, corners[0]));
    let h = cross(direction, e2);
    let determinant = dot(e1, h);
    if determinant == 0.0 {
        return ([1.0, 0.0, 0.0], 0.0);
    }
    let q = cross(s, e1);
    let (b1, b2) = ((dot(s, h) / determinant).max(0.0), (dot(direction, q) / determinant).max(0.0));
    let sum = (b1 + b2).max(1.0);
    let (b1, b2) = (b1 / sum, b2 / sum);
    ([1.0 - b1 - b2, b1, b2], dot(e2, q) / determinant)
}

/// Readable pixels of a photograph: those that show the object, hold finite values and lie on one surface.
pub(crate) struct Footprint {
    camera: Camera,
    usable: Mask,
    depth: Grid<f32>,
    /// Depth difference beyond which two pixels lie on different surfaces.
    margin: f32,
}

impl Footprint {
    /// Gathers mask, missing pixels and depth of one view. All images have the camera's size.
    pub(crate) fn new(
        occluders: &Occluders,
        mesh: &Mesh,
        camera: &Camera,
        mask: Option<&Mask>,
        images: &[RgbImage],
    ) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let depth = occluders.depth_map(camera);
        let mut usable = Mask::filled(width, height, true);
        for (i, u) in usable.data.iter_mut().enumerate() {
            // Without a mask the mesh's own silhouette takes its place.
            let shown = mask.map_or(depth.data[i].is_finite(), |m| m.data[i]);
            *u = shown && images.iter().all(|image| image.data[i].iter().all(|x| x.is_finite()));
        }
        Footprint { camera: *camera, usable, depth, margin: 0.02 * mesh.diagonal() as f32 }
    }
    /// Pixels that are shown and finite.
    pub(crate) fn usable(&self) -> &Mask {
        &self.usable
    }
    /// The image position of a point, if its pixel is usable and does not lie on a surface in front of or behind it by
    /// more than the margin. Occlusion is [`Occluders::is_visible`]'s business.
    pub(crate) fn project(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let (at, depth) = self.camera.project(point)?;
        let inside = at[0] >= 0.0 && at[1] >= 0.0;
        let (x, y) = (at[0] as usize, at[1] as usize);
        if !inside || x >= self.usable.width || y >= self.usable.height || !self.usable.value_at(x, y) {
            return None;
        }
        // Rays that just miss the scan do not speak against a point that the mask holds.
        let seen = *self.depth.value_at(x, y);
        let other = seen.is_finite() && (seen - depth as f32).abs() > self.margin;
        (!other).then_some(at)
    }
}

#[cfg(test)]
mod tests {
    use crate::surface::occluders::*;

    /// Two parallel squares, facing -z, at z = 0 and (smaller) at z = -1.
    fn squares() -> Mesh {
        let square = |s: f32, z: f32| [[-s, -s, z], [s, -s, z], [s, s, z], [-s, s, z]];
        Mesh {
            positions: [square(1.0, 0.0), square(0.3, -1.0)].concat(),
            triangles: vec![[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]],
        }
    }

    fn camera() -> Camera {
        Camera {
            width: 64,
            height: 64,
            focal: [64.0; 2],
            principal: [32.0; 2],
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0, 0.0, 4.0],
        }
    }

    #[test]
    fn the_nearer_square_hides_the_farther() {
        let (mesh, camera) = (squares(), camera());
        let occluders = Occluders::new(&mesh);
        let centre = camera.centre();
        assert!(!occluders.is_visible([0.1, 0.05, 0.0], centre));
        assert!(occluders.is_visible([0.8, 0.1, 0.0], centre));
        assert!(occluders.is_visible([0.1, 0.05, -1.0], centre));
        let hit = occluders.first_hit(&camera, [32.0, 34.0]).unwrap();
        assert!(hit.triangle >= 2 && (hit.depth - 3.0).abs() < 1e-6, "{hit:?}");
        let depth = occluders.depth_map(&camera);
        assert_eq!(*depth.value_at(1, 1), f32::INFINITY);
        assert!((*depth.value_at(20, 32) - 4.0).abs() < 1e-5);
        // Rays that single precision does not hold meet nothing, and nothing hides such a camera.
        let wide = Camera { focal: [64.0, 1e-44], ..camera };
        assert!(occluders.first_hit(&wide, [32.0, 34.0]).is_none());
        assert!(occluders.is_visible([0.8, 0.1, 0.0], [1e200, 0.0, 0.0]));
    }

    /// The hierarchy's costs are single-precision areas; infinite ones would lead it astray.
    #[test]
    fn hierarchies_of_any_extent_are_built() {
        for scale in [0.0, 1e-40, 1e-20, 1e-3, 1e6, 1e11, 1e15, 1e25, f32::MAX, f32::NAN] {
            let positions = (0..40).map(|k| [(k % 7) as f32 * scale, (k % 5) as f32 * scale, (k % 3) as f32 * scale]);
            let triangles = (0..38).map(|k| [k, k + 1, k + 2]).collect();
            let occluders = Occluders::new(&Mesh { positions: positions.collect(), triangles });
            assert_eq!(occluders.triangles.len(), 38);
            let met = occluders.first_hit_from([2.2 * scale, 1.1 * scale, -9.0 * scale], [0.0, 0.0, 1.0]).is_some();
            assert_eq!(met, (1e-3..=1e11).contains(&scale), "extent {scale:e}");
        }
    }

    #[test]
    fn edges_and_missing_pixels_keep_their_distance() {
        let (mesh, camera) = (squares(), camera());
        let occluders = Occluders::new(&mesh);
        let mut image = RgbImage::filled(64, 64, [0.5; 3]);
        image.value_at_mut(20, 32)[1] = f32::NAN;
        let footprint = Footprint::new(&occluders, &mesh, &camera, None, &[image]);
        let at = |x: f64, y: f64| {
            let ray = camera.ray([x, y]);
            let centre = camera.centre();
            footprint.project(std::array::from_fn(|i| centre[i] + 4.0 * ray[i]))
        };
        assert!(at(22.5, 20.5).is_some());
        assert!(at(20.9, 32.4).is_none(), "on a missing pixel");
        assert!(at(26.2, 33.0).is_none(), "behind the nearer square");
        assert!(at(10.0, 10.0).is_none(), "beside the mesh");
    }
}
