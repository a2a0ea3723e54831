//! The shadow that an object casts on the ground it is put on, and the picture of both (Sonoda 2011, equations 16 and 17).

use super::cameras::bounds;
use super::octahedral::texel_direction;
use super::scene::Relit;
use super::shadow::ShadowMap;
use super::surround::Surround;
use crate::asset::{Camera, Mesh};
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::surface::visibility::Occluders;
use glam::{Vec2, Vec3};

/// Side of the grid of directions that light is summed over.
const DIRECTIONS: usize = 32;
/// Points of the ground along each side at which its light is computed.
const POINTS: usize = 72;
/// Half the side of that part of the ground, in radii of the object.
const EXTENT: f32 = 4.0;

/// A plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// A point of it.
    pub point: [f64; 3],
    /// Unit normal, upwards.
    pub up: [f64; 3],
}

impl Ground {
    /// The plane under the mesh's lowest vertex.
    pub fn below(mesh: &Mesh, up: [f64; 3]) -> Self {
        let height = |p: &&[f32; 3]| (0..3).map(|k| p[k] as f64 * up[k]).sum::<f64>();
        let lowest = mesh.positions.iter().min_by(|a, b| height(a).total_cmp(&height(b)));
        Ground { point: lowest.map_or([0.0; 3], |p| p.map(f64::from)), up }
    }
}

/// For each pixel that sees the ground the light on it with the object over the light without, red, green, blue (17); 1 elsewhere.
pub fn ground_shadow(mesh: &Mesh, surround: &Surround, ground: &Ground, camera: &Camera) -> Result<RgbImage> {
    let up = single(ground.up);
    if (up.length() - 1.0).abs() > 1e-3 {
        return Err(Error::parameter("the ground's normal is not a unit vector"));
    }
    let (middle, radius) = bounds(mesh);
    let (middle, reach) = (single(middle), radius as f32 * EXTENT);
    let origin = middle - up * (middle - single(ground.point)).dot(up);
    let (x, y) = up.any_orthonormal_pair();
    let occluders = Occluders::new(mesh);
    let cells = surround.cells(DIRECTIONS);
    let directions: Vec<Vec3> =
        (0..cells.len()).map(|k| texel_direction(DIRECTIONS, k % DIRECTIONS, k / DIRECTIONS)).collect();
    let lit: Vec<(Vec3, Vec3)> =
        directions.iter().zip(&cells).map(|(&d, &l)| (d, l * d.dot(up))).filter(|&(d, _)| d.dot(up) > 0.0).collect();
    let whole: Vec3 = lit.iter().map(|&(_, light)| light).sum();
    // What the object takes from the light of the levels, on a grid, denser in the middle.
    let place = |k: usize| {
        let t = 2.0 * k as f32 / (POINTS - 1) as f32 - 1.0;
        t * t.abs() * reach
    };
    let taken: Vec<Vec3> = crate::parallel::map(POINTS * POINTS, |k| {
        let point = origin + x * place(k % POINTS) + y * place(k / POINTS) + up * (radius as f32 * 1e-3);
        let to_middle = middle - point;
        let (distance, radius) = (to_middle.length(), radius as f32);
        lit.iter()
            .filter(|(d, _)| {
                // Rays that pass by the sphere around the object are free.
                let along = d.dot(to_middle);
                distance < radius || (along > 0.0 && distance * distance - along * along < radius * radius)
            })
            .filter(|(d, _)| !occluders.free(point.to_array(), d.to_array()))
            .map(|&(_, light)| light)
            .sum()
    });
    let taken = Grid { width: POINTS, height: POINTS, data: taken };
    let maps: Vec<(Vec3, f64, Option<ShadowMap>)> = surround
        .distant
        .iter()
        .filter(|light| Vec3::from_array(light.direction).dot(up) > 0.0)
        .map(|light| {
            let direction = Vec3::from_array(light.direction);
            let position = (middle + 40.0 * radius as f32 * direction).as_dvec3().to_array();
            let irradiance = Vec3::from_array(light.irradiance) * direction.dot(up);
            (irradiance, Surround::disc(light), ShadowMap::distant(mesh, position))
        })
        .collect();
    let all = whole + maps.iter().map(|(light, ..)| *light).sum::<Vec3>();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let centre = single(camera.centre());
    let rows = crate::parallel::map(height, |row| {
        let pixel = |column: usize| {
            let ray = single(camera.ray([column as f64 + 0.5, row as f64 + 0.5]));
            let t = (origin - centre).dot(up) / ray.dot(up);
            if !(t.is_finite() && t > 0.0) {
                return [1.0; 3];
            }
            let point = centre + ray * t;
            let at = Vec2::new((point - origin).dot(x), (point - origin).dot(y));
            let mut light = all - between(&taken, at, reach);
            for (part, disc, map) in &maps {
                if let Some(map) = map {
                    light -= *part * (1.0 - map.soft_reach(point.as_dvec3().to_array(), ground.up, *disc) as f32);
                }
            }
            let ratio = light.max(Vec3::ZERO) / all.max(Vec3::splat(1e-20));
            ratio.min(Vec3::ONE).to_array()
        };
        (0..width).map(pixel).collect::<Vec<_>>()
    });
    Ok(Grid { width, height, data: rows.concat() })
}

