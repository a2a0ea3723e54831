//! Texture coordinates of the triangles' corners, and section `tCOR` that holds them: each predicted across the edge to a triangle before.
//! Specified in `spec/coordinates.md`.

use super::Mesh;
use crate::container::Tag;
#[cfg(feature = "encode")]
use crate::container::push_f32;
use crate::entropy::{BitCoder, BitModel, NumberModel, RangeDecoder, code_end};
use crate::error::{Error, Result};
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use std::collections::HashMap;

/// First byte of the section. Part of the format.
const VERSION: u8 = 0;
/// Version, bits, origin, step.
const HEADER_BYTES: usize = 2 + 3 * 4;
/// Bits of a coordinate on the longer side. Part of the format.
const BITS: std::ops::RangeInclusive<u8> = 1..=24;
/// Largest coordinate, on either side of 0. Part of the format.
const MAX_COORDINATE: f32 = 1e6;
/// Memory that decoding takes for a triangle; 24 bytes stay.
const TRIANGLE_BYTES: usize = 24 + 24 + 3 * 48;

/// Texture coordinates of three corners.
pub type CornerCoordinates = [[f32; 2]; 3];
/// Point of the lattice.
type Point = [i32; 2];

/// The lattice of the coordinates.
#[derive(Clone, Copy)]
struct CoordinateLattice {
    bits: u8,
    origin: [f32; 2],
    step: f32,
}

impl CoordinateLattice {
    fn max(&self) -> i32 {
        (1 << self.bits) - 1
    }

    /// Computed in double precision, rounded once.
    fn value(&self, point: Point) -> [f32; 2] {
        std::array::from_fn(|k| (f64::from(self.origin[k]) + f64::from(point[k]) * f64::from(self.step)) as f32)
    }

    #[cfg(feature = "encode")]
    fn nearest(&self, value: [f32; 2]) -> Point {
        std::array::from_fn(|k| {
            let steps = (f64::from(value[k]) - f64::from(self.origin[k])) / f64::from(self.step);
            (steps.round() as i32).clamp(0, self.max())
        })
    }
}

/// Adaptive models of corners.
#[derive(Default)]
struct CoordinateModels {
    /// Whether a corner has the expected value: that of the triangle across an edge, or that last seen at its vertex.
    is_expected: [BitModel; 2],
    /// Differences to a prediction along a parallelogram, and to others.
    residuals: [[NumberModel; 2]; 2],
}

/// A value that a corner may have, and a prediction of others.
struct Prediction {
    expected: Option<Point>,
    predicted: Point,
    is_parallelogram: bool,
}

impl CoordinateModels {
    /// Codes a corner; `None` for a point outside of the lattice.
    fn code<C: BitCoder>(&mut self, coder: &mut C, from: &Prediction, max: i32, value: Point) -> Option<Point> {
        let class = usize::from(from.is_parallelogram);
        if let Some(expected) = from.expected
            && self.is_expected[class].code(coder, value == expected)
        {
            return Some(expected);
        }
        let mut point = [0; 2];
        for k in 0..2 {
            let difference = value[k] - from.predicted[k];
            let residual = self.residuals[class][k].code_signed(coder, difference);
            point[k] = from.predicted[k].checked_add(residual).filter(|x| (0..=max).contains(x))?;
        }
        Some(point)
    }
}

/// Codes the corners of all triangles; `None` where a point lies outside of the lattice.
fn code<C: BitCoder>(coder: &mut C, mesh: &Mesh, corners: &mut [[Point; 3]], max: i32) -> Option<()> {
    let mut models = CoordinateModels::default();
    // The corner opposite to a directed edge, and the last value at a vertex.
    let mut opposite: HashMap<(u32, u32), u32> = HashMap::with_capacity(3 * corners.len());
    let mut last: Vec<Option<Point>> = vec![None; mesh.positions.len()];
    let mut before = [0; 2];
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        let vertex = |k: usize| triangle[k % 3];
        let across = (0..3).find_map(|k| Some((k, *opposite.get(&(vertex(k + 2), vertex(k + 1)))?)));
        let given = corners[number];
        let mut coded = [[0; 2]; 3];
        match across {
            Some((k, apex)) => {
                let (other, at) = (corners[apex as usize / 3], apex as usize % 3);
                let shared = [other[(at + 2) % 3], other[(at + 1) % 3]];
                for (j, expected) in shared.into_iter().enumerate() {
                    let corner = (k + 1 + j) % 3;
                    let from = Prediction { expected: Some(expected), predicted: expected, is_parallelogram: false };
                    coded[corner] = models.code(coder, &from, max, given[corner])?;
                }
                let [a, b] = [coded[(k + 1) % 3], coded[(k + 2) % 3]];
                // Where the edge is a seam, the triangle behind it says nothing.
                let is_parallelogram = [a, b] == shared;
                let along = |c: usize| (a[c] + b[c] - other[at][c]).clamp(0, max);
                let predicted = if is_parallelogram { [along(0), along(1)] } else { a };
                let from = Prediction { expected: last[triangle[k] as usize], predicted, is_parallelogram };
                coded[k] = models.code(coder, &from, max, given[k])?;
            }
            None => {
                for (corner, &vertex) in triangle.iter().enumerate() {
                    let expected = last[vertex as usize];
                    let from = Prediction { expected, predicted: before, is_parallelogram: false };
                    coded[corner] = models.code(coder, &from, max, given[corner])?;
                    before = coded[corner];
                }
            }
        }
        before = coded[2];
        corners[number] = coded;
        for k in 0..3 {
            last[triangle[k] as usize] = Some(coded[k]);
            opposite.insert((vertex(k + 1), vertex(k + 2)), (3 * number + k) as u32);
        }
    }
    Some(())
}

