//! Views: white board, components, and of each photograph its name, camera and light. Specified in `spec/container.md`.
//!
//! Poses and lights are integers on lattices, coded as differences to what a turntable would do next: rotations continue the last
//! rotation, translations and lights stay where they were, as seen from the camera. What they mean in floating point is
//! computed with `+ - * / sqrt` in a written order, so that every machine decodes the same cameras.

use super::{Camera, Component, PointLight, View};
use crate::container::Tag;
use crate::entropy::{BitCoder, BitModel, NumberModel, RangeDecoder, code_end, code_raw};
use crate::limits::{Budget, check};
use crate::{Error, Result};

#[cfg(feature = "encode")]
mod write;
#[cfg(feature = "encode")]
pub use write::encode;

/// First byte of the section. Part of the format.
const VERSION: u8 = 0;
/// Longest name in bytes. Part of the format.
const MAX_NAME_BYTES: usize = 1024;
/// Exponents of the lattices: a step is `2^-exponent`. Part of the format.
const ROTATION_EXPONENTS: std::ops::RangeInclusive<i32> = 8..=29;
const LENGTH_EXPONENTS: std::ops::RangeInclusive<i32> = -30..=60;
/// Largest lattice coordinate. Part of the format.
const MAX_COORDINATE: i64 = 1 << 30;

/// Content of section VIEW.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ViewsSection {
    /// Radiance of the white board under the unpolarised light.
    pub white: [f64; 3],
    /// The components of every view.
    pub components: Vec<Component>,
    /// The views in the capture's order.
    pub views: Vec<View>,
}

/// Parameters that precede the views.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ViewHeader {
    rotation_exponent: i32,
    length_exponent: i32,
    /// Whether lights are on the lattice of the camera's axes or of the world's.
    lights_follow_camera: bool,
    /// A light is predicted by the one so many lights ago.
    light_lag: usize,
}

/// Rotation as a unit quaternion `w, x, y, z`, translation on the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LatticePose {
    rotation: [f64; 4],
    translation: [i64; 3],
}

const IDENTITY_POSE: LatticePose = LatticePose { rotation: [1.0, 0.0, 0.0, 0.0], translation: [0; 3] };

/// Adaptive models of every kind of number.
#[derive(Debug, Clone, Default)]
struct ViewSectionModels {
    small: NumberModel,
    successor: [BitModel; 2],
    lengths: [NumberModel; 3],
    letters: Vec<BitModel>,
    new_camera: BitModel,
    camera_index: NumberModel,
    sizes: [NumberModel; 2],
    square: BitModel,
    same_pose: [BitModel; 2],
    extrapolated: [BitModel; 2],
    rotation: [NumberModel; 4],
    translation: [NumberModel; 3],
    lit: BitModel,
    light: [NumberModel; 3],
    new_intensity: BitModel,
    intensity_index: NumberModel,
}

impl ViewSectionModels {
    fn new() -> Self {
        ViewSectionModels { letters: vec![BitModel::default(); 256], ..ViewSectionModels::default() }
    }
    fn letter<C: BitCoder>(&mut self, coder: &mut C, value: u8) -> u8 {
        let mut node = 1usize;
        for k in (0..8).rev() {
            node = node << 1 | self.letters[node].code(coder, value >> k & 1 == 1) as usize;
        }
        node as u8
    }
}

fn code_float<C: BitCoder>(coder: &mut C, value: f64) -> f64 {
    f32::from_bits(code_raw(coder, 32, (value as f32).to_bits())) as f64
}

/// `2^-exponent`, exactly.
fn lattice_step(exponent: i32) -> f64 {
    f64::from_bits(((1023 - exponent as i64) as u64) << 52)
}

fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn conjugate(q: [f64; 4]) -> [f64; 4] {
    [q[0], -q[1], -q[2], -q[3]]
}

/// `None` for lengths below one half: no coded rotation has them.
fn normalised(q: [f64; 4]) -> Option<[f64; 4]> {
    let square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    let length = square.sqrt();
    (length >= 0.5).then(|| q.map(|component| component / length))
}

