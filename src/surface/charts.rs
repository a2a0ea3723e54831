//! The `CHRT` section: which chart each triangle belongs to, where the charts lie. See `spec/charts.md`.
//!
//! Triangles are visited in an order that follows from the mesh alone; each is predicted to belong to the chart of one of
//! its neighbours that were visited before, so that only the borders between charts cost bits.

use crate::container::{Tag, push_f32};
use crate::entropy::{BitCoder, BitModel, NumberModel, RangeDecoder, RangeEncoder};
use crate::error::{Error, Result};
use crate::limits::{Budget, check};
use crate::mesh::Mesh;
use crate::vector::cross;
use byteorder::{ByteOrder, LittleEndian};

/// Charts of a texture atlas: each chart is an orthographic projection along one axis of the world,
/// so that its texture coordinates follow from the mesh and four numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Charts {
    /// Width of the atlas in texels.
    pub width: u32,
    /// Height of the atlas in texels.
    pub height: u32,
    /// Texels for one unit of world length.
    pub texels_per_unit: f64,
    /// The charts.
    pub charts: Vec<Chart>,
    /// For each triangle of the mesh the index of its chart.
    pub chart_of_triangle: Vec<u32>,
}

/// One chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Chart {
    /// Direction the chart faces: 0 +x, 1 -x, 2 +y, 3 -y, 4 +z, 5 -z.
    pub facing: u8,
    /// Texel position of the world origin's projection (may lie outside the atlas).
    pub offset: [i32; 2],
}

impl Charts {
    /// Atlas position, in texels (texel centres at +0.5), of the three corners of a triangle.
    pub fn corners(&self, mesh: &Mesh, triangle: usize) -> [[f64; 2]; 3] {
        let chart = self.charts[self.chart_of_triangle[triangle] as usize];
        mesh.triangles[triangle].map(|vertex| {
            let p = mesh.positions[vertex as usize];
            let (u, v) = match chart.facing / 2 {
                0 => (p[1], p[2]),
                1 => (p[2], p[0]),
                _ => (p[0], p[1]),
            };
            // The far side is mirrored so that no chart is.
            let u = if chart.facing.is_multiple_of(2) { u as f64 } else { -(u as f64) };
            [
                u * self.texels_per_unit + chart.offset[0] as f64,
                v as f64 * self.texels_per_unit + chart.offset[1] as f64,
            ]
        })
    }
}

impl Charts {
    /// The same atlas with `density` texels for one, each way.
    pub(crate) fn denser(&self, density: u8) -> Charts {
        let offset = |offset: [i32; 2]| offset.map(|x| x.saturating_mul(density as i32));
        Charts {
            width: self.width.saturating_mul(density as u32),
            height: self.height.saturating_mul(density as u32),
            texels_per_unit: self.texels_per_unit * density as f64,
            charts: self.charts.iter().map(|chart| Chart { offset: offset(chart.offset), ..*chart }).collect(),
            chart_of_triangle: self.chart_of_triangle.clone(),
        }
    }
}

/// No triangle, no chart.
pub(crate) const NONE: u32 = u32::MAX;

/// For each triangle the triangles on the other side of its edges (corners 0-1, 1-2, 2-0), or [`NONE`]. Of an edge with more than two
/// triangles the first two in mesh order are neighbours, then the next two, and so on. Part of the format.
pub(crate) fn neighbours(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
    for (t, corners) in mesh.triangles.iter().enumerate() {
        for side in 0..3 {
            let (a, b) = (corners[side], corners[(side + 1) % 3]);
            edges.push((a.min(b), a.max(b), (t * 3 + side) as u32));
        }
    }
    edges.sort_unstable();
    let mut result = vec![[NONE; 3]; mesh.triangles.len()];
    let mut k = 0;
    while k + 1 < edges.len() {
        let (one, two) = (edges[k], edges[k + 1]);
        let (a, b) = ((one.2 / 3) as usize, (two.2 / 3) as usize);
        if (one.0, one.1) == (two.0, two.1) && a != b {
            result[a][(one.2 % 3) as usize] = b as u32;
            result[b][(two.2 % 3) as usize] = a as u32;
            k += 2;
        } else {
            k += 1;
        }
    }
    result
}

