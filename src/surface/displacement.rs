//! Section `DISP`: fine geometry as an image of displacements on the atlas.
//!
//! The mesh is subdivided linearly and each vertex is moved along the interpolated normal by what the image says at its place. The
//! image is coded like the maps of section `RFLC`. Normative text: `spec/displacement.md`.

#[cfg(feature = "encode")]
use super::atlas::AtlasRaster;
use super::atlas::{atlas_position, rasterise_atlas, sample_number};
use super::charts::Charts;
#[cfg(feature = "encode")]
use super::charts::NONE;
use super::raster::vertex_normals;
use super::subdivision::subdivide;
use crate::container::{Tag, push_f32};
use crate::entropy::RangeDecoder;
use crate::error::{Error, Result};
use crate::image::{Grid, Mask};
use crate::limits::Budget;
use crate::mesh::{Mesh, is_within_range};
use crate::quantise::bands::Quantiser;
#[cfg(feature = "encode")]
use crate::quantise::bands::RateDistortion;
use crate::residual::coefficients;
use crate::transform::shape_adaptive::{ColourLanes, WaveletPlan};
use crate::vector::dot;
use byteorder::{ByteOrder, LittleEndian};
use glam::DVec3;

const VERSION: u8 = 0;
/// Version, subdivisions, texels for one of the atlas, step in world units.
const HEADER_BYTES: usize = 3 + 4;
/// Subdivisions at most.
const MAX_LEVELS: u8 = 6;
/// Texels for one of the atlas each way, at most.
const MAX_DENSITY: u8 = 8;
/// The quantiser's step, in units of the image.
const STEP: f32 = 1.0;
/// Values stand this far below the middle of their interval, in steps.
const SHRINK: [f32; 2] = [0.08, 0.02];
/// Value of a bit in squared steps.
#[cfg(feature = "encode")]
const LAMBDA: f32 = 0.1;
/// Memory that decoding takes for a texel, and for a triangle of the finer mesh.
const BYTES_A_TEXEL: usize = 200;
const BYTES_A_TRIANGLE: usize = 160;

/// A surface of finer geometry than its mesh: the mesh subdivided, each vertex displaced.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplacedMesh {
    levels: u32,
    mesh: Mesh,
    normals: Vec<[f64; 3]>,
}

impl DisplacedMesh {
    /// Subdivides a mesh and moves each vertex along its interpolated normal by what `displacement` returns for it: for its index,
    /// a triangle of the coarse mesh that it lies on, and its place there.
    pub(crate) fn new(
        base: &Mesh,
        levels: u32,
        mut displacement: impl FnMut(usize, usize, [f64; 3]) -> f64,
    ) -> Result<Self> {
        let fine = subdivide(base, levels);
        let along = interpolated_normals(base, &fine);
        let mut mesh = fine.mesh;
        let mut is_placed = vec![false; mesh.positions.len()];
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            for vertex in corners.map(|vertex| vertex as usize) {
                if std::mem::replace(&mut is_placed[vertex], true) {
                    continue;
                }
                let place = mesh.positions[vertex].map(f64::from);
                let moved = displacement(vertex, triangle >> (2 * levels), place);
                mesh.positions[vertex] = std::array::from_fn(|k| (place[k] + moved * along[vertex][k]) as f32);
                if !is_within_range(&mesh.positions[vertex]) {
                    return Err(Error::format(Tag::DISPLACEMENT, 3u64, "a displacement leads beyond 1e12"));
                }
            }
        }
        Ok(DisplacedMesh { levels, normals: vertex_normals(&mesh), mesh })
    }
    /// Whether it is the surface of a mesh, by the number of triangles.
    pub(crate) fn is_of(&self, base: &Mesh) -> bool {
        base.triangles.len() << (2 * self.levels) == self.mesh.triangles.len()
    }
    /// The fine mesh; the `4^levels` children of each triangle of the coarse one stand together.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }
    /// Unit normals of the fine mesh's vertices.
    pub fn normals(&self) -> &[[f64; 3]] {
        &self.normals
    }
    /// Number of subdivisions.
    pub(crate) fn levels(&self) -> u32 {
        self.levels
    }
    /// The surface without its last `finer` subdivisions: fewer triangles, between vertices that are where they were.
    pub(crate) fn without_levels(&self, finer: u32) -> Mesh {
        let children = 1usize << (2 * finer);
        // Of the children the one at the first, at the second and at the third corner.
        let [second, third] = [(children - 1) / 3, (children - 1) / 3 * 2];
        let corners = |of: &[[u32; 3]]| [of[0][0], of[second][1], of[third][2]];
        let triangles: Vec<[u32; 3]> = self.mesh.triangles.chunks_exact(children).map(corners).collect();
        // Vertices of coarser levels come first.
        let vertices = triangles.iter().flatten().max().map_or(0, |&last| last as usize + 1);
        Mesh { positions: self.mesh.positions[..vertices].to_vec(), triangles }
    }
    /// Returns the fine triangle at a place of a coarse one, and the place there.
    pub(crate) fn finer(&self, triangle: usize, weights: [f64; 3]) -> (usize, [f64; 3]) {
        finer(triangle, weights, self.levels)
    }
    /// Returns the coarse triangle that a place of a fine one lies on, and the place there: the inverse of [`Self::finer`].
    pub(crate) fn coarser(&self, triangle: usize, weights: [f64; 3]) -> (usize, [f64; 3]) {
        coarser(triangle, weights, self.levels)
    }
    /// Position and unit normal at a place of a coarse triangle.
    pub(crate) fn point(&self, triangle: usize, weights: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let (triangle, weights) = self.finer(triangle, weights);
        let corners = self.mesh.triangles[triangle];
        let point =
            (0..3).map(|k| weights[k] * DVec3::from_array(self.mesh.positions[corners[k] as usize].map(f64::from)));
        let normal = super::atlas::smooth_normal(corners, weights, &self.normals);
        (point.sum::<DVec3>().to_array(), normal.to_array())
    }
}

