//! Section `vISB`: bases and weights as integers, coded in two groups of terms; the first alone is visibility of its own.
//!
//! Bases are images on the octahedral grid, predicted from the cells left and above; a sample's weights are predicted from
//! those neighbours in the cut mesh that came before it. Normative text: `spec/visibility.md`.

use super::{Visibility, VisibilityError};
use crate::container::{Tag, push_f32, push_u32};
use crate::entropy::{BitCoder, NumberModel, RangeDecoder, code_end};
use crate::error::{Error, Result};
use crate::limits::Budget;
use crate::mesh::Mesh;
use crate::surface::samples::SurfaceSamples;
use byteorder::{ByteOrder, LittleEndian};

const VERSION: u8 = 0;
/// Version, flags, cells a side, terms of both groups, samples, spacing, two errors, length of the first stream.
const HEADER_BYTES: usize = 5 + 8 + 8 + 4;
/// Offset of the errors in the header.
const ERRORS: usize = 13;
/// Cells along a side of the grid. Part of the format.
pub(super) const SIZES: std::ops::RangeInclusive<usize> = 8..=128;
/// Steps of a mean, a base or its weights. Part of the format.
pub(super) const STEPS: std::ops::RangeInclusive<f32> = 1e-6..=1e4;
/// Most terms of a group. Part of the format.
pub(super) const MAX_TERMS: usize = 64;
/// Largest integer of a mean or a base. Part of the format.
const MAX_INTEGER: i32 = 1 << 15;
/// Classes of neighbouring residuals that choose a model. Part of the format.
const CLASSES: usize = 7;

/// Steps of the integers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VisibilitySteps {
    pub mean: f32,
    /// For each term those of its base and of its weights.
    pub terms: Vec<[f32; 2]>,
}

/// Content of the section, as integers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VisibilityContent {
    pub size: usize,
    pub terms: [usize; 2],
    pub ground: bool,
    pub error: VisibilityError,
    pub steps: VisibilitySteps,
    pub mean: Vec<i32>,
    pub bases: Vec<Vec<i32>>,
    pub places: SurfaceSamples,
    /// For each sample one for each term.
    pub weights: Vec<i8>,
}

impl VisibilityContent {
    /// With numbers in place of integers.
    pub(crate) fn visibility(self) -> Visibility {
        let cells = self.size * self.size;
        let mut bases = Vec::with_capacity(cells * (self.bases.len() + 1));
        for cell in 0..cells {
            bases.push((self.mean[cell] as f64 * self.steps.mean as f64) as f32);
            for (base, [step, weight_step]) in self.bases.iter().zip(&self.steps.terms) {
                bases.push((base[cell] as f64 * *step as f64 * *weight_step as f64) as f32);
            }
        }
        Visibility {
            size: self.size,
            terms: self.terms,
            ground: self.ground,
            error: self.error,
            bases,
            places: self.places,
            weights: self.weights,
        }
    }
}

/// Values as integers of one step.
#[cfg(feature = "encode")]
pub(super) struct QuantisedValues {
    pub step: f32,
    pub integers: Vec<i32>,
}

#[cfg(feature = "encode")]
impl QuantisedValues {
    /// The values again.
    pub(crate) fn values(&self) -> Vec<f32> {
        self.integers.iter().map(|&q| (q as f64 * self.step as f64) as f32).collect()
    }
}

/// Rounds to multiples of a step, or of a larger one where the integers would not hold them.
#[cfg(feature = "encode")]
pub(super) fn quantise(values: &[f32], step: f64) -> QuantisedValues {
    let largest = values.iter().fold(0.0f64, |most, v| most.max(v.abs() as f64));
    let step = step.max(largest / (MAX_INTEGER - 1) as f64).clamp(1e-6, 1e3) as f32;
    let integers =
        values.iter().map(|v| ((*v as f64 / step as f64).round() as i32).clamp(-MAX_INTEGER, MAX_INTEGER)).collect();
    QuantisedValues { step, integers }
}

/// The section, for the mesh whose samples the weights belong to.
#[cfg(feature = "encode")]
pub(super) fn write(content: &VisibilityContent, mesh: &Mesh) -> Vec<u8> {
    let before = CodedNeighbours::new(&content.places.subdivided(mesh));
    let streams: [Vec<u8>; 2] = std::array::from_fn(|group| {
        let mut content = content.clone();
        let mut coder = crate::entropy::RangeEncoder::new();
        if content.terms[group] > 0 {
            // The encoder's own integers are within their ranges.
            let _ = code_group(&mut coder, &mut content, group, &before);
        }
        coder.finish()
    });
    let mut bytes = vec![VERSION, content.ground as u8, content.size as u8];
    bytes.extend(content.terms.map(|terms| terms as u8));
    push_u32(&mut bytes, content.places.count() as u32);
    push_f32(&mut bytes, content.places.spacing());
    push_f32(&mut bytes, content.error.rms_radians);
    push_f32(&mut bytes, content.error.wrong_signs);
    push_u32(&mut bytes, streams[0].len() as u32);
    let steps = std::iter::once(content.steps.mean).chain(content.steps.terms.iter().flatten().copied());
    steps.for_each(|step| push_f32(&mut bytes, step));
    bytes.extend(streams.concat());
    bytes
}

