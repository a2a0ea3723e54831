//! An image asked for in one JSON file, so that another renderer can be asked for the same.

use super::job_material::JobMaterial;
use crate::error::{Error, Result};
use crate::views::Camera;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Rendering job. Paths are relative to the folder of the job's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The mesh: PLY, OBJ or GLB, or a `.tsuya` file, whose visibility (`tsuya bake`) is used. With `material`, in place of `asset`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PathBuf>,
    /// Material of the mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<JobMaterial>,
    /// A `.tsuya` file in place of mesh and material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asset: Option<PathBuf>,
    /// The light.
    pub environment: JobEnvironment,
    /// The camera.
    pub camera: JobCamera,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Whether the object shadows itself.
    #[serde(default = "yes")]
    pub shadows: bool,
    /// Method of summing the environment's light.
    #[serde(default)]
    pub evaluator: JobEvaluator,
    /// Samples of a pixel along each side [default: 2].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u32>,
}

fn yes() -> bool {
    true
}

/// Method of summing an environment's light; see [`super::EvaluatorKind`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JobEvaluator {
    /// Spherical Gaussians throughout, `sg`.
    #[serde(alias = "published")]
    Sg,
    /// Filtered importance sampling, `filtered`.
    #[default]
    #[serde(alias = "better")]
    Filtered,
    /// Brute force, `reference`.
    Reference,
}

/// An environment map and how it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobEnvironment {
    /// The image, or a `.tsuya` file with light.
    pub file: PathBuf,
    /// Factor of its radiance.
    #[serde(default = "one")]
    pub scale: f64,
    /// Turned about +Y by this angle.
    #[serde(default)]
    pub rotation_y_deg: f64,
}

fn one() -> f64 {
    1.0
}

/// A pinhole camera, square pixels, its axis in the middle of the image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobCamera {
    /// Position of the camera's centre.
    pub position: [f64; 3],
    /// Point in the middle of the image.
    pub target: [f64; 3],
    /// Upwards in the image.
    pub up: [f64; 3],
    /// Angle between the upper and the lower edge, degrees.
    pub fov_y_deg: f64,
}

impl Job {
    /// Returns the job's camera.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for numbers out of range or not finite.
    pub fn camera(&self) -> Result<Camera> {
        let JobCamera { position, target, up, fov_y_deg } = self.camera;
        let [width, height] = self.size;
        if !(fov_y_deg > 0.0 && fov_y_deg < 179.0) || width == 0 || height == 0 || width.max(height) > 16_384 {
            return Err(Error::parameter("a camera needs fov_y_deg between 0 and 179 and a size of 1 to 16384"));
        }
        let numbers = [position, target, up].concat();
        // Squares of larger ones overflow.
        if numbers.iter().any(|x| x.is_nan() || x.abs() > 1e100) || position == target {
            return Err(Error::parameter("a camera needs finite numbers and a target apart from its position"));
        }
        let focal = 0.5 * height as f64 / (0.5 * fov_y_deg.to_radians()).tan();
        if focal.is_infinite() {
            return Err(Error::parameter("a camera needs a field of view that is not as near to 0"));
        }
        Ok(super::look_at(position, target, up, focal, width, height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_read_as_it_was_written() {
        let text = r#"{"mesh": "a.obj", "material": {"model": "cook-torrance", "diffuse": 0.2, "specular": [1, 0.5, 0.2],
            "roughness": 0.3, "reflectance": 0.04}, "environment": {"file": "e.exr", "scale": 2, "rotation_y_deg": 30},
            "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y_deg": 90}, "size": [200, 100],
            "shadows": false, "evaluator": "sg"}"#;
        let job: Job = serde_json::from_str(text).unwrap();
        assert_eq!(job.evaluator, JobEvaluator::Sg);
        for (older, evaluator) in [("published", JobEvaluator::Sg), ("better", JobEvaluator::Filtered)] {
            let older: Job = serde_json::from_str(&text.replace("\"sg\"", &format!("{older:?}"))).unwrap();
            assert_eq!(older, Job { evaluator, ..job.clone() });
        }
        let camera = job.camera().unwrap();
        assert!((camera.focal[1] - 50.0).abs() < 1e-9);
        let material = job.material.as_ref().unwrap();
        assert_eq!(material.uniform().unwrap().specular_scale, [1.0, 0.5, 0.2]);
        let part = material.specular_part(None).unwrap().unwrap();
        let mirror = part.evaluate([0.0, 0.0, 1.0], [0.0, 0.0, 1.0])[0];
        assert!((mirror - 0.04 / (4.0 * std::f64::consts::PI * 0.09)).abs() < 1e-9, "{mirror}");
        let again: Job = serde_json::from_str(&serde_json::to_string(&job).unwrap()).unwrap();
        assert_eq!(again, job);
        assert!(serde_json::from_str::<Job>(&text.replace("scale", "gain")).is_err());
        let far = JobCamera { position: [1e200, 0.0, 0.0], target: [0.0, 1e200, 0.0], ..job.camera };
        let narrow = JobCamera { fov_y_deg: 1e-310, ..job.camera };
        for (camera, message) in [(far, "finite numbers"), (narrow, "not as near to 0")] {
            let error = Job { camera, ..job.clone() }.camera().unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        let unknown = JobMaterial { model: "velvet".into(), ..material.clone() };
        assert!(matches!(unknown.specular_part(None), Err(Error::Unsupported(_))));
    }
}