/// Returns the descendant after some subdivisions at a place of a triangle, and the place there.
pub(crate) fn finer(triangle: usize, weights: [f64; 3], levels: u32) -> (usize, [f64; 3]) {
    (0..levels).fold((triangle, weights), |(triangle, [a, b, c]), _| {
        let (child, weights) = if a >= 0.5 {
            (0, [2.0 * a - 1.0, 2.0 * b, 2.0 * c])
        } else if b >= 0.5 {
            (1, [2.0 * a, 2.0 * b - 1.0, 2.0 * c])
        } else if c >= 0.5 {
            (2, [2.0 * a, 2.0 * b, 2.0 * c - 1.0])
        } else {
            (3, [1.0 - 2.0 * c, 1.0 - 2.0 * a, 1.0 - 2.0 * b])
        };
        (4 * triangle + child, weights)
    })
}

/// Returns the triangle that one descends from by some subdivisions, and a place of it there: the inverse of [`finer`].
pub(crate) fn coarser(triangle: usize, weights: [f64; 3], levels: u32) -> (usize, [f64; 3]) {
    (0..levels).fold((triangle, weights), |(triangle, [a, b, c]), _| {
        let weights = match triangle % 4 {
            0 => [a + 0.5 * (b + c), 0.5 * b, 0.5 * c],
            1 => [0.5 * a, b + 0.5 * (a + c), 0.5 * c],
            2 => [0.5 * a, 0.5 * b, c + 0.5 * (a + b)],
            _ => [0.5 * (a + c), 0.5 * (a + b), 0.5 * (b + c)],
        };
        (triangle / 4, weights)
    })
}

/// Unit normals of a subdivided mesh's vertices, interpolated between those of the coarse mesh.
pub(crate) fn interpolated_normals(base: &Mesh, fine: &super::subdivision::SubdividedMesh) -> Vec<[f64; 3]> {
    let sums = fine.interpolate(&vertex_normals(base), |a, b| std::array::from_fn(|k| 0.5 * (a[k] + b[k])));
    let unit = |sum: [f64; 3]| {
        let length = dot(sum, sum).sqrt();
        if length > 0.0 { sum.map(|x| x / length) } else { sum }
    };
    sums.into_iter().map(unit).collect()
}

/// A surface as the encoder has it: displacements of a mesh's vertices after some subdivisions, world units.
#[cfg(feature = "encode")]
#[derive(Debug, Clone, Copy)]
pub struct Displacements<'a> {
    /// Subdivisions.
    pub levels: u32,
    /// By vertex of the subdivided mesh.
    pub values: &'a [f64],
    /// Step of the quantiser, world units.
    pub step: f64,
}

