//! Materials of the RGL database (`.bsdf`), isotropic, in red, green and blue.
//!
//! J. Dupuy, W. Jakob, "An adaptive parameterization for efficient material acquisition and rendering", ACM TOG 37(6), 2018. The BRDF is
//! tabulated over the unit square, which the distribution of visible normals, `vndf`, warps to half vectors: where the material
//! shines, samples are dense. `f cos(theta_o) = value(u) ndf(h) / (4 sigma(i))` with `u` the inverse of the warp at the half vector `h`.
//! Elevation is kept as `sqrt(2 theta / pi)`, azimuth as `phi / (2 pi) + 1/2`. Values below 0, noise of the measurement, are read as 0.

mod tensor;
mod warp;

use super::Brdf;
use crate::input::FileAccess;
use crate::{Error, Result};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};
use std::io::Read;
use std::path::Path;
use tensor::TensorFile;
use warp::MarginalWarp;

/// An isotropic file of red, green and blue has some 700 KB.
const MAX_FILE_BYTES: u64 = 16 << 20;
/// Doubles are made of single floats, and sums of them.
const MEMORY_PER_BYTE: u64 = 8;

/// A measured isotropic material in the adaptive parameterisation.
#[derive(Debug, Clone)]
pub struct RglMaterial {
    description: String,
    /// Increasing elevations of the incident light, radians.
    theta_i: Vec<f64>,
    /// Rows of azimuth, columns of elevation.
    ndf: MarginalWarp,
    sigma: MarginalWarp,
    /// One slice an elevation.
    vndf: MarginalWarp,
    /// Three slices an elevation.
    colour: MarginalWarp,
    /// `true` if `colour` is to be multiplied by `ndf / (4 sigma)`.
    jacobian: bool,
}

impl RglMaterial {
    /// Reads a file. The material stays charged; errors name the file.
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let path = path.as_ref();
        let bytes = access.read_bytes(path, ".bsdf file", MAX_FILE_BYTES)?;
        access.charge(path, ".bsdf file", MEMORY_PER_BYTE * bytes.len() as u64)?;
        Self::from_bytes(&bytes, path)
    }

    /// Reads a stream to its end; `path` is how errors call it.
    pub fn read_from(reader: impl Read, path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut bytes = Vec::new();
        reader.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            return Err(Error::Limits { what: ".bsdf file", requested: bytes.len() as u64, allowed: MAX_FILE_BYTES });
        }
        Self::from_bytes(&bytes, path)
    }

    /// A file's bytes; `path` is how errors call it.
    pub fn from_bytes(bytes: &[u8], path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let file = TensorFile::parse(bytes, path)?;
        let wrong = |message: String| Error::input(path, message);
        let phi_i = file.floats("phi_i", 1)?;
        if phi_i.values.len() > 2 {
            return Err(Error::Unsupported(format!(
                "{}: an anisotropic material ({} azimuths of light); isotropic ones can be read",
                path.display(),
                phi_i.values.len()
            )));
        }
        if !file.has("rgb") && file.has("spectra") {
            let message = "spectral measurements; take the file of the same material whose name ends with _rgb.bsdf";
            return Err(Error::Unsupported(format!("{}: {message}", path.display())));
        }
        let theta_i = file.floats("theta_i", 1)?.values;
        let increasing = theta_i.windows(2).all(|pair| pair[0] < pair[1]);
        let within = theta_i.iter().all(|theta| (-1e-6..=FRAC_PI_2 + 1e-6).contains(theta));
        if theta_i.is_empty() || !increasing || !within {
            return Err(wrong("field theta_i: elevations must increase within 0 and pi/2".into()));
        }
        let grid = |name: &str, leading: &[usize], normalised: bool| -> Result<MarginalWarp> {
            let field = file.floats(name, leading.len() + 2)?;
            if field.shape.get(..leading.len()) != Some(leading) {
                return Err(wrong(format!("field {name}: shape {:?}, {leading:?} expected first", field.shape)));
            }
            let least = field.values.iter().copied().fold(f64::INFINITY, f64::min);
            if normalised && least < 0.0 {
                return Err(wrong(format!("field {name}: a density is negative ({least})")));
            }
            let slices = leading.iter().product();
            let [.., rows, columns] = *field.shape.as_slice() else {
                return Err(wrong(format!("field {name}: no rows and columns")));
            };
            MarginalWarp::new(field.values, columns, rows, slices, normalised)
                .map_err(|what| wrong(format!("field {name}: {what}")))
        };
        let azimuths = phi_i.values.len();
        let elevations = theta_i.len();
        if azimuths != 1 {
            return Err(Error::Unsupported(format!("{}: {azimuths} azimuths of light, 1 expected", path.display())));
        }
        let jacobian = file.bytes("jacobian")?.first().is_some_and(|&flag| flag != 0);
        let description = file.bytes("description").map(|text| String::from_utf8_lossy(text).into_owned());
        let material = RglMaterial {
            description: description.unwrap_or_default(),
            ndf: grid("ndf", &[], false)?,
            sigma: grid("sigma", &[], false)?,
            vndf: grid("vndf", &[azimuths, elevations], true)?,
            colour: grid("rgb", &[azimuths, elevations, 3], false)?,
            theta_i,
            jacobian,
        };
        // Read for its check alone: it serves sampling, which nothing here does.
        grid("luminance", &[azimuths, elevations], false)?;
        if material.sigma.max_value() <= 0.0 || material.ndf.max_value() <= 0.0 {
            return Err(wrong("fields ndf and sigma: nothing but zeros".into()));
        }
        Ok(material)
    }

    /// Returns the file's description of the material.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// The slices of elevation about `theta`, and how far it is to the second.
    fn between(&self, theta: f64) -> ([usize; 2], f64) {
        let upper = self.theta_i.partition_point(|&t| t < theta).clamp(1, self.theta_i.len().max(2) - 1);
        let (Some(&low), Some(&high)) = (self.theta_i.get(upper - 1), self.theta_i.get(upper)) else {
            return ([0, 0], 0.0);
        };
        ([upper - 1, upper], ((theta - low) / (high - low)).clamp(0.0, 1.0))
    }
}