/// Rows of the rotation matrix.
fn matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// The rotation that differs from the second last pose twice as much as the last one.
fn extrapolated_rotation(last: [f64; 4], before: [f64; 4]) -> [f64; 4] {
    multiply(multiply(last, conjugate(before)), last)
}

fn extrapolated_translation(last: [i64; 3], before: [i64; 3]) -> [i64; 3] {
    std::array::from_fn(|k| 2 * last[k] - before[k])
}

/// The rotation `difference` (lattice units, 1 taken off the first) away from the predicted one.
fn rotation_from(predicted: [f64; 4], difference: [i64; 4], exponent: i32) -> Option<[f64; 4]> {
    let unit = lattice_step(exponent);
    let one = 1i64 << exponent;
    let small = [difference[0] + one, difference[1], difference[2], difference[3]].map(|part| part as f64 * unit);
    normalised(multiply(predicted, normalised(small)?))
}

fn camera_from(intrinsics: &Camera, pose: &LatticePose, header: &ViewHeader) -> Camera {
    let unit = lattice_step(header.length_exponent);
    Camera {
        rotation: matrix(pose.rotation),
        translation: pose.translation.map(|part| part as f64 * unit),
        ..*intrinsics
    }
}

fn light_from(lattice: [i64; 3], camera: &Camera, header: &ViewHeader) -> [f64; 3] {
    let unit = lattice_step(header.length_exponent);
    let place = lattice.map(|part| part as f64 * unit);
    if !header.lights_follow_camera {
        return place;
    }
    let (r, t) = (&camera.rotation, &camera.translation);
    let q = [place[0] - t[0], place[1] - t[1], place[2] - t[2]];
    std::array::from_fn(|i| r[0][i] * q[0] + r[1][i] * q[1] + r[2][i] * q[2])
}

/// The name with its last number one higher, as wide as before; `None` for names without a digit.
fn successor(name: &[u8]) -> Option<Vec<u8>> {
    let end = name.iter().rposition(u8::is_ascii_digit)? + 1;
    let mut next = name.to_vec();
    for at in (0..end).rev() {
        match name[at] {
            b'9' => next[at] = b'0',
            b'0'..=b'8' => {
                next[at] += 1;
                return Some(next);
            }
            _ => {
                next.insert(at + 1, b'1');
                return Some(next);
            }
        }
    }
    next.insert(0, b'1');
    Some(next)
}

/// Decodes the section. Memory and counts are bounded by `budget` and its limits.
/// # Errors
/// [`Error::Format`] if it is damaged, [`Error::Unsupported`] for later versions, [`Error::Limits`] if it claims too much.
pub fn decode(bytes: &[u8], budget: &Budget) -> Result<ViewsSection> {
    let Some((&version, stream)) = bytes.split_first() else {
        return Err(Error::format(Tag::VIEWS, 0u8, "empty"));
    };
    if version != VERSION {
        return Err(Error::Unsupported(format!("section VIEW of version {version}, this build reads {VERSION}")));
    }
    let mut reader = ViewReader { coder: RangeDecoder::new(stream), models: ViewSectionModels::new(), budget };
    let section = reader.section()?;
    if !code_end(&mut reader.coder) || !reader.coder.ends_as_written(0) {
        return Err(wrong("bytes do not end with the last view"));
    }
    Ok(section)
}

fn wrong(message: &str) -> Error {
    Error::format(Tag::VIEWS, 1u8, message)
}

struct ViewReader<'a> {
    coder: RangeDecoder<'a>,
    models: ViewSectionModels,
    budget: &'a Budget,
}