/// Returns section `tCOR` of the corners of a coded mesh's triangles, on a lattice of `bits` bits on the longer side, and what decoding it
/// returns.
///
/// # Errors
///
/// [`Error::Parameter`] for another number of triangles, bits that are not 1 to 24, and coordinates that are not finite or beyond 1000000.
#[cfg(feature = "encode")]
pub fn encode_coordinates(
    coordinates: &[CornerCoordinates],
    mesh: &Mesh,
    bits: u8,
) -> Result<(Vec<u8>, Vec<CornerCoordinates>)> {
    if coordinates.len() != mesh.triangles.len() || !BITS.contains(&bits) {
        return Err(Error::parameter("texture coordinates are those of a mesh's triangles, in 1 to 24 bits"));
    }
    let all = || coordinates.as_flattened().iter();
    if !all().flatten().all(|x| x.abs() <= MAX_COORDINATE) {
        return Err(Error::parameter("a texture coordinate is not finite or beyond 1000000"));
    }
    let bound = |k: usize, pick: fn(f32, f32) -> f32| all().map(|uv| uv[k]).reduce(pick).unwrap_or(0.0);
    let origin = [bound(0, f32::min), bound(1, f32::min)];
    let longest = (0..2).map(|k| f64::from(bound(k, f32::max)) - f64::from(origin[k])).fold(0.0, f64::max);
    let exact = (longest / f64::from((1u32 << bits) - 1)).max(1e-30);
    // Never too short for the longer side.
    let step = if f64::from(exact as f32) >= exact { exact as f32 } else { (exact as f32).next_up() };
    let lattice = CoordinateLattice { bits, origin, step };
    let mut corners: Vec<[Point; 3]> =
        coordinates.iter().map(|corners| corners.map(|uv| lattice.nearest(uv))).collect();
    let mut bytes = vec![VERSION, bits];
    [origin[0], origin[1], step].into_iter().for_each(|value| push_f32(&mut bytes, value));
    let mut coder = crate::entropy::RangeEncoder::new();
    code(&mut coder, mesh, &mut corners, lattice.max())
        .ok_or_else(|| Error::parameter("texture coordinate outside of its lattice"))?;
    code_end(&mut coder);
    bytes.extend(coder.finish());
    Ok((bytes, corners.into_iter().map(|corners| corners.map(|point| lattice.value(point))).collect()))
}

