//! Still images of an object by samples, each shaded.

use super::antialiasing::{SampledRows, edges};
use super::multisample::VisibilityBuffer;
use super::scene::{EnvironmentRender, RenderObject, ShadingPoint, between};
use crate::error::Result;
use crate::image::Grid;
use crate::surface::raster::check_work;
use crate::views::Camera;
use glam::Vec3;

/// Diffuse and specular radiance of a sample; the number that it gets differs from sample to sample.
pub(super) trait Shade: Fn(&ShadingPoint, usize) -> [Vec3; 2] + Sync + Send {}
impl<F: Fn(&ShadingPoint, usize) -> [Vec3; 2] + Sync + Send> Shade for F {}

/// What a pixel shows.
struct ShadedPixel {
    /// Sums over the pixel, diffuse and specular.
    parts: [Vec3; 2],
    /// Samples that show the object.
    hits: u32,
    coverage: f32,
}

/// Draws the object with `samples` samples of a pixel along each side, those at its outline anew with more, and shades each.
///
/// # Errors
///
/// [`Error::Limits`](crate::Error::Limits) where drawing the object at this size is too much work.
pub(super) fn render_samples(
    object: &RenderObject,
    camera: &Camera,
    samples: u32,
    shade: impl Shade,
) -> Result<EnvironmentRender> {
    let mut pixels = shade_evenly(object, camera, samples, &shade)?;
    let hits: Vec<u32> = pixels.iter().map(|pixel| pixel.hits).collect();
    for (rows, edges) in edges(camera, samples, &hits) {
        let raster = draw(object, &rows.camera);
        let shaded = crate::parallel::map(edges.len(), |k| shade_pixel(object, &raster, &rows, edges[k], &shade));
        edges.into_iter().zip(shaded).for_each(|(pixel, shaded)| pixels[pixel] = shaded);
    }
    Ok(image(camera, &pixels))
}

/// The same, with as many samples of each pixel.
#[cfg(all(test, feature = "encode"))]
pub(super) fn render_evenly(
    object: &RenderObject,
    camera: &Camera,
    samples: u32,
    shade: impl Shade,
) -> Result<EnvironmentRender> {
    Ok(image(camera, &shade_evenly(object, camera, samples, &shade)?))
}

fn shade_evenly(object: &RenderObject, camera: &Camera, samples: u32, shade: &impl Shade) -> Result<Vec<ShadedPixel>> {
    let rows = SampledRows::whole(camera, samples);
    check_work(object.mesh, &rows.camera)?;
    if let Some((_, base)) = object.surface {
        // Displaced, the surface may fill less of the picture than its mesh.
        check_work(base, &rows.camera)?;
    }
    let raster = draw(object, &rows.camera);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let line = |y| (y * width..(y + 1) * width).map(|k| shade_pixel(object, &raster, &rows, k, shade)).collect();
    let lines: Vec<Vec<ShadedPixel>> = crate::parallel::map(height, line);
    Ok(lines.into_iter().flatten().collect())
}

/// Draws the object: its surface, and behind it the mesh that the surface lies on, where only that is met. What photographs say of silhouettes
/// is in the mesh.
fn draw(object: &RenderObject, camera: &Camera) -> VisibilityBuffer {
    let mut raster = VisibilityBuffer::default();
    raster.draw(object.mesh, camera);
    if let Some((_, base)) = object.surface {
        let mut behind = VisibilityBuffer::default();
        behind.draw(base, camera);
        raster.put_behind(&behind, object.mesh.triangles.len() as u32);
    }
    raster
}

fn shade_pixel(
    object: &RenderObject,
    raster: &VisibilityBuffer,
    rows: &SampledRows,
    pixel: usize,
    shade: &impl Shade,
) -> ShadedPixel {
    let centre = Vec3::from_array(rows.camera.centre().map(|x| x as f32));
    let (mut sum, mut hits) = ([Vec3::ZERO; 2], 0);
    for sample in rows.samples_of(pixel).filter(|&sample| raster.is_covered(sample)) {
        hits += 1;
        let point = surface_point(object, raster, sample, centre);
        if point.normal.dot(point.outgoing) > 0.0 {
            let parts = shade(&point, rows.number(sample));
            sum = [sum[0] + parts[0], sum[1] + parts[1]];
        }
    }
    let share = rows.share();
    ShadedPixel { parts: sum.map(|part| part * share), hits, coverage: hits as f32 * share }
}

fn image(camera: &Camera, pixels: &[ShadedPixel]) -> EnvironmentRender {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let plane = |value: fn(&ShadedPixel) -> Vec3| Grid {
        width,
        height,
        data: pixels.iter().map(|pixel| value(pixel).to_array()).collect(),
    };
    EnvironmentRender {
        image: plane(|pixel| pixel.parts[0] + pixel.parts[1]),
        diffuse: plane(|pixel| pixel.parts[0]),
        coverage: Grid { width, height, data: pixels.iter().map(|pixel| pixel.coverage).collect() },
    }
}

/// Cosine to the camera, about, that normals of the mesh behind a surface have at least: the surface may look away there.
const LEAST_COSINE: f32 = 0.05;

fn surface_point(object: &RenderObject, raster: &VisibilityBuffer, sample: usize, centre: Vec3) -> ShadingPoint {
    let triangle = raster.triangle[sample] as usize;
    // Triangles of the mesh that a surface lies on come after those of the surface.
    let behind = triangle.checked_sub(object.mesh.triangles.len());
    let (mesh, triangle) = behind.map_or((object.mesh, triangle), |triangle| (object.base(), triangle));
    let corners = mesh.triangles[triangle];
    let [b, c] = raster.weights[sample];
    let weights = Vec3::new(1.0 - b - c, b, c);
    let [p, q, r] = corners.map(|v| Vec3::from_array(mesh.positions[v as usize]));
    let position = p * weights.x + q * weights.y + r * weights.z;
    let outgoing = (centre - position).normalize_or(Vec3::Z);
    let interpolated = |around| between(around, &object.normals).normalize_or(Vec3::Z);
    let (sites, normal) = match behind {
        None => (object.sites(triangle, weights, position), interpolated((corners, weights))),
        Some(_) => {
            let sites = object.sites_on_mesh(triangle, weights, position);
            let normal = interpolated(sites.samples);
            let missing = (LEAST_COSINE - normal.dot(outgoing)).max(0.0);
            (sites, (normal + missing * outgoing).normalize_or(Vec3::Z))
        }
    };
    let geometric = (q - p).cross(r - p).normalize_or(normal);
    let geometric = if geometric.dot(outgoing) < 0.0 { -geometric } else { geometric };
    // None on surfaces, nor on the mesh behind one.
    let tangent = object.tangent(triangle, weights);
    ShadingPoint { position, normal, geometric, outgoing, tangent, sites }
}