/// Writes the measured error into a section.
#[cfg(feature = "encode")]
pub(super) fn state_error(bytes: &mut [u8], error: VisibilityError) {
    if let Some(place) = bytes.get_mut(ERRORS..ERRORS + 8) {
        LittleEndian::write_f32_into(&[error.rms_radians, error.wrong_signs], place);
    }
}

/// Decodes the visibility of a section, for the mesh of the same file.
///
/// # Errors
///
/// [`Error::Format`] for bytes that are no such section of this mesh, [`Error::Limits`] beyond the budget.
pub fn decode(bytes: &[u8], mesh: &Mesh, budget: &Budget) -> Result<Visibility> {
    let wrong = |at: usize, message: String| Error::format(Tag::VISIBILITY, at as u64, message);
    let Some((header, rest)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
        return Err(wrong(bytes.len(), format!("ends within its head of {HEADER_BYTES} bytes")));
    };
    let [version, flags, size, first, second, ..] = *header;
    if version != VERSION || flags > 1 {
        return Err(Error::Unsupported(format!("section vISB of version {version}, flags {flags}")));
    }
    let word = |at: usize| LittleEndian::read_u32(&header[at..]) as usize;
    let (size, terms) = (size as usize, [first as usize, second as usize]);
    let count = terms[0] + terms[1];
    if !SIZES.contains(&size) || terms[0] == 0 || terms.iter().any(|&terms| terms > MAX_TERMS) {
        return Err(wrong(2, format!("{size} cells a side, {} and {} terms", terms[0], terms[1])));
    }
    let single = |at: usize| LittleEndian::read_f32(&header[at..]);
    let spacing = single(9);
    if !(spacing.is_finite() && spacing >= 0.0) {
        return Err(wrong(9, format!("{spacing} is no distance of places")));
    }
    let places = SurfaceSamples::new(mesh, spacing, budget)?;
    let count_of_places = places.count();
    let stated = word(5);
    if stated != count_of_places {
        return Err(wrong(5, format!("made for {stated} places, the mesh has {count_of_places}")));
    }
    let error = VisibilityError { rms_radians: single(ERRORS), wrong_signs: single(ERRORS + 4) };
    if !(0.0..=4.0).contains(&error.rms_radians) || !(0.0..=1.0).contains(&error.wrong_signs) {
        return Err(wrong(ERRORS, "errors are 0 to 4 radians and 0 to 1".into()));
    }
    let Some((step_bytes, streams)) = rest.split_at_checked(4 * (1 + 2 * count)) else {
        return Err(wrong(bytes.len(), "ends within its steps".into()));
    };
    let mut numbers = Vec::with_capacity(1 + 2 * count);
    for (k, four) in step_bytes.chunks_exact(4).enumerate() {
        let step = LittleEndian::read_f32(four);
        if !STEPS.contains(&step) {
            return Err(wrong(HEADER_BYTES + 4 * k, format!("{step} is no step: 1e-6 to 1e4")));
        }
        numbers.push(step);
    }
    let steps = VisibilitySteps {
        mean: numbers[0],
        terms: numbers[1..].chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect(),
    };
    let first_length = word(HEADER_BYTES - 4);
    let streams_at = HEADER_BYTES + step_bytes.len();
    let Some((first_stream, second_stream)) = streams.split_at_checked(first_length) else {
        return Err(wrong(
            HEADER_BYTES - 4,
            format!("first stream of {first_length} bytes, {} are left", streams.len()),
        ));
    };
    if terms[1] == 0 && !second_stream.is_empty() {
        return Err(wrong(streams_at + first_length, "a second stream without terms".into()));
    }
    let cells = size * size;
    budget.charge_items("bases of the visibility", cells as u64 * (count as u64 + 1), 8)?;
    budget.charge_items("weights of the visibility", count_of_places as u64, 2 * count + 24)?;
    let cut = places.subdivided(mesh);
    budget.charge_items("neighbours of the places", cut.triangles.len() as u64, 40)?;
    let before = CodedNeighbours::new(&cut);
    let mut content = VisibilityContent {
        size,
        terms,
        ground: flags & 1 == 1,
        error,
        steps,
        mean: vec![0; cells],
        bases: vec![vec![0; cells]; count],
        weights: vec![0; count_of_places * count],
        places,
    };
    for (group, stream) in [first_stream, second_stream].into_iter().enumerate() {
        let at = streams_at + group * first_length;
        let mut coder = RangeDecoder::new(stream);
        if terms[group] > 0 {
            code_group(&mut coder, &mut content, group, &before).map_err(|message| wrong(at, message.into()))?;
            if !code_end(&mut coder) || !coder.ends_as_written(0) {
                return Err(wrong(at, "the stream does not end with the last weight".into()));
            }
        }
    }
    Ok(content.visibility())
}