/// Reads section `tCOR` of a mesh.
///
/// # Errors
///
/// [`Error::Format`] where the section breaks a rule of `spec/coordinates.md`, [`Error::Unsupported`] for another version, [`Error::Limits`]
/// beyond the budget.
pub fn decode_coordinates(bytes: &[u8], mesh: &Mesh, budget: &Budget) -> Result<Vec<CornerCoordinates>> {
    let wrong = |message: &str| Error::format(Tag::COORDINATES, 1u8, message);
    match bytes.first() {
        Some(&VERSION) => {}
        Some(version) => {
            let message = format!("version {version} of section {}; this build reads {VERSION}", Tag::COORDINATES);
            return Err(Error::Unsupported(message));
        }
        None => return Err(wrong("empty")),
    }
    let Some((header, stream)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
        return Err(wrong("ends within its head"));
    };
    let single = |k: usize| LittleEndian::read_f32(&header[2 + 4 * k..]);
    let lattice = CoordinateLattice { bits: header[1], origin: [single(0), single(1)], step: single(2) };
    if !BITS.contains(&lattice.bits) {
        return Err(wrong("lattice of less than 1 or more than 24 bits"));
    }
    let ends = [lattice.value([0; 2]), lattice.value([lattice.max(); 2])];
    let is_within = ends.iter().flatten().all(|x| x.abs() <= 4.0 * MAX_COORDINATE);
    if !is_within || lattice.step.is_nan() || lattice.step <= 0.0 {
        return Err(wrong("lattice beyond 4000000, or of no step"));
    }
    let triangles = mesh.triangles.len() as u64;
    let vertices = mesh.positions.len() as u64;
    budget.charge_items("texture coordinates", triangles, TRIANGLE_BYTES)?;
    let _last = budget.reserve("texture coordinates", vertices * size_of::<Option<Point>>() as u64)?;
    let mut corners = vec![[[0; 2]; 3]; mesh.triangles.len()];
    let mut coder = RangeDecoder::new(stream);
    code(&mut coder, mesh, &mut corners, lattice.max()).ok_or_else(|| wrong("coordinate outside of the lattice"))?;
    if !code_end(&mut coder) || !coder.ends_as_written(0) {
        return Err(wrong("bytes do not end with the last coordinate"));
    }
    budget.release(triangles * (TRIANGLE_BYTES - 24) as u64);
    Ok(corners.into_iter().map(|corners| corners.map(|point| lattice.value(point))).collect())
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::limits::Limits;

    /// A sheet of squares, cut into two charts at the middle.
    fn sheet(side: u32) -> (Mesh, Vec<CornerCoordinates>) {
        let mut mesh = Mesh::default();
        let mut coordinates = Vec::new();
        mesh.positions.extend((0..side * side).map(|k| [(k % side) as f32, (k / side) as f32, 0.0]));
        for (x, y) in (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (x, y))) {
            let at = |x: u32, y: u32| y * side + x;
            let uv = |v: u32| {
                let shift = if x < side / 2 { 0.0 } else { 0.31 };
                [(v % side) as f32 / side as f32 + shift, 0.8 * (v / side) as f32 / side as f32 - 0.1]
            };
            for triangle in [[at(x, y), at(x + 1, y), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x, y + 1)]] {
                mesh.triangles.push(triangle);
                coordinates.push(triangle.map(uv));
            }
        }
        (mesh, coordinates)
    }

    #[test]
    fn coordinates_come_back_within_half_a_step_and_damage_is_found() {
        let (mesh, coordinates) = sheet(24);
        let budget = || Budget::new(Limits { memory_bytes: 1 << 22, ..Limits::default() });
        let (bytes, decoded) = encode_coordinates(&coordinates, &mesh, 12).unwrap();
        assert_eq!(decode_coordinates(&bytes, &mesh, &budget()).unwrap(), decoded);
        let worst = (coordinates.as_flattened().as_flattened().iter())
            .zip(decoded.as_flattened().as_flattened())
            .fold(0f32, |worst, (a, b)| worst.max((a - b).abs()));
        // 1.27 wide, so that half a step is 1.6e-4.
        assert!(worst < 1.7e-4, "{worst}");
        assert!(bytes.len() < 1000, "{} bytes of {} triangles", bytes.len(), mesh.triangles.len());
        for cut in 0..bytes.len() {
            assert!(decode_coordinates(&bytes[..cut], &mesh, &budget()).is_err(), "cut at {cut}");
        }
        assert!(decode_coordinates(&[&bytes[..], &[0]].concat(), &mesh, &budget()).is_err());
        let (other, _) = sheet(23);
        assert!(decode_coordinates(&bytes, &other, &budget()).is_err());
        for (at, value) in [(0, 1), (1, 0), (1, 25), (5, 0x7f), (13, 0x80), (13, 0x7f)] {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            assert!(decode_coordinates(&damaged, &mesh, &budget()).is_err(), "{at}");
        }
        let small = Budget::new(Limits { memory_bytes: 1000, ..Limits::default() });
        assert!(matches!(decode_coordinates(&bytes, &mesh, &small), Err(Error::Limits { .. })));
        // One value for all, and none.
        let even = vec![[[0.5; 2]; 3]; mesh.triangles.len()];
        let (bytes, decoded) = encode_coordinates(&even, &mesh, 10).unwrap();
        assert!(bytes.len() < 60 && decoded == even);
        assert!(encode_coordinates(&[], &Mesh::default(), 10).is_ok());
        for wrong in [f32::NAN, 2e6] {
            assert!(encode_coordinates(&vec![[[wrong; 2]; 3]; mesh.triangles.len()], &mesh, 10).is_err());
        }
        assert!(encode_coordinates(&coordinates[1..], &mesh, 10).is_err());
    }
}
