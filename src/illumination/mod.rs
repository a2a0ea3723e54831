//! Light of photographs whose capture does not state it, so that they have reflectance and the object can be relit.

mod evidence;
mod lamp;

use crate::error::{Error, Result};
use crate::options::CaptureLight;
use crate::views::View;
use serde::{Deserialize, Serialize};

pub(crate) use evidence::LightEvidence;

/// Light that the encoder took for that of the photographs, as the metadata's key `assumed_light` has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum AssumedLight {
    /// A lamp that stands still relative to the camera.
    Camera {
        /// From the camera to the lamp: to the right, upwards and backwards in the photograph, in world units.
        offset: [f64; 3],
        /// Radiant intensity, red, green, blue.
        intensity: [f64; 3],
        /// What of it was fitted: `offset`, `intensity`.
        fitted: Vec<String>,
    },
    /// A lamp that stands still relative to the object.
    Lamp {
        /// Place in the capture's coordinates.
        position: [f64; 3],
        /// Radiant intensity, red, green, blue.
        intensity: [f64; 3],
        /// What of it was fitted: `intensity`.
        fitted: Vec<String>,
    },
}

impl AssumedLight {
    /// Gives each view this light; `origin` was subtracted from the capture's coordinates.
    pub(crate) fn apply(&self, views: &mut [View], origin: [f64; 3]) {
        for view in views {
            let light = match self {
                AssumedLight::Camera { offset, intensity, .. } => lamp::beside(&view.camera, *offset, *intensity),
                AssumedLight::Lamp { position, intensity, .. } => lamp::within(*position, origin, *intensity),
            };
            view.light = Some(light);
        }
    }
}

/// Checks the numbers of a light.
/// # Errors
/// [`Error::Parameter`] for an intensity that is not positive, and for what is not finite.
pub(crate) fn check(light: &CaptureLight) -> Result<()> {
    let (place, intensity) = match light {
        CaptureLight::Camera { offset, intensity } => (offset.unwrap_or_default(), intensity),
        CaptureLight::Lamp { position, intensity } => (*position, intensity),
    };
    if !place.iter().all(|x| x.abs() < 1e15) {
        return Err(Error::parameter("option `light`: the lamp's place has a number that is not finite or too large"));
    }
    if let Some(intensity) = intensity
        && !intensity.iter().all(|&x| x > 0.0 && x < 1e30)
    {
        return Err(Error::parameter(format!("option `light`: an intensity is positive, this one is {intensity:?}")));
    }
    Ok(())
}

/// Finds what is not given of a light, and adds what the user should know to `warnings`. `stated` views had a light of the capture's own.
/// # Errors
/// Those of opening the photographs; [`Error::Parameter`] if no photograph shows the mesh.
pub(crate) fn assume(
    light: &CaptureLight,
    evidence: &LightEvidence,
    origin: [f64; 3],
    stated: usize,
    warnings: &mut Vec<String>,
) -> Result<AssumedLight> {
    if stated > 0 {
        warnings.push(format!("option `light` replaces the lights that the capture states of {stated} views"));
    }
    match *light {
        CaptureLight::Camera { offset, intensity } => lamp::of_camera(evidence, offset, intensity, warnings),
        CaptureLight::Lamp { position, intensity } => lamp::of_object(evidence, position, origin, intensity, warnings),
    }
}
