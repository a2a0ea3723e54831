//! Light of photographs whose capture does not state it, so that they have reflectance and the object can be relit.

mod environment;
mod evidence;
mod lamp;
mod transport;
mod vertex_radiance;

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::options::CaptureLight;
use crate::views::source::PhotographSource;
use crate::views::{Component, View};
use serde::{Deserialize, Serialize};

pub(crate) use environment::EnvironmentEstimate;
use evidence::LightEvidence;

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
    /// All that is around, standing still relative to the object.
    Environment {
        /// Mean radiance of all directions, red, green, blue.
        mean_radiance: [f64; 3],
        /// Share of the spread of the surface's brightness that goes with the light, 0 to 1; the rest is albedo.
        explained: f64,
        /// What of it was fitted: `environment`, `mean_radiance`.
        fitted: Vec<String>,
    },
}

impl AssumedLight {
    /// Gives each view this light, none where it is an environment; `origin` was subtracted from the capture's coordinates.
    pub(crate) fn apply(&self, views: &mut [View], origin: [f64; 3]) {
        for view in views {
            view.light = match self {
                AssumedLight::Camera { offset, intensity, .. } => Some(lamp::beside(&view.camera, *offset, *intensity)),
                AssumedLight::Lamp { position, intensity, .. } => Some(lamp::within(*position, origin, *intensity)),
                AssumedLight::Environment { .. } => None,
            };
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
        CaptureLight::Environment { mean_radiance } => ([0.0; 3], mean_radiance),
    };
    if !place.iter().all(|x| x.abs() < 1e15) {
        return Err(Error::parameter("option `light`: the lamp's place has a number that is not finite or too large"));
    }
    if let Some(intensity) = intensity
        && !intensity.iter().all(|&x| x > 0.0 && x < 1e30)
    {
        return Err(Error::parameter(format!(
            "option `light`: an intensity or mean radiance is positive, this one is {intensity:?}"
        )));
    }
    Ok(())
}

/// Photographs of a mesh by whose light is asked.
pub(crate) struct LightSources<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) views: &'a [View],
    pub(crate) components: &'a [Component],
    pub(crate) photographs: &'a dyn PhotographSource,
    /// What was subtracted from the capture's coordinates.
    pub(crate) origin: [f64; 3],
}

/// The component that highlights are not in, or else the combined one.
fn matte(components: &[Component]) -> usize {
    components.iter().position(|&component| component != Component::Specular).unwrap_or(0)
}

/// Finds what is not given of a light, and adds what the user should know to `warnings`.
/// # Errors
/// Those of opening the photographs; [`Error::Parameter`] if no photograph shows the mesh.
pub(crate) fn assume(
    light: &CaptureLight,
    sources: &LightSources,
    warnings: &mut Vec<String>,
) -> Result<(AssumedLight, Option<EnvironmentEstimate>)> {
    let LightSources { mesh, views, components, photographs, origin } = *sources;
    let stated = views.iter().filter(|view| view.light.is_some()).count();
    if stated > 0 {
        warnings.push(format!("option `light` replaces the lights that the capture states of {stated} views"));
    }
    let evidence = || LightEvidence::gather(mesh, views, components, photographs);
    let lamp = match *light {
        CaptureLight::Camera { offset, intensity } => lamp::of_camera(&evidence()?, offset, intensity, warnings)?,
        CaptureLight::Lamp { position, intensity } => {
            lamp::of_object(&evidence()?, position, origin, intensity, warnings)?
        }
        CaptureLight::Environment { mean_radiance } => {
            let found = environment::estimate(mesh, views, components, photographs, mean_radiance)?;
            warnings.push(format!(
                "the light is estimated from the photographs, and explains {:.0} % of the spread of the surface's brightness; the rest is \
                 taken for its colour",
                100.0 * found.explained
            ));
            let mut fitted = vec!["environment".to_owned()];
            if mean_radiance.is_none() {
                fitted.push("mean_radiance".into());
                warnings.push(format!(
                    "photographs tell neither the scale nor the colour of their light: it is taken to be white on the mean, and such that \
                     the object's brightest parts reflect {:.0} % of it; option `light` takes the measured mean radiance",
                    100.0 * lamp::BRIGHT_ALBEDO
                ));
            }
            let light = AssumedLight::Environment { mean_radiance: found.mean, explained: found.explained, fitted };
            return Ok((light, Some(found)));
        }
    };
    Ok((lamp, None))
}
