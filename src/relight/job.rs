//! An image asked for in one JSON file, so that another renderer can be asked for the same.

use super::material::{Material, SpecularPart};
use super::models::{TorranceSparrow, split_constant_part};
use crate::brdf::models::{ClassicalLobe, ClassicalModel};
use crate::brdf::{Brdf, materials};
use crate::container::{Container, Tag};
use crate::error::{Error, Result};
use crate::input::Folder;
use crate::limits::Limits;
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

/// A number, or an image that drives it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum JobParameter<T> {
    /// One value for the whole surface.
    Constant(T),
    /// Values of an image at the mesh's texture coordinates, 0 to 1 (linear) times `scale`.
    Texture {
        /// The image.
        texture: PathBuf,
        /// Factor.
        #[serde(default = "one")]
        scale: f64,
    },
}

/// One number for all colours, or three.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum JobColour {
    /// All alike.
    Grey(f64),
    /// Red, green, blue.
    Rgb([f64; 3]),
}

impl JobColour {
    /// Red, green, blue.
    pub fn rgb(self) -> [f64; 3] {
        match self {
            JobColour::Grey(value) => [value; 3],
            JobColour::Rgb(rgb) => rgb,
        }
    }
}

/// A material by its model's name and parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobMaterial {
    /// `lambert`, `blinn-phong`, `cook-torrance`, `ward`, `ashikhmin-shirley`, `lafortune` or `torrance-sparrow`; `dsbrdf` (lobes of
    /// section `mATl`, or fitted to what it has) or `fitted` (any form of it) of `file`.
    pub model: String,
    /// A `.tsuya` file with fitted materials, for `dsbrdf` and `fitted`; `diffuse` and `specular` are factors of its two parts then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Which of its materials [default: the first].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Diffuse albedo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diffuse: Option<JobParameter<JobColour>>,
    /// Factor of the specular part; for models with a Fresnel term see `reflectance`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub specular: Option<JobParameter<JobColour>>,
    /// Reflectance at normal incidence, for `cook-torrance` and `ashikhmin-shirley` [default: 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reflectance: Option<f64>,
    /// Slope: one number, or for `ward` also two (along and across); `sigma` of `torrance-sparrow`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<JobParameter<JobPair>>,
    /// Exponent: one number, or for `ashikhmin-shirley` also two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<JobPair>,
    /// `cx = cy` and `cz` of `lafortune`, up to a common factor [default: -1 and 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coefficients: Option<[f64; 2]>,
    /// `beckmann` (the default) or `ggx`, for `cook-torrance`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distribution: Option<String>,
}

/// One number, or two: along the tangent and across.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum JobPair {
    /// Both alike.
    Both(f64),
    /// Along, across.
    Two([f64; 2]),
}

impl JobPair {
    /// Along, across.
    pub fn values(self) -> [f64; 2] {
        match self {
            JobPair::Both(value) => [value; 2],
            JobPair::Two(values) => values,
        }
    }
}

