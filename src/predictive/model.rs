//! What the reflectance says of a view: the second prediction beside that by other views (normative, `spec/planes.md` section 12).
//!
//! The surface of section `DISP` is drawn under the view's light, with the diffuse layer and the lobes of section `RFLC`. Only
//! `+ - * /` and square roots, so that every platform predicts the same bits.

use super::PlaneCoding;
use super::reflected::{LitPoints, TexelTable};
use super::workspace::PlaneSignal;
use crate::container::Tag;
use crate::error::{Error, Result};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::reflectance::maps::ReflectanceMaps;
use crate::surface::atlas::atlas_position;
use crate::surface::charts::Charts;
use crate::surface::displacement::{DisplacedMesh, coarser, finer};
use crate::surface::raster::{Raster, rasterise_facing};
use crate::surface::view_geometry::ViewGeometry;
use crate::surface::warp::fill_holes;
use crate::transform::shape_adaptive::PixelRun;
use crate::transform::window::Window;
use crate::vector::{LANES, dot_lanes, lanes};
use crate::views::Component;
use glam::{DVec3, Vec4};

/// Subdivisions of the surface that are left out where it is drawn: the finest relief is in the normals.
const LEVELS_NOT_DRAWN: u32 = 1;
/// Largest radiance of a model, in units of the white board.
const MAX_RADIANCE: f32 = 1e12;

/// Surface and reflectance that views are predicted from.
#[derive(Debug)]
pub(crate) struct PredictionModel {
    /// The surface as it is drawn.
    drawn: Mesh,
    /// Atlas positions of the corners of its triangles, and of the mesh's.
    places: [Vec<TrianglePlaces>; 2],
    normals: NormalLattices,
    texels: TexelTable,
    components: Vec<Component>,
    white: Vec4,
}

/// Atlas positions of a triangle's corners.
type TrianglePlaces = [[f32; 2]; 3];

/// Surface, atlas and reflectance of a file, as far as it has them.
pub(crate) type ModelParts<'a> = (Option<&'a DisplacedMesh>, Option<&'a Charts>, Option<&'a ReflectanceMaps>);