impl ViewReader<'_> {
    fn section(&mut self) -> Result<ViewsSection> {
        let white = [0; 3].map(|_| code_float(&mut self.coder, 0.0));
        if !white.iter().all(|w| w.is_finite() && *w > 0.0) {
            return Err(wrong("white must be finite and above 0"));
        }
        let mut components = Vec::new();
        for _ in 0..self.small(3, "number of components")? {
            let component = match self.small(2, "component")? {
                0 => Component::Diffuse,
                1 => Component::Specular,
                _ => Component::Combined,
            };
            if components.contains(&component) {
                return Err(wrong("a component comes twice"));
            }
            components.push(component);
        }
        let count = self.models.small.code(&mut self.coder, 0);
        check("views", count as u64, self.budget.limits().views as u64)?;
        let header = self.header()?;
        self.budget.charge_items("views", count as u64, size_of::<View>() + 2 * size_of::<Camera>())?;

        let mut views: Vec<View> = Vec::new();
        let mut cameras: Vec<Camera> = Vec::new();
        let mut poses: [Option<LatticePose>; 2] = [None; 2];
        let mut lights: Vec<[i64; 3]> = Vec::new();
        let mut intensities: Vec<[f64; 3]> = Vec::new();
        let (mut was_successor, mut was_same) = (false, false);
        for _ in 0..count {
            let last_name = views.last().map_or(&b""[..], |view| view.name.as_bytes());
            let name = name(&mut self.coder, &mut self.models, last_name, &mut was_successor)?;
            self.budget.charge("names of views", name.len() as u64)?;
            let intrinsics = self.intrinsics(&mut cameras)?;
            let pose = self.pose(&mut poses, &mut was_same, &header)?;
            let camera = camera_from(&intrinsics, &pose, &header);
            let light = match self.models.lit.code(&mut self.coder, false) {
                true => Some(self.light(&camera, &mut lights, &mut intensities, &header)?),
                false => None,
            };
            views.push(View { name, camera, light });
        }
        Ok(ViewsSection { white, components, views })
    }

    fn header(&mut self) -> Result<ViewHeader> {
        let rotation_exponent = self.models.small.code_signed(&mut self.coder, 0);
        let length_exponent = self.models.small.code_signed(&mut self.coder, 0);
        if !ROTATION_EXPONENTS.contains(&rotation_exponent) || !LENGTH_EXPONENTS.contains(&length_exponent) {
            return Err(wrong("lattice exponents out of range"));
        }
        let lights_follow_camera = self.small(1, "frame of the lights")? == 1;
        let light_lag = self.small(255, "lag of the lights")? as usize + 1;
        Ok(ViewHeader { rotation_exponent, length_exponent, lights_follow_camera, light_lag })
    }

    fn small(&mut self, largest: u32, what: &str) -> Result<u32> {
        let value = self.models.small.code(&mut self.coder, 0);
        if value > largest { Err(wrong(&format!("{what}: {value}, at most {largest}"))) } else { Ok(value) }
    }

    fn lattice<const N: usize>(&mut self, kind: impl Fn(&mut ViewSectionModels) -> &mut [NumberModel; N]) -> [i64; N] {
        let mut values = [0; N];
        for (value, number) in values.iter_mut().zip(kind(&mut self.models)) {
            *value = number.code_signed(&mut self.coder, 0) as i64;
        }
        values
    }

    fn intrinsics(&mut self, known: &mut Vec<Camera>) -> Result<Camera> {
        if !self.models.new_camera.code(&mut self.coder, false) {
            let back = self.models.camera_index.code(&mut self.coder, 0) as usize;
            let found = known.len().checked_sub(back.saturating_add(1)).and_then(|at| known.get(at));
            return found.copied().ok_or_else(|| wrong("intrinsics that did not come before"));
        }
        let [width, height] = [0, 1].map(|k| self.models.sizes[k].code(&mut self.coder, 0));
        let side = self.budget.limits().image_side as u64;
        check("width of an image", width as u64, side)?;
        check("height of an image", height as u64, side)?;
        let square = self.models.square.code(&mut self.coder, false);
        let fx = code_float(&mut self.coder, 0.0);
        let fy = if square { fx } else { code_float(&mut self.coder, 0.0) };
        let principal = [0; 2].map(|_| code_float(&mut self.coder, 0.0));
        let finite = principal.iter().all(|x| x.is_finite()) && [fx, fy].iter().all(|f| f.is_finite() && *f > 0.0);
        if width == 0 || height == 0 || !finite {
            return Err(wrong("camera without pixels, or focal lengths not above 0, or not finite"));
        }
        let camera = Camera { width, height, focal: [fx, fy], principal, ..Camera::default() };
        known.push(camera);
        Ok(camera)
    }

    fn pose(
        &mut self,
        poses: &mut [Option<LatticePose>; 2],
        was_same: &mut bool,
        header: &ViewHeader,
    ) -> Result<LatticePose> {
        let [last, before] = *poses;
        if let Some(last) = last {
            *was_same = self.models.same_pose[*was_same as usize].code(&mut self.coder, false);
            if *was_same {
                return Ok(last);
            }
        }
        let mut predicted = last.unwrap_or(IDENTITY_POSE);
        if let (Some(last), Some(before)) = (last, before) {
            if self.models.extrapolated[0].code(&mut self.coder, false) {
                predicted.rotation = extrapolated_rotation(last.rotation, before.rotation);
            }
            if self.models.extrapolated[1].code(&mut self.coder, false) {
                predicted.translation = extrapolated_translation(last.translation, before.translation);
            }
        }
        let turn = self.lattice(|models| &mut models.rotation);
        let shift = self.lattice(|models| &mut models.translation);
        let rotation = rotation_from(predicted.rotation, turn, header.rotation_exponent);
        let pose = LatticePose {
            rotation: rotation.ok_or_else(|| wrong("rotation of length 0"))?,
            translation: lattice_sum(predicted.translation, shift)?,
        };
        *poses = [Some(pose), last];
        Ok(pose)
    }

    fn light(
        &mut self,
        camera: &Camera,
        lights: &mut Vec<[i64; 3]>,
        intensities: &mut Vec<[f64; 3]>,
        header: &ViewHeader,
    ) -> Result<PointLight> {
        let predicted = predicted_light(lights, header.light_lag);
        let shift = self.lattice(|models| &mut models.light);
        let lattice = lattice_sum(predicted, shift)?;
        lights.push(lattice);
        if self.models.new_intensity.code(&mut self.coder, false) {
            let intensity = [0; 3].map(|_| code_float(&mut self.coder, 0.0));
            if !intensity.iter().all(|x| x.is_finite()) {
                return Err(wrong("light intensity must be finite"));
            }
            intensities.push(intensity);
        }
        // Counted from the latest.
        let back = self.models.intensity_index.code(&mut self.coder, 0) as usize;
        let found = intensities.len().checked_sub(back.saturating_add(1)).and_then(|at| intensities.get(at));
        let intensity = *found.ok_or_else(|| wrong("light intensity that did not come before"))?;
        Ok(PointLight { position: light_from(lattice, camera, header), intensity })
    }
}

