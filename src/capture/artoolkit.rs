//! ARToolKit's camera calibration, `camera_para.dat`: big-endian, the size of the images as two integers of 32 bits, a matrix of 3 x 4 doubles, and
//! the factors of a distortion function, whose version the number of bytes tells.
//!
//! The matrix maps a ray to an *ideal* pixel `(u, v)`, the distortion function that to an observed one. With `x = (u - x0) s`, `y = (v - y0) s`,
//! `l = x^2 + y^2`:
//!
//! | version | bytes | factors | observed pixel |
//! |---|---|---|---|
//! | 1 | 136 | `x0 y0 f s` | `x0 + x d`, `y0 + y d`, `d = 1 - 1e-8 f l` |
//! | 2 | 144 | `x0 y0 s f g` | the same with `d = 1 - 1e-8 f l - 1e-13 g l^2` |
//! | 3 | 152 | `x0 y0 s a f g` | the same, `x d` times `a` |
//! | 4 | 176 | `k1 k2 p1 p2 fx fy x0 y0 s` | OpenCV's model of `x / fx`, `y / fy` |
//! | 5 | 240 | `k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 fx fy x0 y0 s` | the same with OpenCV's further coefficients |
//!
//! Pixel centres are at whole numbers; half a pixel is added to the principal point.

use super::Lens;
use crate::error::{Error, Result};
use crate::input::FileAccess;
use crate::optimise::levenberg_marquardt::minimise;
use crate::views::Camera;
use byteorder::{BigEndian, ByteOrder};
use std::path::Path;

/// Bytes of a file and factors of its distortion function, by version from 1.
const VERSIONS: [(usize, usize); 5] = [(136, 4), (144, 5), (152, 6), (176, 9), (240, 17)];
/// Bytes before the factors.
const FACTORS_AT: usize = 8 + 12 * 8;
/// Largest distance between the file's model and the one that stands for it, pixels: as good as none, and as far as is accepted.
const EXACT_PIXELS: f64 = 1e-6;
const MAX_FIT_PIXELS: f64 = 0.5;
/// Places along each side of the image where both models are compared.
const PLACES: usize = 24;

/// Whether bytes are no text but begin as such a file does: with the high bytes of a width.
pub(super) fn is_camera_para(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0, 0])
}

