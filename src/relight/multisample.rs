//! Which triangle each sample of an image shows, drawn band by band in parallel, in single precision: for images that need not be the
//! same to the last bit everywhere (what decoding predicts from is [`crate::surface::raster`]).

use crate::mesh::Mesh;
use crate::parallel::for_each_chunk_pair;
use crate::surface::raster::NO_TRIANGLE;
use crate::views::Camera;

/// Rows of a band.
const BAND: usize = 8;
/// Nearest depth drawn, as a share of the mesh's farthest vertex; triangles that reach nearer are dropped.
const NEAR: f64 = 1e-6;

/// Visibility buffer: triangle and barycentric weights of every sample. Its memory is used again for the next image.
#[derive(Default)]
pub(super) struct VisibilityBuffer {
    pub(super) width: usize,
    pub(super) height: usize,
    /// [`NO_TRIANGLE`] where nothing is hit.
    pub(super) triangle: Vec<u32>,
    /// Perspective-correct weights of the second and third corner.
    pub(super) weights: Vec<[f32; 2]>,
    projected: Vec<[f32; 3]>,
    /// Triangles of each band, one list after the other, and where the lists begin.
    lists: Vec<u32>,
    starts: Vec<u32>,
}

impl VisibilityBuffer {
    /// Whether a sample shows the object.
    #[inline]
    pub(super) fn is_covered(&self, index: usize) -> bool {
        self.triangle[index] != NO_TRIANGLE
    }

    /// Draws the mesh as `camera` sees it; triangles are two-sided.
    pub(super) fn draw(&mut self, mesh: &Mesh, camera: &Camera) {
        (self.width, self.height) = (camera.width as usize, camera.height as usize);
        self.project(mesh, camera);
        self.sort_into_bands(mesh);
        let VisibilityBuffer { triangle, weights, projected, lists, starts, .. } = self;
        let (width, height) = (self.width, self.height);
        triangle.resize(width * height, NO_TRIANGLE);
        weights.resize(width * height, [0.0; 2]);
        for_each_chunk_pair(triangle, weights, width * BAND, |band, triangles, weights| {
            triangles.fill(NO_TRIANGLE);
            let list = &lists[starts[band] as usize..starts[band + 1] as usize];
            let target = SampleBand { first_row: band * BAND, width, triangles, weights };
            target.fill(mesh, projected, list);
        });
    }

    /// Puts what `other` shows of another mesh behind what this one shows, from the same camera: where nothing is hit. Its triangles are
    /// numbered from `first` on.
    pub(super) fn put_behind(&mut self, other: &VisibilityBuffer, first: u32) {
        for index in (0..self.triangle.len()).filter(|&index| other.is_covered(index)) {
            if !self.is_covered(index) {
                self.triangle[index] = first + other.triangle[index];
                self.weights[index] = other.weights[index];
            }
        }
    }

    fn project(&mut self, mesh: &Mesh, camera: &Camera) {
        let depth = |p: &[f32; 3]| camera.to_camera(p.map(f64::from))[2];
        let farthest = mesh.positions.iter().map(depth).fold(0.0, f64::max);
        self.projected.clear();
        self.projected.extend(mesh.positions.iter().map(|p| {
            let q = camera.to_camera(p.map(f64::from));
            // Not drawn: an inverse depth of 0.
            if !(q[2] > NEAR * farthest && q[2].is_finite()) {
                return [0.0; 3];
            }
            let inverse = 1.0 / q[2];
            let at = |k: usize| (camera.focal[k] * q[k] * inverse + camera.principal[k]) as f32;
            [at(0), at(1), inverse as f32]
        }));
    }

    /// Counting sort of the triangles by the bands that they touch.
    fn sort_into_bands(&mut self, mesh: &Mesh) {
        let bands = self.height.div_ceil(BAND);
        let reach = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| self.projected[v as usize]);
            if a[2] * b[2] * c[2] <= 0.0 {
                return 0..0;
            }
            let low = (a[1].min(b[1]).min(c[1]) + 0.5).max(0.0) as usize;
            let high = (a[1].max(b[1]).max(c[1]) + 0.5).max(0.0) as usize;
            if low >= high.min(self.height) { 0..0 } else { low / BAND..(high.min(self.height) - 1) / BAND + 1 }
        };
        let mut starts = vec![0u32; bands + 1];
        mesh.triangles.iter().flat_map(reach).for_each(|band| starts[band + 1] += 1);
        (0..bands).for_each(|band| starts[band + 1] += starts[band]);
        let mut lists = std::mem::take(&mut self.lists);
        lists.resize(starts[bands] as usize, 0);
        let mut next = starts.clone();
        for (index, corners) in mesh.triangles.iter().enumerate() {
            for band in reach(corners) {
                lists[next[band] as usize] = index as u32;
                next[band] += 1;
            }
        }
        (self.lists, self.starts) = (lists, starts);
    }
}