fn predicted_light(lights: &[[i64; 3]], lag: usize) -> [i64; 3] {
    lights.len().checked_sub(lag).map(|at| lights[at]).or(lights.last().copied()).unwrap_or([0; 3])
}

fn lattice_sum(a: [i64; 3], b: [i64; 3]) -> Result<[i64; 3]> {
    let sum: [i64; 3] = std::array::from_fn(|k| a[k] + b[k]);
    if sum.iter().all(|part| part.abs() <= MAX_COORDINATE) {
        Ok(sum)
    } else {
        Err(wrong("lattice coordinate beyond 2^30"))
    }
}

fn name(
    coder: &mut RangeDecoder,
    models: &mut ViewSectionModels,
    last: &[u8],
    was_successor: &mut bool,
) -> Result<String> {
    let mut name = None;
    if let Some(next) = successor(last) {
        *was_successor = models.successor[*was_successor as usize].code(coder, false);
        name = was_successor.then_some(next);
    }
    let name = match name {
        Some(name) => name,
        None => {
            let [prefix, suffix, middle] = [0, 1, 2].map(|k| models.lengths[k].code(coder, 0) as usize);
            let (Some(head), Some(tail)) = (last.get(..prefix), last.len().checked_sub(suffix)) else {
                return Err(wrong("name shares more letters with the last one than that has"));
            };
            if tail < prefix || middle > MAX_NAME_BYTES {
                return Err(wrong("name shares letters twice or is too long"));
            }
            let mut name = head.to_vec();
            name.extend((0..middle).map(|_| models.letter(coder, 0)));
            name.extend_from_slice(&last[tail..]);
            name
        }
    };
    if name.len() > MAX_NAME_BYTES {
        return Err(wrong("name longer than 1024 bytes"));
    }
    String::from_utf8(name).map_err(|_| wrong("name is not UTF-8"))
}

#[cfg(test)]
mod tests;