/// Codes a group's bases (the first group's mean before them) and weights, and in encoding the end.
fn code_group<C: BitCoder>(
    coder: &mut C,
    content: &mut VisibilityContent,
    group: usize,
    before: &CodedNeighbours,
) -> std::result::Result<(), &'static str> {
    let VisibilityContent { size, terms, mean, bases, weights, .. } = content;
    let count = terms[0] + terms[1];
    let range = if group == 0 { 0..terms[0] } else { terms[0]..count };
    let mut models: Vec<NumberModel> = vec![NumberModel::default(); CLASSES];
    if group == 0 {
        code_picture(coder, &mut models, mean, *size)?;
    }
    for base in &mut bases[range.clone()] {
        code_picture(coder, &mut models, base, *size)?;
    }
    let mut models: Vec<NumberModel> = vec![NumberModel::default(); CLASSES * range.len()];
    let places = weights.len() / count;
    for place in 0..places {
        let neighbours = before.of(place);
        // Magnitudes of this sample's residuals so far, in quarters, fading.
        let mut activity = 8u32;
        for (k, term) in range.clone().enumerate() {
            let sum: i32 = neighbours.iter().map(|&n| weights[n as usize * count + term] as i32).sum();
            let predicted = match neighbours.len() as i32 {
                0 => 0,
                n => (2 * sum + n).div_euclid(2 * n),
            };
            let weight = &mut weights[place * count + term];
            let model = &mut models[k * CLASSES + class(activity >> 1)];
            let residual = model.code_signed(coder, *weight as i32 - predicted);
            *weight = i8::try_from(residual.saturating_add(predicted)).map_err(|_| "a weight of more than 8 bits")?;
            activity = activity - (activity >> 2) + residual.unsigned_abs();
        }
    }
    if !C::DECODES {
        code_end(coder);
    }
    Ok(())
}

/// Codes an image of `size * size` integers.
fn code_picture<C: BitCoder>(
    coder: &mut C,
    models: &mut [NumberModel],
    picture: &mut [i32],
    size: usize,
) -> std::result::Result<(), &'static str> {
    let mut residuals = vec![0u32; picture.len()];
    for at in 0..picture.len() {
        let (left, above) = (at % size > 0, at >= size);
        let (predicted, activity) = match (left, above) {
            (true, true) => {
                let (w, n, corner) = (picture[at - 1], picture[at - size], picture[at - size - 1]);
                // The median of left, above, and the plane through the three.
                let predicted = (w + n - corner).clamp(w.min(n), w.max(n));
                (predicted, residuals[at - 1] + residuals[at - size])
            }
            (true, false) => (picture[at - 1], 2 * residuals[at - 1]),
            (false, true) => (picture[at - size], 2 * residuals[at - size]),
            (false, false) => (0, 0),
        };
        let residual = models[class(activity)].code_signed(coder, picture[at] - predicted);
        let value = residual.saturating_add(predicted);
        if !(-MAX_INTEGER..=MAX_INTEGER).contains(&value) {
            return Err("a base beyond its range");
        }
        picture[at] = value;
        residuals[at] = residual.unsigned_abs().min(1 << 20);
    }
    Ok(())
}

fn class(activity: u32) -> usize {
    ((32 - activity.leading_zeros()) as usize).min(CLASSES - 1)
}

/// For each vertex of the cut mesh those vertices of its triangles that come before it, each once, ascending.
struct CodedNeighbours {
    first: Vec<u32>,
    vertices: Vec<u32>,
}