/// Bytes of the section, and the surface as the decoder has it.
/// # Errors
/// [`Error::Parameter`] where a number is beyond what the format holds.
#[cfg(feature = "encode")]
pub fn encode(displacements: &Displacements, base: &Mesh, charts: &Charts) -> Result<(Vec<u8>, DisplacedMesh)> {
    let Displacements { levels, step, .. } = *displacements;
    let edge = super::subdivision::mean_edge(base) / (1u64 << levels.min(32)) as f64;
    let density = (1.0 / (edge * charts.texels_per_unit)).ceil().clamp(1.0, MAX_DENSITY as f64) as u8;
    let step = step as f32;
    if levels > MAX_LEVELS as u32 || !is_step(step) {
        return Err(Error::parameter(format!("displacements of {levels} subdivisions with a step of {step}")));
    }
    let mut bytes = vec![VERSION, levels as u8, density];
    push_f32(&mut bytes, step);
    let atlas = charts.denser(density);
    let raster = rasterise_atlas(base, &atlas)?;
    let mask = raster.mask();
    let image = matching_image(displacements, base, &atlas, &raster)?;
    let pixels: Vec<ColourLanes> = image.data.iter().map(|value| [value / step, 0.0, 0.0, 0.0]).collect();
    let plan = WaveletPlan::new(&mask);
    let target = plan.forward(pixels);
    let mut coder = crate::entropy::RangeEncoder::new();
    let quantiser = Quantiser { step: STEP, shrink: SHRINK };
    let target = Some((&target[..], RateDistortion { lambda: LAMBDA }));
    let coefficients = coefficients::code_alone(&mut coder, &plan, &quantiser, target);
    bytes.extend(coder.finish());
    let image = to_image(&plan.inverse(&coefficients), &mask, step);
    Ok((bytes, displace(base, charts, (levels, density), &image)?))
}

/// Rounds in which the image is corrected by what the vertices read of it: reading between texels blurs.
#[cfg(feature = "encode")]
const CORRECTIONS: usize = 4;

/// The image of which the vertices read their displacements, nearly; 0 in texels that are not in use.
#[cfg(feature = "encode")]
fn matching_image(
    displacements: &Displacements,
    base: &Mesh,
    atlas: &Charts,
    raster: &AtlasRaster,
) -> Result<Grid<f32>> {
    let Displacements { levels, values, .. } = *displacements;
    let (width, height) = (raster.triangle.width, raster.triangle.height);
    let mut image = Grid::filled(width, height, 0f32);
    for _ in 0..CORRECTIONS {
        // What is missing at the vertices, and between them at the texels.
        let mut missing = values.to_vec();
        let surface = DisplacedMesh::new(base, levels, |vertex, triangle, place| {
            let read = sample_number(&image, atlas_position(atlas, triangle, DVec3::from_array(place)));
            missing.iter_mut().skip(vertex).take(1).for_each(|missing| *missing -= read);
            read
        })?;
        for texel in (0..width * height).filter(|&texel| raster.triangle.data[texel] != NONE) {
            let (triangle, weights) = surface.finer(raster.triangle.data[texel] as usize, raster.weights(texel));
            let corners = surface.mesh.triangles[triangle];
            let more = (0..3).map(|k| weights[k] * missing.get(corners[k] as usize).copied().unwrap_or(0.0));
            image.data[texel] += more.sum::<f64>() as f32;
        }
    }
    Ok(image)
}

/// The surface of a section, for the mesh and the charts that it was made for.
/// # Errors
/// [`Error::Format`] for a damaged section, [`Error::Unsupported`] for one of a later version, [`Error::Limits`] beyond the budget.
pub fn decode(bytes: &[u8], base: &Mesh, charts: &Charts, budget: &Budget) -> Result<DisplacedMesh> {
    let Some((header, stream)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
        let message = format!("ends within its head of {HEADER_BYTES} bytes");
        return Err(Error::format(Tag::DISPLACEMENT, bytes.len(), message));
    };
    let [version, levels, density] = [header[0], header[1], header[2]];
    if version != VERSION {
        return Err(Error::Unsupported(format!("section DISP of version {version}")));
    }
    let step = LittleEndian::read_f32(&header[3..]);
    if levels > MAX_LEVELS || !(1..=MAX_DENSITY).contains(&density) || !is_step(step) {
        let message = format!("{levels} subdivisions, {density} texels for one, a step of {step}");
        return Err(Error::format(Tag::DISPLACEMENT, 1u64, message));
    }
    let texels = (charts.width as u64 * density as u64).saturating_mul(charts.height as u64 * density as u64);
    budget.charge_items("displacements", texels, BYTES_A_TEXEL)?;
    budget.charge_items("displaced surface", (base.triangles.len() as u64) << (2 * levels), BYTES_A_TRIANGLE)?;
    let mask = rasterise_atlas(base, &charts.denser(density))?.mask();
    let plan = WaveletPlan::new(&mask);
    let mut coder = RangeDecoder::new(stream);
    let quantiser = Quantiser { step: STEP, shrink: SHRINK };
    let coefficients = coefficients::code_alone(&mut coder, &plan, &quantiser, None);
    if !coder.ends_as_written(0) {
        return Err(Error::format(Tag::DISPLACEMENT, bytes.len(), "its length does not fit its content"));
    }
    let image = to_image(&plan.inverse(&coefficients), &mask, step);
    let surface = displace(base, charts, (levels as u32, density), &image)?;
    budget.release(texels * BYTES_A_TEXEL as u64);
    Ok(surface)
}

