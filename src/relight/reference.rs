//! Direct light of an environment by brute force: rays drawn from the light and from the specular lobes, shadows cast exactly. The
//! yardstick of the evaluators; the same every time.

use super::appearance::{PreparedSpecular, ShadingModel, ShadingParameters};
use super::filtered::evaluate_brdf;
use super::sampled_view::render_samples;
use super::scene::{EnvironmentRender, RenderObject, ShadingPoint};
use crate::error::{Error, Result};
use crate::lighting::EnvironmentMap;
use crate::surface::occluders::Occluders;
use crate::views::Camera;
use glam::Vec3;

/// Options of [`reference()`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceOptions {
    /// Samples of a pixel along each side; from 2 on, twice as many along each side at the object's outline.
    pub samples: u32,
    /// Rays drawn from the light for each sample; half as many are drawn from the specular lobe.
    pub rays: usize,
    /// Whether the object shadows itself.
    pub shadows: bool,
}

impl Default for ReferenceOptions {
    fn default() -> Self {
        ReferenceOptions { samples: 2, rays: 256, shadows: true }
    }
}

/// Renders one image.
///
/// # Errors
///
/// [`Error::Parameter`] for samples out of 1 to 8, or no rays.
pub fn reference(
    object: &RenderObject,
    environment: &EnvironmentMap,
    camera: &Camera,
    look: &dyn ShadingModel,
    options: &ReferenceOptions,
) -> Result<EnvironmentRender> {
    if !(1..=8).contains(&options.samples) || options.rays == 0 {
        return Err(Error::parameter("an image needs 1 to 8 samples a side and at least one ray"));
    }
    let occluders = options.shadows.then(|| Occluders::new(object.mesh));
    let light = LightSampler::new(environment);
    render_samples(object, camera, options.samples, |point: &ShadingPoint, number| {
        let appearance = point.reflectance(look);
        let free = |direction: Vec3| {
            // Opaque from within: what shines on the far side of the triangle is blocked by the object itself.
            point.geometric.dot(direction) > 0.0
                && occluders.as_ref().is_none_or(|o| o.is_free(point.position.to_array(), direction.to_array()))
        };
        radiance(point, &appearance, &light, options, number as u64, &free)
    })
}

fn radiance(
    point: &ShadingPoint,
    appearance: &ShadingParameters,
    light: &LightSampler,
    options: &ReferenceOptions,
    number: u64,
    free: &dyn Fn(Vec3) -> bool,
) -> [Vec3; 2] {
    let frame = point.basis();
    let outgoing = frame.transpose() * point.outgoing;
    let highlights = appearance.highlights;
    let parts = highlights.iter().count();
    let from_lobes = if parts > 0 { options.rays / 2 } else { 0 };
    let reflectance = |incoming: Vec3| -> Vec3 {
        let sum: Vec3 = highlights.iter().map(|(scale, part)| scale * evaluate_brdf(part, incoming, outgoing)).sum();
        sum * highlights.fresnel(0.5 * (incoming + outgoing).length())
    };
    // Rays are drawn from the parts in turn.
    let density_of_lobes = |half: Vec3| {
        let density = |part: &PreparedSpecular| part.specular.density(half.as_dvec3().to_array()) as f32;
        let sum: f32 = highlights.iter().map(|(_, part)| density(part)).sum();
        sum / parts.max(1) as f32 / (4.0 * half.dot(outgoing)).max(1e-6)
    };
    let start = scattered(number);
    let mut sum = [Vec3::ZERO; 2];
    let mut add = |world: Vec3, incoming: Vec3, density_of_light: f32, density_of_lobes: f32| {
        let density = options.rays as f32 * density_of_light + from_lobes as f32 * density_of_lobes;
        if density > 0.0 && (!options.shadows || free(world)) {
            let radiance = Vec3::from_array(light.environment.radiance(world.as_dvec3().to_array()));
            let arriving = radiance * (incoming.z / density);
            sum[0] += appearance.diffuse(Vec3::ZERO, arriving * appearance.entering(incoming.z), outgoing.z);
            sum[1] += reflectance(incoming) * arriving;
        }
    };
    for k in 0..options.rays {
        let (world, density) = light.sample(place(start, k));
        let incoming = frame.transpose() * world;
        if incoming.z > 0.0 {
            add(world, incoming, density, density_of_lobes((incoming + outgoing).normalize_or(Vec3::Z)));
        }
    }
    for k in 0..from_lobes {
        let Some((_, part)) = highlights.iter().nth(k % parts) else { break };
        let [u, v] = place([start[1], start[0]], k / parts);
        let half = part.specular.sample([u as f64, v as f64]).as_vec3();
        let incoming = 2.0 * half.dot(outgoing) * half - outgoing;
        if incoming.z > 0.0 && half.dot(outgoing) > 0.0 {
            let world = frame * incoming;
            add(world, incoming, light.density(world), density_of_lobes(half));
        }
    }
    sum
}