impl JobMaterial {
    /// The specular part without its factor, `roughness` in place of the job's where it varies; `None` for `lambert`.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if a parameter that the model needs is missing, [`Error::Unsupported`] for an unknown model or distribution.
    pub fn specular_part(&self, roughness: Option<f64>) -> Result<Option<Box<dyn Brdf + Send>>> {
        let constant = match &self.roughness {
            Some(JobParameter::Constant(pair)) => Some(pair.values()),
            _ => None,
        };
        let asked = |what: &str| Error::parameter(format!("material: {} needs {what}", self.model));
        let rough = || {
            let pair = roughness.map(|r| [r; 2]).or(constant).ok_or_else(|| asked("roughness"))?;
            let fits = pair.iter().all(|r| (0.001..=2.0).contains(r));
            if fits { Ok(pair) } else { Err(asked("a roughness of 0.001 to 2")) }
        };
        let exponents = || Ok::<_, Error>(self.exponent.ok_or_else(|| asked("exponent"))?.values());
        let reflectance = self.reflectance.unwrap_or(1.0);
        let lobe = match self.model.as_str() {
            "lambert" => return Ok(None),
            "blinn-phong" => ClassicalLobe::BlinnPhong { exponent: exponents()?[0] },
            "cook-torrance" => match self.distribution.as_deref() {
                None | Some("beckmann") => ClassicalLobe::CookTorranceBeckmann { roughness: rough()?[0], reflectance },
                Some("ggx") => ClassicalLobe::CookTorranceGgx { roughness: rough()?[0], reflectance },
                Some(other) => return Err(Error::Unsupported(format!("distribution {other}; known: beckmann, ggx"))),
            },
            "ward" => ClassicalLobe::WardAnisotropic { roughness: rough()? },
            "ashikhmin-shirley" => ClassicalLobe::AshikhminShirley { exponents: exponents()?, reflectance },
            "lafortune" => {
                let [xy, z] = self.coefficients.unwrap_or([-1.0, 1.0]);
                ClassicalLobe::Lafortune { xy, z, exponent: exponents()?[0] }
            }
            "torrance-sparrow" => return Ok(Some(Box::new(TorranceSparrow { sigma: rough()?[0] }))),
            other => {
                return Err(Error::Unsupported(format!(
                    "material model {other}; known: lambert, blinn-phong, cook-torrance, ward, ashikhmin-shirley, lafortune, \
                     torrance-sparrow, dsbrdf, fitted"
                )));
            }
        };
        lobe.check()?;
        Ok(Some(Box::new(ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe })))
    }

    /// The material, read from its file in `folder` where the model needs one.
    pub fn material(&self, folder: &Folder, limits: Limits) -> Result<Material> {
        if !matches!(self.model.as_str(), "dsbrdf" | "fitted") {
            return self.uniform();
        }
        let factor = |parameter: &Option<JobParameter<JobColour>>| match parameter {
            None => Ok([1.0; 3]),
            Some(JobParameter::Constant(colour)) => Ok(colour.rgb()),
            Some(JobParameter::Texture { .. }) => {
                Err(Error::parameter(format!("material: {} takes factors, not textures", self.model)))
            }
        };
        let (diffuse, specular_scale) = (factor(&self.diffuse)?, factor(&self.specular)?);
        let Some(file) = &self.file else {
            return Err(Error::parameter(format!("material: {} needs file", self.model)));
        };
        let path = folder.resolve_path(file)?;
        let mut container = Container::open_seek(crate::input::open(&path)?.0, limits)?;
        let section = container.read_section(Tag::MATERIALS)?;
        let materials = materials::decode_materials(&section, &container.budget())?;
        let known = || materials.iter().map(|m| m.name.as_str()).collect::<Vec<_>>().join(", ");
        let found = match &self.name {
            Some(name) => materials.iter().find(|m| m.name == *name),
            None => materials.first(),
        };
        let Some(found) = found else {
            let message = format!("no material '{}'; it has: {}", self.name.as_deref().unwrap_or(""), known());
            return Err(Error::input(&path, message));
        };
        let brdf: Box<dyn Brdf + Send> = match self.model.as_str() {
            "dsbrdf" => Box::new(found.material.to_dsbrdf()?),
            _ => Box::new(found.material.clone()),
        };
        let (albedo, rest) = split_constant_part(brdf);
        let albedo = std::array::from_fn(|c| albedo[c] * diffuse[c]);
        Ok(Material { albedo, specular: Some(SpecularPart::new(rest)), specular_scale })
    }

    /// The material, where nothing in it varies; what does is taken as 1.
    pub fn uniform(&self) -> Result<Material> {
        let colour = |parameter: &Option<JobParameter<JobColour>>, none: f64| match parameter {
            Some(JobParameter::Constant(colour)) => colour.rgb(),
            Some(JobParameter::Texture { .. }) => [1.0; 3],
            None => [none; 3],
        };
        let part = self.specular_part(None)?;
        let diffuse = if part.is_none() { 0.5 } else { 0.0 };
        Ok(Material {
            albedo: colour(&self.diffuse, diffuse),
            specular: part.map(SpecularPart::new),
            specular_scale: colour(&self.specular, 1.0),
        })
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