/// Bilinear between the grid's points, nothing beyond them.
fn between(grid: &Grid<Vec3>, at: Vec2, reach: f32) -> Vec3 {
    let place = |t: f32| {
        let t = t / reach;
        (t.abs().sqrt().copysign(t) + 1.0) * 0.5 * (POINTS - 1) as f32
    };
    let (u, v) = (place(at.x), place(at.y));
    let last = (POINTS - 1) as f32;
    if !(u >= 0.0 && v >= 0.0 && u < last && v < last) {
        return Vec3::ZERO;
    }
    let (column, row) = (u as usize, v as usize);
    let (s, t) = (u - column as f32, v - row as f32);
    let upper = grid.at(column, row).lerp(*grid.at(column + 1, row), s);
    let lower = grid.at(column, row + 1).lerp(*grid.at(column + 1, row + 1), s);
    upper.lerp(lower, t)
}

/// The object over a photograph, its shadow on the ground (16). All linear and of one size.
pub fn composite(photograph: &RgbImage, object: &Relit, shadow: &RgbImage) -> Result<RgbImage> {
    let size = (photograph.width, photograph.height);
    if size != (object.image.width, object.image.height) || size != (shadow.width, shadow.height) {
        return Err(Error::parameter("photograph, object and shadow differ in size"));
    }
    let pixel = |k: usize| {
        let behind = 1.0 - object.coverage.data[k];
        std::array::from_fn(|c| object.image.data[k][c] + behind * photograph.data[k][c] * shadow.data[k][c])
    };
    Ok(Grid { width: size.0, height: size.1, data: (0..photograph.data.len()).map(pixel).collect() })
}

fn single(v: [f64; 3]) -> Vec3 {
    Vec3::from_array(v.map(|x| x as f32))
}

#[cfg(test)]
mod tests {
    use super::super::{SurroundOptions, look_at};
    use super::*;
    use crate::lighting::Environment;

    #[test]
    fn a_plate_darkens_the_ground_below_it_as_quadrature_says() {
        // A square of side 2 at height 1 under an even sky.
        let positions = [[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]];
        let mesh = Mesh { positions: positions.to_vec(), triangles: vec![[0, 2, 1], [0, 3, 2]] };
        let environment = Environment::from_fn(128, |_| [1.0, 2.0, 0.5]);
        let surround = Surround::new(&environment, &SurroundOptions::default());
        let ground = Ground { point: [0.0; 3], up: [0.0, 1.0, 0.0] };
        // From below the plate's edge, so that the ground under it is seen.
        let camera = look_at([0.0, 0.9, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 100.0, 64, 64);
        let shadow = ground_shadow(&mesh, &surround, &ground, &camera).unwrap();
        // View factor of the square from the point below its middle: four corners of side 1 at distance 1.
        let corner = 2.0 / std::f64::consts::TAU * (1.0 / 2f64.sqrt()) * (1.0 / 2f64.sqrt()).atan();
        let free = 1.0 - 4.0 * corner;
        let (at, _) = camera.project([0.0; 3]).unwrap();
        let found = shadow.at(at[0] as usize, at[1] as usize);
        assert!((found[0] as f64 - free).abs() < 0.04 && (found[0] - found[1]).abs() < 1e-3, "{found:?} {free}");
        assert_eq!(*shadow.at(32, 2), [1.0; 3], "above the horizon");
    }
}
