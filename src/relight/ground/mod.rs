//! The shadow that an object casts on the ground it is put on, and the image of both (Sonoda 2011, equations 16 and 17).

// Frames of a camera alone read kept shadows.
#[cfg_attr(not(feature = "ar"), allow(dead_code))]
mod seen;

use super::environment_light::{BLURRED_SIDE, PreparedEnvironment};
use super::octahedral_map::texel_direction;
use super::scene::EnvironmentRender;
use super::shadow::ShadowMap;
use crate::error::{Error, Result};
use crate::image::{Grid, RgbImage};
use crate::mesh::Mesh;
use crate::surface::occluders::Occluders;
use crate::views::Camera;
use glam::{Vec2, Vec3, Vec3A};
pub use seen::ProjectedShadow;
use seen::{PlaneProjection, VISIBLE, between, grid_place};

#[cfg(any(test, feature = "ar"))]
pub(crate) use seen::RUN;

/// Side of the grid of directions that light is summed over.
const DIRECTIONS: usize = BLURRED_SIDE;
/// Points of the ground along each side at which its light is computed.
const POINTS: usize = 72;
/// Points along each side where ratios with sharp shadows are kept.
const KEPT_POINTS: usize = 320;
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

/// Returns for each pixel that sees the ground the light on it with the object over the light without, red, green, blue (17); 1 elsewhere.
///
/// # Errors
///
/// [`Error::Parameter`] if the ground's normal is no unit vector.
pub fn ground_shadow(
    mesh: &Mesh,
    surround: &PreparedEnvironment,
    ground: &Ground,
    camera: &Camera,
) -> Result<RgbImage> {
    let mut shadow = GroundShadow::new(mesh, ground)?;
    shadow.light(surround);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let view = PlaneProjection::new(camera, shadow.origin, &shadow.axes);
    let data = crate::parallel::map(width * height, |k| {
        let place = view.place([(k % width) as f32 + 0.5, (k / width) as f32 + 0.5]);
        place.map_or([1.0; 3], |at| shadow.ratio(at).to_array())
    });
    Ok(Grid { width, height, data })
}

/// The shadow of an object on a plane, for lights that change and cameras that move.
pub struct GroundShadow<'a> {
    mesh: &'a Mesh,
    ground: Ground,
    /// Middle and radius of the object; half the side of the part of the plane that may be darkened.
    middle: Vec3,
    radius: f32,
    reach: f32,
    /// The point below the middle, the plane's normal and its other axes.
    origin: Vec3,
    axes: [Vec3; 3],
    /// Cells of the grid of directions above the plane and their cosines.
    above: Vec<(u32, f32)>,
    /// For each point of the plane the entries of `above` that the object blocks, one list after the other, and where they begin.
    blocked: Vec<u16>,
    starts: Vec<u32>,
    light: GroundLight,
    /// Ratios less 1, and the lower and upper corner of what they darken.
    texture: Grid<Vec3A>,
    dark: [Vec2; 2],
}

/// Light on the plane.
#[derive(Default)]
struct GroundLight {
    /// Irradiance without the object.
    all: Vec3,
    /// Irradiance that the object blocks of the prefiltered light, on a grid that is denser in the middle.
    taken: Grid<Vec3A>,
    /// Distant lights: irradiance, radius, depth map.
    maps: Vec<(Vec3, f64, Option<ShadowMap>)>,
}

impl<'a> GroundShadow<'a> {
    /// Casts the rays, which serve for every light.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if the ground's normal is no unit vector.
    pub fn new(mesh: &'a Mesh, ground: &Ground) -> Result<Self> {
        let up = single(ground.up);
        if (up.length() - 1.0).abs() > 1e-3 {
            return Err(Error::parameter("the ground's normal is not a unit vector"));
        }
        let (middle, radius) = mesh.bounding_sphere();
        let (middle, radius) = (single(middle), radius as f32);
        let reach = radius * EXTENT;
        let origin = middle - up * (middle - single(ground.point)).dot(up);
        let (x, y) = up.any_orthonormal_pair();
        let directions: Vec<(u32, Vec3)> = (0..DIRECTIONS * DIRECTIONS)
            .map(|k| (k as u32, texel_direction(DIRECTIONS, k % DIRECTIONS, k / DIRECTIONS)))
            .filter(|(_, d)| d.dot(up) > 0.0)
            .collect();
        let occluders = Occluders::new(mesh);
        let place = |k: usize| {
            let t = 2.0 * k as f32 / (POINTS - 1) as f32 - 1.0;
            t * t.abs() * reach
        };
        let lists: Vec<Vec<u16>> = crate::parallel::map(POINTS * POINTS, |k| {
            let point = origin + x * place(k % POINTS) + y * place(k / POINTS) + up * (radius * 1e-3);
            let to_middle = middle - point;
            let distance = to_middle.length();
            let blocked = directions.iter().enumerate().filter(|(_, (_, d))| {
                // Rays that pass by the sphere around the object are free.
                let along = d.dot(to_middle);
                let near = distance < radius || (along > 0.0 && distance * distance - along * along < radius * radius);
                near && !occluders.is_free(point.to_array(), d.to_array())
            });
            blocked.map(|(entry, _)| entry as u16).collect()
        });
        let mut starts = vec![0];
        lists.iter().for_each(|list| starts.push(starts.last().copied().unwrap_or(0) + list.len() as u32));
        Ok(GroundShadow {
            mesh,
            ground: *ground,
            middle,
            radius,
            reach,
            origin,
            axes: [up, x, y],
            above: directions.into_iter().map(|(k, d)| (k, d.dot(up))).collect(),
            blocked: lists.concat(),
            starts,
            light: GroundLight::default(),
            texture: Grid::default(),
            dark: [Vec2::ZERO; 2],
        })
    }