/// The order in which triangles are coded: breadth first over the neighbours, from the first triangle not yet visited.
pub(crate) fn visiting_order(neighbours: &[[u32; 3]]) -> Vec<u32> {
    let mut order = Vec::with_capacity(neighbours.len());
    let mut seen = vec![false; neighbours.len()];
    let mut next = 0;
    for start in 0..neighbours.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        order.push(start as u32);
        while next < order.len() {
            let triangle = order[next] as usize;
            next += 1;
            for &n in &neighbours[triangle] {
                if n != NONE && !seen[n as usize] {
                    seen[n as usize] = true;
                    order.push(n);
                }
            }
        }
    }
    order
}

/// Twice the triangle's area times its normal. `+ - *` in double only, so that it is the same everywhere.
pub(crate) fn area_normal(mesh: &Mesh, triangle: usize) -> [f64; 3] {
    let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.positions[v as usize].map(f64::from));
    let (e, f) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
    cross(e, f)
}

/// Component of a vector along a facing direction (0 +x, 1 -x, 2 +y, 3 -y, 4 +z, 5 -z).
pub(crate) fn along(vector: [f64; 3], facing: u8) -> f64 {
    let value = vector[(facing / 2) as usize % 3];
    if facing.is_multiple_of(2) { value } else { -value }
}

/// The direction of which a normal has most; the first one of equals.
pub(crate) fn dominant(normal: [f64; 3]) -> u8 {
    (1..6).fold(0, |best, f| if along(normal, f) > along(normal, best) { f } else { best })
}

/// Models of the section, used the same way in both directions.
#[derive(Default)]
struct ChartModels {
    keeps: [[BitModel; 6]; 16],
    other: [[BitModel; 4]; 2],
    fresh: BitModel,
    dominant: BitModel,
    facing: [BitModel; 8],
    index: NumberModel,
    size: NumberModel,
    offset: [NumberModel; 2],
}

/// State of the visit of the triangles, in both directions.
struct Visit<'a> {
    mesh: &'a Mesh,
    neighbours: Vec<[u32; 3]>,
    chart_of_triangle: Vec<u32>,
    facings: Vec<u8>,
    models: ChartModels,
}