/// A band of the image.
struct SampleBand<'a> {
    first_row: usize,
    width: usize,
    triangles: &'a mut [u32],
    weights: &'a mut [[f32; 2]],
}

impl SampleBand<'_> {
    fn fill(self, mesh: &Mesh, projected: &[[f32; 3]], list: &[u32]) {
        let SampleBand { first_row, width, triangles, weights } = self;
        let rows = triangles.len() / width;
        let mut nearest = vec![0.0f32; triangles.len()];
        for &index in list {
            let corners = mesh.triangles[index as usize];
            let c = corners.map(|v| projected[v as usize]);
            // Edge k runs between corners k + 1 and k + 2; evaluated from its lower vertex, so that both triangles at an edge round
            // alike and leave no crack.
            let edges: [([f32; 2], [f32; 2]); 3] = std::array::from_fn(|k| {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                let (a, b, sign) = if corners[i] <= corners[j] { (c[i], c[j], 1.0) } else { (c[j], c[i], -1.0) };
                ([a[0], a[1]], [sign * (b[0] - a[0]), sign * (b[1] - a[1])])
            });
            let low = |k: usize| (c[0][k].min(c[1][k]).min(c[2][k]) + 0.5).max(0.0) as usize;
            let high = |k: usize| (c[0][k].max(c[1][k]).max(c[2][k]) + 0.5).max(0.0) as usize;
            let (left, right) = (low(0), high(0).min(width));
            let (top, bottom) = (low(1).max(first_row), high(1).min(first_row + rows));
            if left >= right || top >= bottom {
                continue;
            }
            for row in top..bottom {
                let y = row as f32 + 0.5;
                let along = edges.map(|(a, d)| d[0] * (y - a[1]));
                let line = (row - first_row) * width;
                for x in left..right {
                    let px = x as f32 + 0.5;
                    let e: [f32; 3] = std::array::from_fn(|k| along[k] - edges[k].1[1] * (px - edges[k].0[0]));
                    let inside =
                        (e[0] >= 0.0 && e[1] >= 0.0 && e[2] >= 0.0) || (e[0] <= 0.0 && e[1] <= 0.0 && e[2] <= 0.0);
                    if !inside {
                        continue;
                    }
                    let area = e[0] + e[1] + e[2];
                    let shares = [e[0] * c[0][2], e[1] * c[1][2], e[2] * c[2][2]];
                    let sum = shares[0] + shares[1] + shares[2];
                    let here = sum / area;
                    if here > nearest[line + x] {
                        nearest[line + x] = here;
                        triangles[line + x] = index;
                        let scale = 1.0 / sum;
                        weights[line + x] = [shares[1] * scale, shares[2] * scale];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::look_at;
    use crate::relight::multisample::*;
    use crate::surface::raster::rasterise;

    #[test]
    fn bands_show_what_the_rasteriser_of_the_format_shows() {
        let mesh = crate::surface::atlas::tests::bumpy_sphere(16);
        let camera = look_at([0.3, 0.8, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 150.0, 123, 101);
        let exact = rasterise(&mesh, &camera);
        let mut samples = VisibilityBuffer::default();
        for _ in 0..2 {
            samples.draw(&mesh, &camera);
        }
        let (mut other, mut apart) = (0, 0.0f32);
        for k in 0..exact.triangle.len() {
            if exact.triangle[k] != samples.triangle[k] {
                other += 1;
            } else if exact.is_covered(k) {
                (0..2).for_each(|i| apart = apart.max((exact.barycentric[k][i] - samples.weights[k][i]).abs()));
            }
        }
        assert!(exact.coverage().count() > 3000 && other < 12 && apart < 2e-3, "{other} {apart}");
    }
}