/// Whether a step is one that the format allows.
fn is_step(step: f32) -> bool {
    (1e-12..=1e6).contains(&step)
}

/// The image in world units; 0 outside the mask.
fn to_image(pixels: &[ColourLanes], mask: &Mask, step: f32) -> Grid<f32> {
    let data = pixels.iter().zip(&mask.data).map(|(pixel, &inside)| if inside { pixel[0] * step } else { 0.0 });
    Grid { width: mask.width, height: mask.height, data: data.collect() }
}

fn displace(base: &Mesh, charts: &Charts, (levels, density): (u32, u8), image: &Grid<f32>) -> Result<DisplacedMesh> {
    let atlas = charts.denser(density);
    DisplacedMesh::new(base, levels, |_, triangle, place| {
        sample_number(image, atlas_position(&atlas, triangle, DVec3::from_array(place)))
    })
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::limits::Limits;
    use crate::surface::atlas::{layout, tests::bumpy_sphere};
    use crate::surface::displacement::*;

    /// A sphere with waves, its section and its surface.
    fn waves() -> (Mesh, Charts, Vec<u8>, DisplacedMesh) {
        let base = bumpy_sphere(16);
        let charts = layout(&base, 12.0).unwrap();
        let fine = subdivide(&base, 2).mesh;
        let values: Vec<f64> = fine.positions.iter().map(|p| 0.01 * (9.0 * p[0] as f64).sin()).collect();
        let displacements = Displacements { levels: 2, values: &values, step: 2e-4 };
        let (bytes, decoded) = encode(&displacements, &base, &charts).unwrap();
        let exact = DisplacedMesh::new(&base, 2, |vertex, _, _| values[vertex]).unwrap();
        let error = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|k| ((a[k] - b[k]) as f64).powi(2)).sum::<f64>();
        let squared: f64 = decoded.mesh.positions.iter().zip(&exact.mesh.positions).map(error).sum();
        let deviation = (squared / exact.mesh.positions.len() as f64).sqrt();
        assert!(deviation < 1e-4, "{deviation}");
        (base, charts, bytes, decoded)
    }

    #[test]
    fn the_surface_comes_back_and_damage_is_found() {
        let (base, charts, bytes, surface) = waves();
        let read = |bytes: &[u8]| decode(bytes, &base, &charts, &Budget::new(Limits::default()));
        assert_eq!(read(&bytes).unwrap(), surface);
        for end in 0..HEADER_BYTES {
            assert!(read(&bytes[..end]).is_err(), "{end}");
        }
        // A stream that is cut off may by chance end as another one would.
        let ends = (HEADER_BYTES..bytes.len()).filter(|&end| read(&bytes[..end]).is_ok()).count();
        assert!(50 * ends < bytes.len(), "{ends} of {}", bytes.len());
        assert!(read(&[&bytes[..], &[0]].concat()).is_err());
        for (at, value) in [(0, 1), (1, 7), (2, 0), (2, 9), (6, 0xFF)] {
            let mut other = bytes.clone();
            other[at] = value;
            assert!(read(&other).is_err(), "{at}");
        }
        let little = Budget::new(Limits { memory_bytes: 1 << 16, ..Limits::default() });
        assert!(matches!(decode(&bytes, &base, &charts, &little), Err(Error::Limits { .. })));
    }

    #[test]
    fn places_are_found_both_ways() {
        let (_, _, _, surface) = waves();
        for weights in [[0.2, 0.3, 0.5], [0.7, 0.1, 0.2], [0.1, 0.85, 0.05], [0.3, 0.35, 0.35], [0.01, 0.01, 0.98]] {
            let (fine, place) = surface.finer(37, weights);
            assert!(fine >> 4 == 37 && place.iter().all(|&w| (-1e-12..=1.0).contains(&w)), "{fine} {place:?}");
            let (coarse, back) = surface.coarser(fine, place);
            assert!(coarse == 37 && (0..3).all(|k| (back[k] - weights[k]).abs() < 1e-12), "{back:?}");
        }
    }
}