impl Visit<'_> {
    /// Bucket 0..=7 of the cosine between a normal and a facing, squared cosines compared so that no root is taken.
    fn slope(normal: [f64; 3], facing: u8) -> usize {
        let cosine = along(normal, facing);
        if cosine <= 0.0 {
            return 0;
        }
        let square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        let share = cosine * cosine;
        [0.06, 0.16, 0.3, 0.42, 0.54, 0.7].iter().filter(|&&bound| share > bound * square).count() + 1
    }

    /// Codes one triangle. `wanted` is its chart (encoder), with `facing` that chart's; returns the chart.
    fn triangle<C: BitCoder>(&mut self, coder: &mut C, triangle: usize, wanted: u32, facing: u8) -> Result<u32> {
        let normal = area_normal(self.mesh, triangle);
        // Charts of the visited neighbours, the one which this triangle faces best first.
        let mut near: Vec<u32> = Vec::with_capacity(3);
        let mut votes = 0;
        for n in self.neighbours[triangle] {
            if n != NONE && self.chart_of_triangle[n as usize] != NONE {
                votes += 1;
                let chart = self.chart_of_triangle[n as usize];
                if !near.contains(&chart) {
                    near.push(chart);
                }
            }
        }
        let facing_of = |chart: u32| self.facings[chart as usize];
        near.sort_by(|&a, &b| along(normal, facing_of(b)).total_cmp(&along(normal, facing_of(a))));
        let best = dominant(normal);
        if let Some(&first) = near.first() {
            let slope = Self::slope(normal, facing_of(first));
            let agrees = (facing_of(first) == best) as usize;
            let context = match (near.len(), votes) {
                (1, 1) => 0,
                (1, 2) => 1,
                (1, _) => 2,
                (2, 2) => 3,
                (2, _) => 4,
                _ => 5,
            };
            if self.models.keeps[slope * 2 + agrees][context].code(coder, wanted == first) {
                return Ok(first);
            }
            for (k, &other) in near.iter().enumerate().skip(1) {
                let bucket = Self::slope(normal, facing_of(other)) / 2;
                if self.models.other[k - 1][bucket].code(coder, wanted == other) {
                    return Ok(other);
                }
            }
        }
        let count = self.facings.len() as u32;
        if count > 0 && !self.models.fresh.code(coder, wanted == count) {
            let back = self.models.index.code(coder, (count - 1).wrapping_sub(wanted) & !(1 << 31));
            return count.checked_sub(1).and_then(|last| last.checked_sub(back)).ok_or_else(|| {
                Error::format(Tag::CHARTS, 0u64, format!("triangle {triangle} names a chart that does not exist"))
            });
        }
        let mut new = best;
        if !self.models.dominant.code(coder, facing == best) {
            let mut node = 1usize;
            for k in (0..3).rev() {
                node = node << 1 | self.models.facing[node].code(coder, facing >> k & 1 == 1) as usize;
            }
            new = (node & 7) as u8;
            if new > 5 {
                return Err(Error::format(Tag::CHARTS, 0u64, format!("a chart faces direction {new}; 0 to 5 exist")));
            }
        }
        self.facings.push(new);
        Ok(count)
    }
}

/// Bytes of the section. Charts are numbered in the order of [`visiting_order`], as [`super::atlas::layout`] makes them.
pub fn encode(mesh: &Mesh, charts: &Charts) -> Result<Vec<u8>> {
    if charts.chart_of_triangle.len() != mesh.triangles.len() {
        return Err(Error::parameter("the charts belong to another mesh"));
    }
    let mut bytes = Vec::new();
    push_f32(&mut bytes, charts.texels_per_unit as f32);
    let mut coder = RangeEncoder::new();
    let neighbours = neighbours(mesh);
    let order = visiting_order(&neighbours);
    let chart_of_triangle = vec![NONE; mesh.triangles.len()];
    let mut visit = Visit { mesh, neighbours, chart_of_triangle, facings: Vec::new(), models: ChartModels::default() };
    visit.models.size.code(&mut coder, charts.width);
    visit.models.size.code(&mut coder, charts.height);
    for &t in &order {
        let wanted = charts.chart_of_triangle[t as usize];
        let Some(chart) = charts.charts.get(wanted as usize) else {
            return Err(Error::parameter(format!("triangle {t} names chart {wanted}, which does not exist")));
        };
        if wanted as usize > visit.facings.len() {
            return Err(Error::parameter("charts must be numbered in visiting order"));
        }
        visit.chart_of_triangle[t as usize] = visit.triangle(&mut coder, t as usize, wanted, chart.facing)?;
    }
    if visit.facings.len() != charts.charts.len() {
        return Err(Error::parameter("a chart has no triangle"));
    }
    for chart in &charts.charts {
        for k in 0..2 {
            visit.models.offset[k].code_signed(&mut coder, chart.offset[k]);
        }
    }
    bytes.extend(coder.finish());
    Ok(bytes)
}