impl CodedNeighbours {
    fn new(mesh: &Mesh) -> Self {
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
        for &[a, b, c] in &mesh.triangles {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if p != q {
                    pairs.push((p.max(q), p.min(q)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut first = vec![0u32; mesh.positions.len() + 1];
        for &(later, _) in &pairs {
            if let Some(count) = first.get_mut(later as usize + 1) {
                *count += 1;
            }
        }
        for k in 1..first.len() {
            first[k] += first[k - 1];
        }
        CodedNeighbours { first, vertices: pairs.into_iter().map(|(_, earlier)| earlier).collect() }
    }
    fn of(&self, vertex: usize) -> &[u32] {
        let range = self.first[vertex] as usize..self.first[vertex + 1] as usize;
        self.vertices.get(range).unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use crate::limits::Limits;
    use crate::visibility::codec::*;

    /// A strip of triangles and numbers that vary along it.
    fn sample(terms: [usize; 2], spacing: f32) -> (Mesh, VisibilityContent) {
        let positions = (0..30).map(|k| [k as f32, (k % 2) as f32, 0.0]).collect();
        let mesh = Mesh { positions, triangles: (0..28).map(|k| [k, k + 1, k + 2]).collect() };
        let places = SurfaceSamples::new(&mesh, spacing, &Budget::new(Limits::default())).unwrap();
        let (size, count) = (8, terms[0] + terms[1]);
        let picture =
            |seed: usize| (0..size * size).map(move |k| ((k * seed) as f64 * 0.1).sin() * 90.0).map(|x| x as i32);
        let content = VisibilityContent {
            size,
            terms,
            ground: true,
            error: VisibilityError { rms_radians: 0.02, wrong_signs: 0.01 },
            steps: VisibilitySteps { mean: 0.01, terms: vec![[0.02, 0.5]; count] },
            mean: picture(3).collect(),
            bases: (0..count).map(|k| picture(k + 5).collect()).collect(),
            weights: (0..places.count() * count).map(|k| (k % 255) as i8).collect(),
            places,
        };
        (mesh, content)
    }

    fn read(bytes: &[u8], mesh: &Mesh) -> Result<Visibility> {
        decode(bytes, mesh, &Budget::new(Limits { memory_bytes: 1 << 20, ..Limits::default() }))
    }

    #[test]
    fn content_comes_back_and_damage_is_an_error() {
        for (terms, spacing) in [([3, 2], 0.0), ([2, 0], 1.2)] {
            let (mesh, content) = sample(terms, spacing);
            let bytes = write(&content, &mesh);
            assert_eq!(read(&bytes, &mesh).unwrap(), content.clone().visibility());
            for length in 0..bytes.len() {
                assert!(read(&bytes[..length], &mesh).is_err(), "{length}");
            }
            for extra in [0, 1] {
                assert!(read(&[&bytes[..], &[extra]].concat(), &mesh).is_err());
            }
            let heads = [
                (0, 1),
                (1, 2),
                (2, 7),
                (2, 129),
                (3, 0),
                (3, 65),
                (5, 31),
                (8, 1),
                (12, 0xff),
                (16, 0xff),
                (21, 0xff),
                (28, 0xff),
            ];
            for (at, value) in heads {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                assert!(read(&damaged, &mesh).is_err(), "byte {at}");
            }
            for at in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << (at % 8);
                if let Ok(visibility) = read(&damaged, &mesh) {
                    assert!(visibility.signed_distance(7, [0.6, 0.8, 0.0]).abs() <= 1.6);
                }
            }
            let tight = Budget::new(Limits { memory_bytes: 1000, ..Limits::default() });
            assert!(matches!(decode(&bytes, &mesh, &tight), Err(Error::Limits { .. })));
            let fewer = Mesh { positions: mesh.positions[..29].to_vec(), triangles: mesh.triangles[..27].to_vec() };
            assert!(matches!(read(&bytes, &fewer), Err(Error::Format { .. })));
        }
    }

    #[test]
    fn evaluation_is_the_sum_of_terms() {
        let (mesh, content) = sample([3, 2], 0.0);
        let visibility = read(&write(&content, &mesh), &mesh).unwrap();
        let direction = crate::sphere::octahedral::directions(8)[20];
        let mut basis = [0.0; 6];
        visibility.basis(direction, &mut basis);
        let expected = 0.01 * content.mean[20] as f32
            + (0..5)
                .map(|k| 0.02 * 0.5 * (content.bases[k][20] * content.weights[5 * 4 + k] as i32) as f32)
                .sum::<f32>();
        let clamped = expected.clamp(-std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2) as f64;
        assert!((crate::visibility::unbounded_distance(&basis, visibility.weights(4)) - expected).abs() < 1e-3);
        assert!((visibility.signed_distance(4, direction) - clamped).abs() < 1e-3);
        let mut weights = [0.0; 5];
        visibility.interpolate([4, 4, 9], [0.5, 0.5, 0.0], &mut weights);
        assert!((visibility.signed_distance_of_weights(&weights, direction) - clamped).abs() < 1e-3);
        assert_eq!(visibility.weights(30), &[] as &[i8]);
        assert_eq!((visibility.places().count(), visibility.groups(), visibility.has_ground()), (30, [3, 2], true));
    }
}