impl PredictionModel {
    /// Takes what it needs of the parts of a file whose photographs are predicted from them: `base` is its mesh, `white` the white board's radiance.
    /// # Errors
    /// [`Error::Format`] if one of them is missing or of another kind, [`Error::Limits`] if the memory is not available.
    pub(crate) fn new(
        base: &Mesh,
        (surface, charts, maps): ModelParts,
        components: &[Component],
        white: [f64; 3],
        budget: &Budget,
    ) -> Result<Self> {
        let missing = |tag: Tag| {
            let message = format!("the views are predicted from section {tag}, which the file does not have");
            Error::format(Tag::PLANES, 8u64, message)
        };
        let charts = charts.ok_or_else(|| missing(Tag::CHARTS))?;
        let surface = surface.ok_or_else(|| missing(Tag::DISPLACEMENT))?;
        let maps = maps.ok_or_else(|| missing(Tag::REFLECTANCE))?;
        let not_drawn = surface.levels().min(LEVELS_NOT_DRAWN);
        let drawn_triangles = surface.mesh().triangles.len() >> (2 * not_drawn);
        let bytes = 24 + size_of::<TrianglePlaces>() + NormalLattices::bytes_a_triangle(not_drawn);
        budget.charge_items("surface", drawn_triangles as u64, bytes)?;
        budget.charge_items("mesh", base.triangles.len() as u64, size_of::<TrianglePlaces>())?;
        budget.charge_items("reflectance", maps.diffuse.data.len() as u64, TexelTable::BYTES_A_TEXEL)?;
        let texels = TexelTable::new(maps).filter(|_| maps.relightable).ok_or_else(|| {
            let message = "the views are predicted from lobes under known lights, which section RFLC does not have";
            Error::format(Tag::PLANES, 8u64, message)
        })?;
        let corners = |triangle: usize, levels: u32| -> TrianglePlaces {
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|corner| {
                let (triangle, weights) = coarser(triangle, corner, levels);
                let vertices = base.triangles[triangle].map(|v| base.positions[v as usize].map(f64::from));
                let point = (0..3).map(|k| weights[k] * DVec3::from_array(vertices[k])).sum();
                atlas_position(charts, triangle, point).map(|place| place as f32)
            })
        };
        Ok(PredictionModel {
            drawn: surface.without_levels(not_drawn),
            places: [(drawn_triangles, surface.levels() - not_drawn), (base.triangles.len(), 0)]
                .map(|(count, levels)| (0..count).map(|triangle| corners(triangle, levels)).collect()),
            normals: NormalLattices::new(surface, not_drawn),
            texels,
            components: components.to_vec(),
            white: Vec4::from_array([white[0] as f32, white[1] as f32, white[2] as f32, 1.0]),
        })
    }

    /// Bytes that drawing takes beside what the view's size does: the vertices' places.
    pub(super) fn drawing_bytes(&self) -> u64 {
        self.drawn.positions.len() as u64 * 32
    }

    /// The signals of all components in a view, of the size that is predicted: `geometry` is that of the mesh, and `rows` are the mask's in
    /// `window`. `level` are the levels of the transform above.
    /// # Errors
    /// [`Error::Limits`] if drawing the surface takes unreasonably long.
    pub(super) fn signals(
        &self,
        geometry: &ViewGeometry,
        coding: &PlaneCoding,
        (window, rows, level): (&Window, &[PixelRun], usize),
    ) -> Result<Vec<PlaneSignal>> {
        let size = [window.width, window.height];
        let mut signals = vec![vec![[0.0f32; 4]; window.width * window.height]; coding.components.len()];
        let (camera, Some(light)) = (&geometry.view.camera, geometry.view.light) else { return Ok(signals) };
        let drawn = rasterise_facing(&self.drawn, camera)?;
        let (centre, r) = (camera.centre(), &camera.rotation);
        let colours: Vec<_> = coding.components.iter().map(|component| component.colour_transform()).collect();
        let scale = Vec4::splat((1u32 << level) as f32);
        let mut known = vec![false; window.width * window.height];
        let mut holes = Vec::new();
        let mut seen = Vec::new();
        for run in rows {
            let (y, left) = (window.top + run.line as usize, run.start as usize);
            for x in left..left + run.length as usize {
                let (at, pixel) = (run.line as usize * window.width + x, y * drawn.width + window.left + x);
                known[at] = drawn.is_covered(pixel) || geometry.raster.is_covered(pixel);
                if known[at] {
                    seen.push((at, [window.left + x, y]));
                } else {
                    holes.push(at);
                }
            }
        }
        for seen in seen.chunks(LANES) {
            // Lanes beyond the last repeat it.
            let of = |i: usize| seen[i.min(seen.len() - 1)].1;
            let points: [SeenPoint; LANES] = std::array::from_fn(|i| {
                let [x, y] = of(i);
                self.seen_point(geometry, &drawn, y * drawn.width + x)
            });
            let q = [0, 1].map(|k| lanes(|i| (of(i)[k] as f64 + 0.5 - camera.principal[k]) / camera.focal[k]));
            let ray = [0, 1, 2].map(|k| lanes(|i| r[0][k] * q[0][i] + r[1][k] * q[1][i] + r[2][k]));
            let places = [0, 1, 2].map(|k| lanes(|i| centre[k] + points[i].depth * ray[k][i]));
            let normals = [0, 1, 2].map(|k| lanes(|i| points[i].normal[k]));
            let squared = dot_lanes(&normals, &normals);
            let inverse = lanes(|i| if squared[i] > 0.0 { 1.0 / squared[i].sqrt() } else { 0.0 });
            let normals = normals.map(|normal| lanes(|i| normal[i] * inverse[i]));
            let lit = LitPoints::new(&places, &normals, centre, &light);
            for (lane, (&(at, _), point)) in seen.iter().zip(&points).enumerate() {
                let texel = self.texels.read(point.place);
                for ((signal, component), colours) in signals.iter_mut().zip(&self.components).zip(&colours) {
                    let root = root(lit.radiance(*component, lane, &texel) / self.white);
                    signal[at] = (colours.rotate(root) * scale).to_array();
                }
            }
        }
        for signal in &mut signals {
            fill_holes(signal, &known, &holes, size);
        }
        Ok(signals)
    }

    /// What a pixel sees: the surface, or, beside it, the mesh, on which lies what photographs say of silhouettes.
    #[inline(always)]
    fn seen_point(&self, geometry: &ViewGeometry, drawn: &Raster, pixel: usize) -> SeenPoint {
        let is_surface = drawn.is_covered(pixel);
        let (raster, places) = if is_surface { (drawn, &self.places[0]) } else { (&geometry.raster, &self.places[1]) };
        let [b, c] = raster.barycentric[pixel].map(f64::from);
        let (triangle, a) = (raster.triangle[pixel] as usize, 1.0 - b - c);
        let normal = match is_surface {
            true => self.normals.normal(triangle, [b, c]),
            false => geometry.normal(pixel).map(f64::from),
        };
        let corners = places[triangle].map(|corner| corner.map(f64::from));
        let place = std::array::from_fn(|k| a * corners[0][k] + b * corners[1][k] + c * corners[2][k]);
        SeenPoint { depth: raster.depth[pixel], normal, place }
    }
}