/// Charts of a section, for the mesh they were made for. Every triangle lies within the atlas, half a texel from its border.
pub fn decode(bytes: &[u8], mesh: &Mesh, budget: &Budget) -> Result<Charts> {
    let Some((head, rest)) = bytes.split_first_chunk::<4>() else {
        return Err(Error::format(Tag::CHARTS, bytes.len() as u64, "ends within the texel density; 4 bytes expected"));
    };
    let texels_per_unit = LittleEndian::read_f32(head) as f64;
    if !(texels_per_unit.is_finite() && texels_per_unit > 0.0) {
        return Err(Error::format(Tag::CHARTS, 0u64, "the texel density must be a positive number"));
    }
    let (vertices, count) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    check("triangles", count, budget.limits().mesh_elements as u64)?;
    if mesh.triangles.iter().flatten().any(|&v| v as u64 >= vertices) {
        return Err(Error::parameter("the mesh names vertices that it does not have"));
    }
    // Edges 36, neighbours 12, order 4, visited 1, charts at most 13 bytes a triangle; given back but for the charts.
    budget.charge_items("charts", count, 70)?;
    let mut coder = RangeDecoder::new(rest);
    let neighbours = neighbours(mesh);
    let order = visiting_order(&neighbours);
    let chart_of_triangle = vec![NONE; mesh.triangles.len()];
    let mut visit = Visit { mesh, neighbours, chart_of_triangle, facings: Vec::new(), models: ChartModels::default() };
    let width = visit.models.size.code(&mut coder, 0);
    let height = visit.models.size.code(&mut coder, 0);
    let side = budget.limits().image_side as u64;
    check("atlas width", width as u64, side)?;
    check("atlas height", height as u64, side)?;
    for &t in &order {
        visit.chart_of_triangle[t as usize] = visit.triangle(&mut coder, t as usize, NONE, 0)?;
    }
    let mut charts = Charts { width, height, texels_per_unit, charts: Vec::new(), chart_of_triangle: Vec::new() };
    for &facing in &visit.facings {
        let [x, y] = &mut visit.models.offset;
        charts.charts.push(Chart { facing, offset: [x.code_signed(&mut coder, 0), y.code_signed(&mut coder, 0)] });
    }
    charts.chart_of_triangle = visit.chart_of_triangle;
    if !coder.ends_as_written(0) {
        return Err(Error::format(Tag::CHARTS, bytes.len() as u64, "its length does not fit its content"));
    }
    for t in 0..mesh.triangles.len() {
        let inside = |[x, y]: [f64; 2]| x >= 0.5 && y >= 0.5 && x <= width as f64 - 0.5 && y <= height as f64 - 0.5;
        if !charts.corners(mesh, t).into_iter().all(inside) {
            return Err(Error::format(Tag::CHARTS, bytes.len() as u64, format!("triangle {t} lies outside the atlas")));
        }
    }
    budget.release(count * 53);
    Ok(charts)
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::limits::Limits;
    use crate::surface::atlas::tests::bumpy_sphere;

    fn sample() -> (Mesh, Charts, Vec<u8>) {
        let mesh = bumpy_sphere(24);
        let charts = crate::surface::atlas::layout(&mesh, 40.0).unwrap();
        let bytes = encode(&mesh, &charts).unwrap();
        (mesh, charts, bytes)
    }

    #[test]
    fn charts_come_back() {
        let (mesh, charts, bytes) = sample();
        let back = decode(&bytes, &mesh, &Budget::new(Limits::default())).unwrap();
        assert_eq!(back, charts);
        assert!(bytes.len() * 8 < mesh.triangles.len(), "{} bytes, {} triangles", bytes.len(), mesh.triangles.len());
    }

    #[test]
    fn damage_never_harms() {
        let (mesh, _, bytes) = sample();
        let decode = |b: &[u8]| decode(b, &mesh, &Budget::new(Limits::default()));
        for end in 0..bytes.len() {
            let _ = decode(&bytes[..end]);
            let mut damaged = bytes.clone();
            damaged[end] ^= 0x55;
            let _ = decode(&damaged);
        }
        assert!(decode(&bytes[..3]).is_err());
        assert!(decode(&[bytes.as_slice(), &[7; 9]].concat()).is_err());
        assert!(decode(&[&f32::NAN.to_le_bytes()[..], &bytes[4..]].concat()).is_err());
        let poor = Limits { memory_bytes: 1000, ..Limits::default() };
        assert!(matches!(super::decode(&bytes, &mesh, &Budget::new(poor)), Err(Error::Limits { .. })));
    }
}