/// Reads a calibration of ARToolKit. A model that [`Lens`] can't represent exactly is fitted where that moves no pixel by more than half of one;
/// the remarks of `access` say by how much then.
pub(super) fn from_camera_para(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<(Camera, Lens)> {
    let model = ArToolKitCamera::parse(bytes).map_err(|message| Error::input(path, message))?;
    let places = model.places().map_err(|message| Error::input(path, message))?;
    let candidate = model.candidate();
    let off = model.largest_difference(&candidate, &places);
    if off <= EXACT_PIXELS {
        return Ok(candidate);
    }
    let fitted = model.fit(&candidate, &places);
    let off = model.largest_difference(&fitted, &places);
    if off.is_nan() || off > MAX_FIT_PIXELS {
        let message = format!(
            "its distortion (version {}) has no equal among the lens models here, the nearest is up to {off:.2} pixels off: calibrate as \
             OpenCV's YAML",
            model.version
        );
        return Err(Error::input(path, message));
    }
    let message = format!("the distortion (version {}) is fitted, at most {off:.3} pixels off", model.version);
    access.remark(path, message);
    Ok(fitted)
}

/// Content of such a file.
struct ArToolKitCamera {
    version: usize,
    size: [u32; 2],
    /// Focal lengths, skew and principal point of the ideal camera.
    focal: [f64; 2],
    skew: f64,
    principal: [f64; 2],
    /// Middle and scale of the distortion.
    middle: [f64; 2],
    scale: f64,
    distortion: ArToolKitDistortion,
}

enum ArToolKitDistortion {
    /// Versions 1 to 3: factors of `l` and `l^2`, and of `x`.
    Pixels { square: f64, fourth: f64, aspect: f64 },
    /// Versions 4 and 5.
    OpenCv { focal: [f64; 2], numerator: [f64; 3], denominator: [f64; 3], tangential: [f64; 2], prism: [f64; 4] },
}

impl ArToolKitDistortion {
    fn pixels(square: f64, fourth: f64, aspect: f64) -> Self {
        ArToolKitDistortion::Pixels { square: 1e-8 * square, fourth: 1e-13 * fourth, aspect }
    }
}

impl ArToolKitCamera {
    fn parse(bytes: &[u8]) -> std::result::Result<Self, String> {
        let Some(version) = VERSIONS.iter().position(|&(length, _)| length == bytes.len()) else {
            if let Some((length, _)) =
                VERSIONS.iter().find(|(length, _)| bytes.len().is_multiple_of(*length) && !bytes.is_empty())
            {
                let count = bytes.len() / length;
                return Err(format!("ARToolKit's parameters of {count} cameras; one file for one camera is read"));
            }
            let sizes = VERSIONS.map(|(length, _)| length.to_string()).join(", ");
            return Err(format!(
                "a binary file of {} bytes; ARToolKit's camera_para.dat has {sizes} (versions 1 to 5)",
                bytes.len()
            ));
        };
        let size = [0, 4].map(|at| BigEndian::read_u32(&bytes[at..]));
        if size.iter().any(|side| !(1..=65536).contains(side)) {
            return Err(format!("byte 0: an image size of {} x {}, not 1 to 65536 each", size[0], size[1]));
        }
        let mut numbers = Vec::new();
        for at in (8..bytes.len()).step_by(8) {
            let number = BigEndian::read_f64(&bytes[at..]);
            // Products of larger ones overflow.
            if number.is_nan() || number.abs() > 1e12 {
                return Err(format!("byte {at}: {number} is no number of a camera"));
            }
            numbers.push(number);
        }
        let (matrix, factors) = numbers.split_at((FACTORS_AT - 8) / 8);
        let &[fx, skew, cx, dx, zero, fy, cy, dy, a, b, c, d] = matrix else { return Err("no matrix".into()) };
        if [dx, dy] != [0.0; 2] {
            return Err("byte 32: the matrix has a fourth column, that of a camera beside another one".into());
        }
        if zero != 0.0 || [a, b, c, d] != [0.0, 0.0, 1.0, 0.0] {
            return Err("byte 8: the matrix is not fx skew cx 0, 0 fy cy 0, 0 0 1 0".into());
        }
        let (middle, scale, distortion) = match *factors {
            [x, y, f, s] => ([x, y], s, ArToolKitDistortion::pixels(f, 0.0, 1.0)),
            [x, y, s, f, g] => ([x, y], s, ArToolKitDistortion::pixels(f, g, 1.0)),
            [x, y, s, aspect, f, g] => ([x, y], s, ArToolKitDistortion::pixels(f, g, aspect)),
            [k1, k2, p1, p2, fx, fy, x, y, s] => {
                let (numerator, tangential, focal) = ([k1, k2, 0.0], [p1, p2], [fx, fy]);
                let (denominator, prism) = ([0.0; 3], [0.0; 4]);
                ([x, y], s, ArToolKitDistortion::OpenCv { focal, numerator, denominator, tangential, prism })
            }
            [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, fx, fy, x, y, s] => {
                let (numerator, denominator, tangential) = ([k1, k2, k3], [k4, k5, k6], [p1, p2]);
                let (prism, focal) = ([s1, s2, s3, s4], [fx, fy]);
                ([x, y], s, ArToolKitDistortion::OpenCv { focal, numerator, denominator, tangential, prism })
            }
            _ => return Err("no distortion".into()),
        };
        let lengths = match distortion {
            ArToolKitDistortion::Pixels { aspect, .. } => [aspect, 1.0],
            ArToolKitDistortion::OpenCv { focal, .. } => focal,
        };
        if [fx, fy, scale, lengths[0], lengths[1]].iter().any(|&x| x < 1e-6) {
            return Err("focal lengths and the distortion's scale must be above 0".into());
        }
        Ok(ArToolKitCamera {
            version: version + 1,
            size,
            focal: [fx, fy],
            skew,
            principal: [cx, cy],
            middle,
            scale,
            distortion,
        })
    }

    /// The observed pixel, centres at .5, of a ray that meets the plane one before the camera there.
    fn observed(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let ideal = [self.focal[0] * x + self.skew * y + self.principal[0], self.focal[1] * y + self.principal[1]];
        let [x, y] = [0, 1].map(|i| (ideal[i] - self.middle[i]) * self.scale);
        let offset = match &self.distortion {
            ArToolKitDistortion::Pixels { square, fourth, aspect } => {
                let l = x * x + y * y;
                let d = 1.0 - square * l - fourth * l * l;
                [x * d * aspect, y * d]
            }
            ArToolKitDistortion::OpenCv { focal, numerator: k, denominator: q, tangential: [p1, p2], prism } => {
                let (x, y) = (x / focal[0], y / focal[1]);
                let l = x * x + y * y;
                let d = (1.0 + l * (k[0] + l * (k[1] + l * k[2]))) / (1.0 + l * (q[0] + l * (q[1] + l * q[2])));
                let across = x * d + 2.0 * p1 * x * y + p2 * (l + 2.0 * x * x) + l * (prism[0] + l * prism[1]);
                let down = y * d + p1 * (l + 2.0 * y * y) + 2.0 * p2 * x * y + l * (prism[2] + l * prism[3]);
                [across * focal[0], down * focal[1]]
            }
        };
        [0, 1].map(|i| self.middle[i] + offset[i] + 0.5)
    }

    /// Rays and observed pixels all over the image; an error where no ray leads to one.
    fn places(&self) -> std::result::Result<Vec<([f64; 2], [f64; 2])>, String> {
        let mut places = Vec::with_capacity(PLACES * PLACES);
        for k in 0..PLACES * PLACES {
            let at = [k % PLACES, k / PLACES];
            let pixel: [f64; 2] =
                std::array::from_fn(|i| f64::from(self.size[i]) * (at[i] as f64 + 0.5) / PLACES as f64);
            let mut ray: [f64; 2] = std::array::from_fn(|i| (pixel[i] - self.principal[i]) / self.focal[i]);
            let mut miss = [f64::MAX; 2];
            for _ in 0..30 {
                let found = self.observed(ray);
                miss = std::array::from_fn(|i| pixel[i] - found[i]);
                if miss[0].hypot(miss[1]) < 1e-9 {
                    break;
                }
                let [u, v] = self.derivatives(ray);
                let determinant = u[0] * v[1] - v[0] * u[1];
                ray[0] += (v[1] * miss[0] - v[0] * miss[1]) / determinant;
                ray[1] += (u[0] * miss[1] - u[1] * miss[0]) / determinant;
            }
            let [u, v] = self.derivatives(ray);
            // Beyond where the polynomial turns back it means nothing.
            if !(miss[0].hypot(miss[1]) < 1e-6 && u[0] * v[1] - v[0] * u[1] > 0.0) {
                return Err(format!("its distortion folds the image back near pixel {:.0}, {:.0}", pixel[0], pixel[1]));
            }
            places.push((ray, pixel));
        }
        Ok(places)
    }

    /// Derivatives of the observed pixel by both coordinates of the ray.
    fn derivatives(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let h = 1e-6;
        let column = |dx: f64, dy: f64| {
            let (after, before) = (self.observed([x + dx, y + dy]), self.observed([x - dx, y - dy]));
            std::array::from_fn(|i| (after[i] - before[i]) / (2.0 * h))
        };
        [column(h, 0.0), column(0.0, h)]
    }

    /// The calibration that is the same where distortion and ideal camera have one middle and one shape of pixels, or where there is no distortion.
    fn candidate(&self) -> (Camera, Lens) {
        let (focal, lens) = match &self.distortion {
            ArToolKitDistortion::Pixels { square, fourth, aspect } => {
                let focal = [self.focal[0] * self.scale * aspect, self.focal[1] * self.scale];
                let length = self.focal[0] * self.focal[1] * self.scale * self.scale;
                let numerator = [-square * length, -fourth * length * length, 0.0, 0.0];
                (focal, Lens::Radial { numerator, denominator: [0.0; 3], tangential: [0.0; 2], shear: 0.0 })
            }
            ArToolKitDistortion::OpenCv { focal, numerator: k, denominator: q, tangential, .. } => {
                let a: [f64; 2] = std::array::from_fn(|i| self.focal[i] * self.scale / focal[i]);
                let (a, a2) = ((a[0] * a[1]).sqrt(), a[0] * a[1]);
                let powers = |k: &[f64; 3]| [k[0] * a2, k[1] * a2 * a2, k[2] * a2 * a2 * a2];
                let ([k1, k2, k3], denominator) = (powers(k), powers(q));
                let (numerator, tangential) = ([k1, k2, k3, 0.0], tangential.map(|p| p * a));
                let focal = self.focal.map(|f| f * self.scale);
                (focal, Lens::Radial { numerator, denominator, tangential, shear: 0.0 })
            }
        };
        let mut lens = lens;
        if let Lens::Radial { shear, .. } = &mut lens {
            *shear = self.skew / self.focal[0];
        }
        let lens = if lens.is_pinhole() { Lens::Pinhole } else { lens };
        // The ray along the axis is not bent, but for what is fitted then.
        let principal = self.observed([0.0; 2]);
        let [width, height] = self.size;
        (Camera { width, height, focal, principal, ..Camera::default() }, lens)
    }

    fn largest_difference(&self, (camera, lens): &(Camera, Lens), places: &[([f64; 2], [f64; 2])]) -> f64 {
        places.iter().fold(0.0, |largest: f64, (ray, pixel)| {
            let bent = lens.distort(*ray);
            let [dx, dy] = [0, 1].map(|i| camera.focal[i] * bent[i] + camera.principal[i] - pixel[i]);
            let distance = dx.hypot(dy);
            // A NaN stays.
            if distance.is_nan() { distance } else { largest.max(distance) }
        })
    }

    /// The [`Lens::Radial`] of least squared distance over the image, from a candidate.
    fn fit(&self, (camera, lens): &(Camera, Lens), places: &[([f64; 2], [f64; 2])]) -> (Camera, Lens) {
        let (numerator, denominator, tangential, shear) = match lens {
            &Lens::Radial { numerator, denominator, tangential, shear } => (numerator, denominator, tangential, shear),
            _ => ([0.0; 4], [0.0; 3], [0.0; 2], 0.0),
        };
        let with = |p: &[f64; 10]| {
            let lens = Lens::Radial {
                numerator: [p[4], p[5], p[6], numerator[3]],
                denominator,
                tangential: [p[7], p[8]],
                shear: p[9],
            };
            (Camera { focal: [p[0], p[1]], principal: [p[2], p[3]], ..*camera }, lens)
        };
        let ([fx, fy], [cx, cy]) = (camera.focal, camera.principal);
        let ([k1, k2, k3, _], [p1, p2]) = (numerator, tangential);
        let start = [fx, fy, cx, cy, k1, k2, k3, p1, p2, shear];
        let steps: [f64; 10] = std::array::from_fn(|i| if i < 4 { 1e-3 } else { 1e-6 });
        let bounds = [(f64::MIN, f64::MAX); 10];
        let best = minimise(start, &bounds, 60, |p, equations| {
            let moved = |i: usize, by: f64| with(&std::array::from_fn(|k| p[k] + if k == i { by } else { 0.0 }));
            let here = with(p);
            let around: [[(Camera, Lens); 2]; 10] = std::array::from_fn(|i| [moved(i, steps[i]), moved(i, -steps[i])]);
            let pixel = |(camera, lens): &(Camera, Lens), ray: [f64; 2], i: usize| {
                camera.focal[i] * lens.distort(ray)[i] + camera.principal[i]
            };
            for (ray, observed) in places {
                for i in 0..2 {
                    let derivatives = std::array::from_fn(|k| {
                        let [after, before] = &around[k];
                        (pixel(after, *ray, i) - pixel(before, *ray, i)) / (2.0 * steps[k])
                    });
                    equations.add(pixel(&here, *ray, i) - observed[i], &derivatives, 1.0);
                }
            }
        });
        with(&best.parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes of a file.
    fn file(size: [u32; 2], matrix: [f64; 12], factors: &[f64]) -> Vec<u8> {
        let numbers = matrix.iter().chain(factors).flat_map(|x| x.to_be_bytes());
        size.iter().flat_map(|side| side.to_be_bytes()).chain(numbers).collect()
    }

    fn matrix([fx, fy]: [f64; 2], [cx, cy]: [f64; 2], skew: f64) -> [f64; 12] {
        [fx, skew, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    }

    fn read(bytes: &[u8]) -> (Result<(Camera, Lens)>, Vec<String>) {
        let access = FileAccess::default();
        (from_camera_para(Path::new("camera_para.dat"), bytes, &access), access.remarks())
    }

    /// Largest distance between a file's own equations, written once more as ARToolKit's documentation has them, and what was read.
    fn difference(bytes: &[u8], observed: impl Fn(f64, f64) -> [f64; 2]) -> f64 {
        let (camera, lens) = read(bytes).0.unwrap();
        let mut largest = 0.0f64;
        for k in 0..441 {
            let ray = [((k % 21) as f64 - 10.0) * 0.04, ((k / 21) as f64 - 10.0) * 0.03];
            let bent = lens.distort(ray);
            let expected = observed(ray[0], ray[1]);
            let found = [0, 1].map(|i| camera.focal[i] * bent[i] + camera.principal[i] - 0.5 - expected[i]);
            largest = largest.max(found[0].hypot(found[1]));
        }
        largest
    }

    #[test]
    fn every_version_is_read() {
        // One middle and square pixels: exact.
        let ideal = matrix([700.0; 2], [320.0, 240.0], 0.0);
        for (factors, [f, g, s, a]) in [
            (vec![320.0, 240.0, 12.0, 0.98], [12.0, 0.0, 0.98, 1.0]),
            (vec![320.0, 240.0, 0.98, 12.0, -3.0], [12.0, -3.0, 0.98, 1.0]),
            (vec![320.0, 240.0, 0.98, 1.1, 12.0, -3.0], [12.0, -3.0, 0.98, 1.1]),
        ] {
            let bytes = file([640, 480], ideal, &factors);
            let off = difference(&bytes, |x, y| {
                let (x, y) = (700.0 * x * s, 700.0 * y * s);
                let l = x * x + y * y;
                let d = 1.0 - f / 1e8 * l - g / 1e13 * l * l;
                [320.0 + x * d * a, 240.0 + y * d]
            });
            assert!(off < 1e-9 && read(&bytes).1.is_empty(), "{factors:?}: {off}");
        }
        let (k, p, s) = ([-0.2, 0.05, 0.01, 0.02, 0.003, 0.001], [0.002, -0.001], 1.05);
        let ideal = matrix([600.0 / s, 610.0 / s], [318.0, 242.0], 0.0);
        let open_cv = |x: f64, y: f64, k: [f64; 6]| {
            let l = x * x + y * y;
            let d =
                (1.0 + k[0] * l + k[1] * l * l + k[2] * l.powi(3)) / (1.0 + k[3] * l + k[4] * l * l + k[5] * l.powi(3));
            let across = x * d + 2.0 * p[0] * x * y + p[1] * (l + 2.0 * x * x);
            let down = y * d + p[0] * (l + 2.0 * y * y) + 2.0 * p[1] * x * y;
            [318.0 + 600.0 * across, 242.0 + 610.0 * down]
        };
        let four = file([640, 480], ideal, &[k[0], k[1], p[0], p[1], 600.0, 610.0, 318.0, 242.0, s]);
        let off = difference(&four, |x, y| open_cv(x, y, [k[0], k[1], 0.0, 0.0, 0.0, 0.0]));
        assert!(off < 1e-9, "{off}");
        let factors =
            [k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5], 0.0, 0.0, 0.0, 0.0, 600.0, 610.0, 318.0, 242.0, s];
        let five = file([640, 480], ideal, &factors);
        let off = difference(&five, |x, y| open_cv(x, y, k));
        assert!(off < 1e-9 && read(&five).1.is_empty(), "{off}");
        // No distortion: any middle, and skew.
        let plain = file([640, 480], matrix([600.0, 500.0], [310.0, 250.0], 3.0), &[300.0, 200.0, 0.0, 1.0]);
        let off = difference(&plain, |x, y| [600.0 * x + 3.0 * y + 310.0, 500.0 * y + 250.0]);
        assert!(off < 1e-9, "{off}");
    }

    #[test]
    fn what_has_no_equal_is_fitted_with_its_error_stated() {
        // The camera that ARToolKit 2 came with: another middle of the distortion, other pixels.
        let ideal = matrix([700.9514702992245, 726.0941816535367], [316.5, 241.5], 0.0);
        let bytes = file([640, 480], ideal, &[318.5, 263.5, 26.2, 1.0127565206658486]);
        let off = difference(&bytes, |x, y| {
            let (x, y) = (700.9514702992245 * x + 316.5 - 318.5, 726.0941816535367 * y + 241.5 - 263.5);
            let (x, y) = (x * 1.0127565206658486, y * 1.0127565206658486);
            let d = 1.0 - 26.2e-8 * (x * x + y * y);
            [318.5 + x * d, 263.5 + y * d]
        });
        let (_, remarks) = read(&bytes);
        println!("ARToolKit 2's camera_para.dat: at most {off:.3} pixels off within the image; {remarks:?}");
        assert!(
            off < MAX_FIT_PIXELS && remarks.len() == 1 && remarks[0].contains("version 1) is fitted"),
            "{off} {remarks:?}"
        );
        let prism = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, -0.05, 0.0, 600.0, 600.0, 320.0, 240.0, 1.0];
        let said = read(&file([640, 480], matrix([600.0; 2], [320.0, 240.0], 0.0), &prism)).0.unwrap_err().to_string();
        assert!(said.contains("version 5) has no equal") && said.contains("pixels off"), "{said}");
    }

    #[test]
    fn damage_is_named() {
        let whole = file([640, 480], matrix([600.0; 2], [320.0, 240.0], 0.0), &[320.0, 240.0, 10.0, 1.0]);
        assert!(read(&whole).0.is_ok());
        let fault = |bytes: &[u8]| read(bytes).0.unwrap_err().to_string();
        for length in 0..whole.len() {
            assert!(fault(&whole[..length]).contains("136, 144, 152, 176, 240"), "{length}");
        }
        assert!(fault(&[&whole[..], &[0]].concat()).contains("137 bytes"));
        assert!(fault(&[whole.clone(), whole.clone()].concat()).contains("2 cameras"));
        let changed = |at: usize, bytes: &[u8]| {
            let mut file = whole.clone();
            file[at..at + bytes.len()].copy_from_slice(bytes);
            fault(&file)
        };
        assert!(changed(0, &[0; 4]).contains("0 x 480"));
        assert!(changed(8, &f64::NAN.to_be_bytes()).contains("byte 8: NaN"));
        assert!(changed(8, &(-600.0f64).to_be_bytes()).contains("above 0"));
        assert!(changed(32, &5f64.to_be_bytes()).contains("fourth column"));
        assert!(changed(88, &2f64.to_be_bytes()).contains("0 0 1 0"));
        assert!(changed(120, &1e6f64.to_be_bytes()).contains("folds"));
        assert!(changed(128, &0f64.to_be_bytes()).contains("above 0"));
    }
}
