//! What the reflectance says of a view: the second prediction beside that by other views (normative, `spec/planes.md` section 12).
//!
//! The surface of section `DISP` is drawn under the view's light, with the diffuse layer and the lobes of section `RFLC`. Only
//! `+ - * /` and square roots, so that every platform predicts the same bits.

use super::PlaneCoding;
use super::reflected::{LitPoints, TexelLanes, TexelTable};
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
use crate::surface::view_geometry::{ViewGeometry, interpolated_normal};
use crate::surface::warp::fill_holes;
use crate::transform::shape_adaptive::PixelRun;
use crate::transform::window::Window;
use crate::vector::LANES;
use crate::views::Component;
use glam::{DVec3, Vec4};
use std::borrow::Cow;

/// Subdivisions of the surface that are left out where it is drawn: the finest relief is in the normals.
const LEVELS_NOT_DRAWN: u32 = 1;
/// Largest radiance of a model, in units of the white board.
const MAX_RADIANCE: f32 = 1e12;

/// Surface and reflectance that views are predicted from.
#[derive(Debug)]
pub(crate) struct PredictionModel<'a> {
    pub(crate) surface: Cow<'a, DisplacedMesh>,
    pub(crate) charts: Cow<'a, Charts>,
    pub(crate) maps: Cow<'a, ReflectanceMaps>,
    texels: TexelTable,
    /// The surface as it is drawn.
    drawn: Mesh,
    components: Vec<Component>,
    white: [f32; 3],
}

impl<'a> PredictionModel<'a> {
    /// Takes the parts of a file whose photographs are predicted from them; `white` is the white board's radiance.
    /// # Errors
    /// [`Error::Format`] if one of them is missing or of another kind, [`Error::Limits`] if the memory is not available.
    pub(crate) fn new(
        (surface, charts, maps): ModelParts<'a>,
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
        let levels_not_drawn = levels_not_drawn(&surface);
        budget.charge_items("surface", surface.mesh().triangles.len() as u64 >> (2 * levels_not_drawn), 24)?;
        budget.charge_items("reflectance", maps.diffuse.data.len() as u64, TexelTable::BYTES_A_TEXEL)?;
        let texels = TexelTable::new(&maps).filter(|_| maps.relightable).ok_or_else(|| {
            let message = "the views are predicted from lobes under known lights, which section RFLC does not have";
            Error::format(Tag::PLANES, 8u64, message)
        })?;
        Ok(PredictionModel {
            drawn: surface.without_levels(levels_not_drawn),
            surface,
            charts,
            maps,
            texels,
            components: components.to_vec(),
            white: white.map(|white| white as f32),
        })
    }

    /// Bytes that drawing takes beside what the view's size does: the vertices' places.
    pub(super) fn drawing_bytes(&self) -> u64 {
        self.drawn.positions.len() as u64 * 32
    }

    /// The signals of all components in a view, of the size that is predicted: `geometry` is that of the mesh `base`, and `rows` are the mask's in
    /// `window`. `level` are the levels of the transform above.
    /// # Errors
    /// [`Error::Limits`] if drawing the surface takes unreasonably long.
    pub(super) fn signals(
        &self,
        (base, geometry): (&Mesh, &ViewGeometry),
        coding: &PlaneCoding,
        (window, rows, level): (&Window, &[PixelRun], usize),
    ) -> Result<Vec<PlaneSignal>> {
        let size = [window.width, window.height];
        let mut signals = vec![vec![[0.0f32; 4]; window.width * window.height]; coding.components.len()];
        let (camera, Some(light)) = (&geometry.view.camera, geometry.view.light) else { return Ok(signals) };
        let drawn = rasterise_facing(&self.drawn, camera)?;
        let centre = camera.centre();
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
            let (mut points, mut normals) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            let mut texels = TexelLanes::default();
            for (lane, &(_, [x, y])) in seen.iter().enumerate() {
                let seen = self.seen_point((base, geometry), &drawn, y * drawn.width + x);
                self.texels.read(seen.place, lane, &mut texels);
                let ray = camera.ray([x as f64 + 0.5, y as f64 + 0.5]);
                for k in 0..3 {
                    points[k][lane] = centre[k] + seen.depth * ray[k];
                    normals[k][lane] = seen.normal[k] as f64;
                }
            }
            let lit = LitPoints::new(&points, &normals, centre, &light);
            for ((signal, component), colours) in signals.iter_mut().zip(&self.components).zip(&colours) {
                let radiance = lit.radiance(*component, &texels);
                for (lane, &(at, _)) in seen.iter().enumerate() {
                    let [r, g, b] = std::array::from_fn(|k| root(radiance[k][lane] / self.white[k]));
                    signal[at] = (colours.rotate(Vec4::new(r, g, b, 0.0)) * scale).to_array();
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
    fn seen_point(&self, (base, geometry): (&Mesh, &ViewGeometry), drawn: &Raster, pixel: usize) -> SeenPoint {
        let is_surface = drawn.is_covered(pixel);
        let raster = if is_surface { drawn } else { &geometry.raster };
        let [b, c] = raster.barycentric[pixel].map(f64::from);
        let (mut triangle, mut weights) = (raster.triangle[pixel] as usize, [1.0 - b - c, b, c]);
        let normal = if is_surface {
            let not_drawn = levels_not_drawn(&self.surface);
            let (child, place) = finer(triangle, weights, not_drawn);
            (triangle, weights) = coarser(triangle, weights, self.surface.levels() - not_drawn);
            interpolated_normal(self.surface.mesh().triangles[child], place, self.surface.normals())
        } else {
            geometry.normal(pixel)
        };
        let corners = base.triangles[triangle].map(|v| base.positions[v as usize].map(f64::from));
        let on_mesh = (0..3).map(|k| weights[k] * DVec3::from_array(corners[k])).sum();
        SeenPoint { depth: raster.depth[pixel], normal, place: atlas_position(&self.charts, triangle, on_mesh) }
    }
}

/// How many of a surface's subdivisions are left out where it is drawn.
fn levels_not_drawn(surface: &DisplacedMesh) -> u32 {
    surface.levels().min(LEVELS_NOT_DRAWN)
}

/// A point of the object that a pixel sees.
struct SeenPoint {
    depth: f64,
    normal: [f32; 3],
    /// Atlas position.
    place: [f64; 2],
}

/// Surface, atlas and reflectance of a file, as far as it has them.
pub(crate) type ModelParts<'a> =
    (Option<Cow<'a, DisplacedMesh>>, Option<Cow<'a, Charts>>, Option<Cow<'a, ReflectanceMaps>>);

/// The square root of a radiance within its range; 0 where it is not a number.
#[inline(always)]
fn root(radiance: f32) -> f32 {
    if radiance > MAX_RADIANCE {
        MAX_RADIANCE.sqrt()
    } else if radiance > 0.0 {
        radiance.sqrt()
    } else {
        0.0
    }
}