/// Returns the k-th point of an even sequence in the unit square (Roberts 2018), moved by `start`.
fn place(start: [f32; 2], k: usize) -> [f32; 2] {
    const STEP: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    std::array::from_fn(|i| ((start[i] as f64 + STEP[i] * (k + 1) as f64).fract() as f32).min(0.999_999_9))
}

/// Two numbers below 1 that differ from sample to sample without pattern (SplitMix64).
fn scattered(number: u64) -> [f32; 2] {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    let unit = |bits: u64| (bits & 0xff_ffff) as f32 / (1 << 24) as f32;
    [unit(z), unit(z >> 32)]
}

/// Draws directions by the brightness of the environment.
struct LightSampler<'a> {
    environment: &'a EnvironmentMap,
    /// Running sums over rows, and within each row.
    rows: Vec<f64>,
    pixels: Vec<f64>,
    /// Density of each pixel, per solid angle.
    densities: Vec<f32>,
}

impl<'a> LightSampler<'a> {
    fn new(environment: &'a EnvironmentMap) -> Self {
        let image = environment.image();
        let (width, height) = (image.width, image.height);
        let brightness = |x: usize, y: usize| image.value_at(x, y).iter().sum::<f32>() as f64;
        // Radiance is read between pixels: each may be as bright as its neighbours.
        let spread = |x: usize, y: usize| {
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            rows.flat_map(|y| columns.map(|x| brightness(x, y))).fold(0.0, f64::max).mul_add(0.25, brightness(x, y))
        };
        let (mut rows, mut pixels, mut densities) = (vec![0.0], Vec::new(), Vec::new());
        for y in 0..height {
            let angle = environment.solid_angle(y);
            let mut sum = 0.0;
            for x in 0..width {
                let weight = spread(x, y) + 1e-9;
                sum += weight * angle;
                pixels.push(sum);
                densities.push(weight as f32);
            }
            rows.push(rows[y] + sum);
        }
        let total = rows[height];
        densities.iter_mut().for_each(|d| *d = (*d as f64 / total) as f32);
        LightSampler { environment, rows, pixels, densities }
    }

    /// A direction for two uniform numbers, and its density per solid angle.
    fn sample(&self, [u, v]: [f32; 2]) -> (Vec3, f32) {
        let image = self.environment.image();
        let (width, height) = (image.width, image.height);
        let wanted = u as f64 * self.rows[height];
        let y = self.rows.partition_point(|&sum| sum <= wanted).clamp(1, height) - 1;
        let row = &self.pixels[y * width..(y + 1) * width];
        let within = (wanted - self.rows[y]) / (self.rows[y + 1] - self.rows[y]).max(1e-300);
        let wanted = v as f64 * row[width - 1];
        let x = row.partition_point(|&sum| sum <= wanted).min(width - 1);
        let before = if x == 0 { 0.0 } else { row[x - 1] };
        let across = (wanted - before) / (row[x] - before).max(1e-300);
        // Even in solid angle within the row: linear in the cosine.
        let edge = |y: f64| (std::f64::consts::PI * y / height as f64).cos();
        let cosine = edge(y as f64) + within * (edge(y as f64 + 1.0) - edge(y as f64));
        let down = cosine.clamp(-1.0, 1.0).acos() / std::f64::consts::PI * height as f64;
        let direction = self.environment.direction(x as f64 + across, down);
        (Vec3::from_array(direction.map(|c| c as f32)), self.densities[y * width + x])
    }

    fn density(&self, direction: Vec3) -> f32 {
        let image = self.environment.image();
        let [x, y] = self.environment.pixel_at(direction.as_dvec3().to_array());
        let (x, y) = ((x as usize).min(image.width - 1), (y as usize).min(image.height - 1));
        self.densities[y * image.width + x]
    }
}