    /// Takes a light, in the axes of the mesh.
    pub fn light(&mut self, surround: &PreparedEnvironment) {
        self.take(surround, &surround.cell_flux(DIRECTIONS));
    }

    /// Takes a light blurred by some degrees, in a fraction of the time of [`Self::light`].
    pub fn light_blurred(&mut self, surround: &PreparedEnvironment) {
        self.take(surround, surround.blurred_cell_flux());
    }

    fn take(&mut self, surround: &PreparedEnvironment, cells: &[Vec3]) {
        let up = self.axes[0];
        let lit: Vec<Vec3> = self.above.iter().map(|&(k, cosine)| cells[k as usize] * cosine).collect();
        let whole: Vec3 = lit.iter().sum();
        let list = |k: usize| &self.blocked[self.starts[k] as usize..self.starts[k + 1] as usize];
        let taken = crate::parallel::map(POINTS * POINTS, |k| {
            list(k).iter().map(|&entry| lit[entry as usize]).sum::<Vec3>().into()
        });
        let maps: Vec<(Vec3, f64, Option<ShadowMap>)> = surround
            .distant
            .iter()
            .filter(|light| Vec3::from_array(light.direction).dot(up) > 0.0)
            .map(|light| {
                let direction = Vec3::from_array(light.direction);
                let position = (self.middle + 40.0 * self.radius * direction).as_dvec3().to_array();
                let irradiance = Vec3::from_array(light.irradiance) * direction.dot(up);
                (irradiance, PreparedEnvironment::disc_radius(light), ShadowMap::for_distant_light(self.mesh, position))
            })
            .collect();
        let all = whole + maps.iter().map(|(light, ..)| *light).sum::<Vec3>();
        self.light = GroundLight { all, taken: Grid { width: POINTS, height: POINTS, data: taken }, maps };
        (self.texture, self.dark) = (Grid::default(), [Vec2::ZERO; 2]);
    }

    /// Keeps the ratios of the light on a grid of the plane, which [`Self::project`] reads: sums over distant lights are slow.
    pub fn keep(&mut self) {
        let side = if self.light.maps.is_empty() { POINTS } else { KEPT_POINTS };
        let place = |k: usize| {
            let t = 2.0 * k as f32 / (side - 1) as f32 - 1.0;
            t * t.abs() * self.reach * 0.9999
        };
        let data = crate::parallel::map(side * side, |k| {
            Vec3A::from(self.ratio(Vec2::new(place(k % side), place(k / side))) - 1.0)
        });
        let (mut low, mut high) = ([side; 2], [0; 2]);
        for (k, _) in data.iter().enumerate().filter(|(_, less)| less.min_element() < VISIBLE - 1.0) {
            let node = [k % side, k / side];
            (low, high) = (std::array::from_fn(|i| low[i].min(node[i])), std::array::from_fn(|i| high[i].max(node[i])));
        }
        // Up to the nodes around those.
        self.dark = match low[0] < side {
            true => [
                Vec2::from_array(low.map(|k| place(k.saturating_sub(1)))),
                Vec2::from_array(high.map(|k| place((k + 1).min(side - 1)))),
            ],
            false => [Vec2::ZERO; 2],
        };
        self.texture = Grid { width: side, height: side, data };
    }