/// A point of the object that a pixel sees.
struct SeenPoint {
    depth: f64,
    /// Of any length.
    normal: [f64; 3],
    /// Atlas position.
    place: [f64; 2],
}

/// Normals of a surface's vertices by the triangles that it has some subdivisions before: those of each together.
#[derive(Debug)]
struct NormalLattices {
    /// Parts into which an edge of a triangle is divided.
    parts: usize,
    /// Normals of a triangle's vertices after the subdivisions: rows from its first edge to its third corner, of one fewer each.
    normals: Vec<[f32; 3]>,
}

impl NormalLattices {
    /// Vertices of a triangle.
    fn count(parts: usize) -> usize {
        (parts + 1) * (parts + 2) / 2
    }
    fn bytes_a_triangle(subdivisions: u32) -> usize {
        Self::count(1 << subdivisions) * size_of::<[f32; 3]>()
    }
    /// Of all triangles that `surface` has `subdivisions` before its last.
    fn new(surface: &DisplacedMesh, subdivisions: u32) -> Self {
        let (parts, triangles) = (1 << subdivisions, &surface.mesh().triangles);
        let share = |k: usize| k as f64 / parts as f64;
        let mut normals = Vec::with_capacity((triangles.len() >> (2 * subdivisions)) * Self::count(parts));
        for triangle in 0..triangles.len() >> (2 * subdivisions) {
            for j in 0..=parts {
                for i in 0..=parts - j {
                    let (child, place) = finer(triangle, [share(parts - i - j), share(i), share(j)], subdivisions);
                    let corner = place.iter().position(|&weight| weight == 1.0).unwrap_or(0);
                    let vertex = triangles[child][corner] as usize;
                    normals.push(surface.normals()[vertex].map(|n| n as f32));
                }
            }
        }
        NormalLattices { parts, normals }
    }
    /// The normal, of any length, at the weights of a triangle's second and third corner: between those of the vertices around.
    #[inline(always)]
    fn normal(&self, triangle: usize, weights: [f64; 2]) -> [f64; 3] {
        let parts = self.parts;
        let [x, y] = weights.map(|weight| weight * parts as f64);
        let i = (x as usize).min(parts - 1);
        let j = (y as usize).min(parts - 1 - i);
        let (u, v) = (x - i as f64, y - j as f64);
        let lattice = &self.normals[triangle * Self::count(parts)..][..Self::count(parts)];
        let row = |j: usize| j * (2 * parts + 3 - j) / 2;
        let (here, above) = (row(j) + i, row(j + 1) + i);
        let (corners, weights) = match u + v > 1.0 && i + j + 1 < parts {
            true => ([above + 1, above, here + 1], [u + v - 1.0, 1.0 - u, 1.0 - v]),
            false => ([here, here + 1, above], [1.0 - u - v, u, v]),
        };
        let corners = corners.map(|at| lattice[at]);
        std::array::from_fn(|k| {
            weights[0] * corners[0][k] as f64 + weights[1] * corners[1][k] as f64 + weights[2] * corners[2][k] as f64
        })
    }
}

/// The square roots of radiances within their range; 0 where they are no numbers.
#[inline(always)]
fn root(radiance: Vec4) -> Vec4 {
    let most = Vec4::splat(MAX_RADIANCE);
    let limited = Vec4::select(radiance.cmpgt(most), most, radiance);
    Vec4::from_array(Vec4::select(limited.cmpgt(Vec4::ZERO), limited, Vec4::ZERO).to_array().map(f32::sqrt))
}
