//! A kept shadow in the image of a camera.

use crate::image::Grid;
use crate::views::Camera;
use glam::{DVec3, Vec2, Vec3, Vec3A};

/// Pixels that [`ProjectedShadow::ratios`] takes at a time.
pub(crate) const RUN: usize = 64;
/// Ratios above this change no pixel of 8 bits.
pub(super) const VISIBLE: f32 = 0.997;

/// Projection of an image's pixels onto the plane.
pub(super) struct PlaneProjection {
    /// For the plane's normal and its other axes the component of a ray, for column, row and 1, and that of the camera's centre.
    axes: [(Vec3, f32); 3],
}

impl PlaneProjection {
    /// Prepares the projection onto a plane through `origin` with a normal and two more axes.
    pub(super) fn new(camera: &Camera, origin: Vec3, axes: &[Vec3; 3]) -> Self {
        let centre = Vec3::from_array(camera.centre().map(|x| x as f32)) - origin;
        // Over the image the rays change evenly; the small differences are taken in double precision.
        let [first, right, below] =
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|pixel| DVec3::from_array(camera.ray(pixel)));
        let axes = axes.map(|axis| {
            let along = [right - first, below - first, first].map(|d| d.dot(axis.as_dvec3()));
            (DVec3::from_array(along).as_vec3(), centre.dot(axis))
        });
        PlaneProjection { axes }
    }

    /// Returns the point of the plane that a position in the image, in pixels, shows.
    pub(super) fn place(&self, pixel: [f32; 2]) -> Option<Vec2> {
        let (in_front, at) = self.place_on_plane(pixel);
        in_front.then_some(at)
    }

    /// Returns whether the point lies before the camera, and the point.
    #[inline(always)]
    fn place_on_plane(&self, [x, y]: [f32; 2]) -> (bool, Vec2) {
        let along = |axis: Vec3| axis.x * x + axis.y * y + axis.z;
        let [(up, above), (first, beside), (second, beyond)] = self.axes;
        let t = -above / along(up);
        ((t > 0.0) & (t < f32::INFINITY), Vec2::new(beside + t * along(first), beyond + t * along(second)))
    }
}

/// A kept shadow in a camera's image.
pub struct ProjectedShadow<'a> {
    pub(super) view: PlaneProjection,
    pub(super) texture: &'a Grid<Vec3A>,
    pub(super) reach: f32,
    pub(super) dark: [Vec2; 2],
}

impl ProjectedShadow<'_> {
    /// Returns the ratios at positions in the image, x and y in pixels, 1 where nothing is darkened; `None` if that is so everywhere.
    pub(crate) fn ratios(&self, [x, y]: &[[f32; RUN]; 2]) -> Option<[Vec3A; RUN]> {
        let [low, high] = self.dark;
        let width = self.texture.width;
        let last = width.saturating_sub(1) as f32;
        // Cells of the kept grid and places within them, the first cell and -1 beyond what is dark; without branches, so that several are
        // worked out at a time.
        let (mut cells, mut across, mut down) = ([0i32; RUN], [-1.0f32; RUN], [0.0f32; RUN]);
        for k in 0..RUN {
            let (in_front, at) = self.view.place_on_plane([x[k], y[k]]);
            let dark = in_front & (at.x > low.x) & (at.x < high.x) & (at.y > low.y) & (at.y < high.y);
            let place = grid_place(at, self.reach, last);
            let (column, row) = ((place.x as i32) as f32, (place.y as i32) as f32);
            // Exact below 2^24.
            let cell = row * width as f32 + column;
            cells[k] = if dark { cell as i32 } else { 0 };
            across[k] = if dark { place.x - column } else { -1.0 };
            down[k] = place.y - row;
        }
        if across.iter().all(|&part| part < 0.0) {
            return None;
        }
        let mut ratios = [Vec3A::ONE; RUN];
        for (k, ratio) in ratios.iter_mut().enumerate() {
            if across[k] >= 0.0 {
                *ratio += between(self.texture, cells[k] as usize, across[k], down[k]);
            }
        }
        Some(ratios)
    }
}

/// Maps a point of the plane to a grid that is denser in the middle.
#[inline(always)]
pub(super) fn grid_place(at: Vec2, reach: f32, last: f32) -> Vec2 {
    let t = at / reach;
    let root = Vec2::new(t.x.abs().sqrt().copysign(t.x), t.y.abs().sqrt().copysign(t.y));
    (root + 1.0) * (0.5 * last)
}

/// Bilinear in a cell of the grid, given by its first corner.
#[inline]
pub(super) fn between(grid: &Grid<Vec3A>, cell: usize, across: f32, down: f32) -> Vec3A {
    let (upper, lower) = (&grid.data[cell..cell + 2], &grid.data[cell + grid.width..cell + grid.width + 2]);
    upper[0].lerp(upper[1], across).lerp(lower[0].lerp(lower[1], across), down)
}