    /// The kept ratios as a camera sees them.
    pub fn project(&self, camera: &Camera) -> ProjectedShadow<'_> {
        ProjectedShadow {
            view: PlaneProjection::new(camera, self.origin, &self.axes),
            texture: &self.texture,
            reach: self.reach,
            dark: self.dark,
        }
    }

    fn ratio(&self, at: Vec2) -> Vec3 {
        let GroundLight { all, taken, maps } = &self.light;
        let [_, x, y] = self.axes;
        let point = self.origin + x * at.x + y * at.y;
        let mut light = *all;
        let last = taken.width.saturating_sub(1) as f32;
        let place = grid_place(at, self.reach, last);
        if (place.cmpge(Vec2::ZERO) & place.cmplt(Vec2::splat(last))).all() {
            let (column, row) = (place.x as usize, place.y as usize);
            let within = place - Vec2::new(column as f32, row as f32);
            light -= Vec3::from(between(taken, row * taken.width + column, within.x, within.y));
        }
        for (part, disc, map) in maps {
            if let Some(map) = map {
                light -= *part * (1.0 - map.soft_visibility(point.as_dvec3().to_array(), self.ground.up, *disc) as f32);
            }
        }
        (light.max(Vec3::ZERO) / all.max(Vec3::splat(1e-20))).min(Vec3::ONE)
    }
}

/// Blends the object and its shadow with a photograph (16). All are linear and of one size.
///
/// # Errors
///
/// [`Error::Parameter`] if the sizes differ.
pub fn composite(photograph: &RgbImage, object: &EnvironmentRender, shadow: &RgbImage) -> Result<RgbImage> {
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
    use super::super::{PreparedEnvironmentOptions, look_at};
    use super::*;
    use crate::lighting::EnvironmentMap;

    #[test]
    fn a_plate_darkens_the_ground_below_it_as_quadrature_says() {
        // A square of side 2 at height 1 under an even sky.
        let positions = [[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]];
        let mesh = Mesh { positions: positions.to_vec(), triangles: vec![[0, 2, 1], [0, 3, 2]] };
        let environment = EnvironmentMap::from_fn(128, |_| [1.0, 2.0, 0.5]);
        let surround = PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default());
        let ground = Ground { point: [0.0; 3], up: [0.0, 1.0, 0.0] };
        // From below the plate's edge, so that the ground under it is seen.
        let camera = look_at([0.0, 0.9, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 100.0, 64, 64);
        let shadow = ground_shadow(&mesh, &surround, &ground, &camera).unwrap();
        // View factor of the square from the point below its middle: four corners of side 1 at distance 1.
        let corner = 2.0 / std::f64::consts::TAU * (1.0 / 2f64.sqrt()) * (1.0 / 2f64.sqrt()).atan();
        let free = 1.0 - 4.0 * corner;
        let (at, _) = camera.project([0.0; 3]).unwrap();
        let found = shadow.value_at(at[0] as usize, at[1] as usize);
        assert!((found[0] as f64 - free).abs() < 0.04 && (found[0] - found[1]).abs() < 1e-3, "{found:?} {free}");
        assert_eq!(*shadow.value_at(32, 2), [1.0; 3], "above the horizon");
    }

    #[test]
    fn kept_ratios_are_those_of_each_pixel() {
        let mesh = crate::surface::atlas::tests::bumpy_sphere(16);
        let sun = |d: [f64; 3]| d[0] * 0.48 + d[1] * 0.6 + d[2] * 0.64 > 0.999;
        let environment =
            EnvironmentMap::from_fn(256, |d| if sun(d) { [800.0, 700.0, 500.0] } else { [0.3, 0.4, 0.6] });
        let surround = PreparedEnvironment::new(&environment, &PreparedEnvironmentOptions::default());
        let ground = Ground::below(&mesh, [0.0, 1.0, 0.0]);
        let camera = look_at([2.0, 3.0, 5.0], [0.0, -0.5, 0.0], [0.0, 1.0, 0.0], 200.0, 160, 120);
        let exact = ground_shadow(&mesh, &surround, &ground, &camera).unwrap();
        let mut shadow = GroundShadow::new(&mesh, &ground).unwrap();
        shadow.light(&surround);
        shadow.keep();
        let seen = shadow.project(&camera);
        let kept = (0..160 * 120 / RUN).flat_map(|run| {
            let pixels: [usize; RUN] = std::array::from_fn(|k| run * RUN + k);
            let places = [pixels.map(|k| (k % 160) as f32 + 0.5), pixels.map(|k| (k / 160) as f32 + 0.5)];
            seen.ratios(&places).unwrap_or([Vec3A::ONE; RUN])
        });
        let squares = exact.data.iter().zip(kept).map(|(a, b)| (a[1] - b[1]).powi(2) as f64).sum::<f64>();
        let psnr = -10.0 * (squares / exact.data.len() as f64).log10();
        let dark = exact.data.iter().filter(|p| p[1] < 0.5).count();
        assert!(psnr > 40.0 && dark > 300, "{psnr} dB, {dark} dark pixels");
    }
}