impl RglMaterial {
    /// The BRDF times the cosine of the second direction, as the file has it.
    fn with_cosine(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let sum: [f64; 3] = std::array::from_fn(|k| incoming[k] + outgoing[k]);
        let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
        let half = sum.map(|x| x / length.max(1e-300));
        let (theta_i, theta_h) = (elevation(incoming), elevation(half));
        let phi = (half[1].atan2(half[0]) - incoming[1].atan2(incoming[0])) / (2.0 * PI) + 0.5;
        let at_half = [(theta_h * FRAC_2_PI).sqrt(), phi - phi.floor()];
        let at_incoming = [(theta_i * FRAC_2_PI).sqrt(), 0.5];
        let ([lower, upper], part) = self.between(theta_i);
        let square = self.vndf.invert(at_half, [lower, upper], part);
        let scale = if self.jacobian {
            self.ndf.evaluate(at_half, [0, 0], 0.0) / (4.0 * self.sigma.evaluate(at_incoming, [0, 0], 0.0)).max(1e-300)
        } else {
            1.0
        };
        std::array::from_fn(|c| {
            let value = self.colour.evaluate(square, [3 * lower + c, 3 * upper + c], part) * scale;
            if value.is_finite() { value.max(0.0) } else { 0.0 }
        })
    }

    /// Returns the material made reciprocal: both orders of the directions averaged, each with the weight of its cosine, so that the
    /// order measured under less noise counts more. For tables that keep one value of both orders.
    pub fn reciprocal(&self) -> ReciprocalRgl<'_> {
        ReciprocalRgl(self)
    }
}

impl Brdf for RglMaterial {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        self.with_cosine(incoming, outgoing).map(|x| x / outgoing[2])
    }
}

/// See [`RglMaterial::reciprocal`].
#[derive(Debug, Clone, Copy)]
pub struct ReciprocalRgl<'a>(&'a RglMaterial);

impl Brdf for ReciprocalRgl<'_> {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        if incoming[2] <= 0.0 || outgoing[2] <= 0.0 {
            return [0.0; 3];
        }
        let (there, back) = (self.0.with_cosine(incoming, outgoing), self.0.with_cosine(outgoing, incoming));
        std::array::from_fn(|c| (there[c] + back[c]) / (incoming[2] + outgoing[2]))
    }
}

/// Angle to the normal, exact near it, too.
fn elevation(direction: [f64; 3]) -> f64 {
    direction[0].hypot(direction[1]).atan2(direction[2])
}

#[cfg(test)]
mod tests;
