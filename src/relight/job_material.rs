//! Materials of a job: a model by its name, and the parameters that it takes. One that it does not take is an error.

use super::material::{Material, SpecularPart};
use crate::brdf::models::{ClassicalLobe, ClassicalModel};
use crate::brdf::{Brdf, FittedMaterial, Microfacets, materials};
use crate::container::{Container, Tag};
use crate::error::{Error, Result};
use crate::input::{Folder, quoted};
use crate::limits::Limits;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The models and the parameters that each takes beside its name.
const MODELS: [(&str, &[&str]); 10] = [
    ("lambert", &["diffuse"]),
    ("blinn-phong", &["diffuse", "specular", "exponent"]),
    ("cook-torrance", &["diffuse", "specular", "roughness", "reflectance", "distribution"]),
    ("ward", &["diffuse", "specular", "roughness"]),
    ("ashikhmin-shirley", &["diffuse", "specular", "exponent", "reflectance"]),
    ("lafortune", &["diffuse", "specular", "exponent", "coefficients"]),
    ("torrance-sparrow", &["diffuse", "specular", "roughness"]),
    ("metallic-roughness", &["base_colour", "metallic", "roughness", "specular_colour"]),
    ("dsbrdf", &["file", "name", "diffuse", "specular"]),
    ("fitted", &["file", "name", "diffuse", "specular"]),
];

/// A number, or an image that drives it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "a value is a number, as many as the parameter has, or {\"texture\": FILE, \"scale\": FACTOR}"
)]
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

impl<T> JobParameter<T> {
    /// Whether an image drives it.
    pub fn is_texture(&self) -> bool {
        matches!(self, JobParameter::Texture { .. })
    }
}

fn one() -> f64 {
    1.0
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
#[serde(try_from = "WrittenMaterial")]
pub struct JobMaterial {
    /// `lambert`, `blinn-phong`, `cook-torrance`, `ward`, `ashikhmin-shirley`, `lafortune`, `torrance-sparrow` or `metallic-roughness`
    /// (glTF's); `dsbrdf` (lobes of section `mATl`, or fitted to what it has) or `fitted` (any form of it) of `file`.
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
    /// Slope: one number, or for `ward` also two (along and across); `sigma` of `torrance-sparrow`; of `metallic-roughness` the square root
    /// of the distribution's width, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<JobParameter<JobPair>>,
    /// Exponent: one number, or for `ashikhmin-shirley` also two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<JobParameter<JobPair>>,
    /// `cx = cy` and `cz` of `lafortune`, up to a common factor [default: -1 and 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coefficients: Option<[f64; 2]>,
    /// `beckmann` (the default) or `ggx`, for `cook-torrance`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distribution: Option<String>,
    /// Colour of `metallic-roughness`, 0 to 1 [default: 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_colour: Option<JobColour>,
    /// Metalness of `metallic-roughness`, 0 to 1 [default: 0].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metallic: Option<f64>,
    /// Colour of the dielectric's reflection of `metallic-roughness` in units of 0.04 [default: 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub specular_colour: Option<JobColour>,
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

/// A material as a job has it, with parameters that no model takes.
#[derive(Deserialize)]
struct WrittenMaterial {
    model: String,
    file: Option<PathBuf>,
    name: Option<String>,
    diffuse: Option<JobParameter<JobColour>>,
    specular: Option<JobParameter<JobColour>>,
    reflectance: Option<f64>,
    roughness: Option<JobParameter<JobPair>>,
    exponent: Option<JobParameter<JobPair>>,
    coefficients: Option<[f64; 2]>,
    distribution: Option<String>,
    base_colour: Option<JobColour>,
    metallic: Option<f64>,
    specular_colour: Option<JobColour>,
    #[serde(flatten)]
    unknown: BTreeMap<String, serde::de::IgnoredAny>,
}

impl TryFrom<WrittenMaterial> for JobMaterial {
    type Error = Error;

    fn try_from(written: WrittenMaterial) -> Result<Self> {
        let WrittenMaterial { model, file, name, diffuse, specular, reflectance, roughness, exponent, .. } = written;
        let WrittenMaterial { coefficients, distribution, base_colour, metallic, specular_colour, unknown, .. } =
            written;
        let material = JobMaterial {
            model,
            file,
            name,
            diffuse,
            specular,
            reflectance,
            roughness,
            exponent,
            coefficients,
            distribution,
            base_colour,
            metallic,
            specular_colour,
        };
        if let Some(key) = unknown.keys().next() {
            return Err(material.not_taken(key));
        }
        material.check()?;
        Ok(material)
    }
}

impl JobMaterial {
    /// Parameters of its model; `None` for an unknown one.
    fn parameters(&self) -> Option<&'static [&'static str]> {
        MODELS.iter().find(|(model, _)| *model == self.model).map(|(_, parameters)| *parameters)
    }

    fn not_taken(&self, parameter: &str) -> Error {
        let takes = match self.parameters() {
            Some(parameters) => format!("; it takes {}", parameters.join(", ")),
            None => String::new(),
        };
        Error::parameter(format!("material: {} takes no {}{takes}", quoted(&self.model), quoted(parameter)))
    }

    /// Checks that the model takes every parameter that is there, and as many numbers. Unknown models pass.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] with what the model takes.
    pub fn check(&self) -> Result<()> {
        let Some(parameters) = self.parameters() else { return Ok(()) };
        let given = [
            ("file", self.file.is_some()),
            ("name", self.name.is_some()),
            ("diffuse", self.diffuse.is_some()),
            ("specular", self.specular.is_some()),
            ("reflectance", self.reflectance.is_some()),
            ("roughness", self.roughness.is_some()),
            ("exponent", self.exponent.is_some()),
            ("coefficients", self.coefficients.is_some()),
            ("distribution", self.distribution.is_some()),
            ("base_colour", self.base_colour.is_some()),
            ("metallic", self.metallic.is_some()),
            ("specular_colour", self.specular_colour.is_some()),
        ];
        if let Some((name, _)) = given.iter().find(|(name, given)| *given && !parameters.contains(name)) {
            return Err(self.not_taken(name));
        }
        let is_two = |parameter: &Option<JobParameter<JobPair>>| {
            matches!(parameter, Some(JobParameter::Constant(JobPair::Two(_))))
        };
        for (name, parameter, model) in
            [("roughness", &self.roughness, "ward"), ("exponent", &self.exponent, "ashikhmin-shirley")]
        {
            if is_two(parameter) && self.model != model {
                let message = format!("material: {} takes one {name}, not two ({model} does)", quoted(&self.model));
                return Err(Error::parameter(message));
            }
        }
        let textured = [&self.diffuse, &self.specular].into_iter().flatten().any(JobParameter::is_texture);
        if textured && parameters.contains(&"file") {
            return Err(Error::parameter(format!("material: {} takes factors, not textures", self.model)));
        }
        if self.has_varying_lobe() && parameters.contains(&"metallic") {
            return Err(Error::parameter(format!("material: {} takes numbers, not textures", self.model)));
        }
        Ok(())
    }

    /// Whether an image drives the lobe's shape: its roughness or its exponent.
    pub fn has_varying_lobe(&self) -> bool {
        [&self.roughness, &self.exponent].into_iter().flatten().any(JobParameter::is_texture)
    }

    /// The specular part without its factor, with `varying` in place of the roughness or exponent that an image drives; `None` for `lambert`.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if a parameter that the model needs is missing, or one is there that it does not take, [`Error::Unsupported`] for
    /// an unknown model or distribution.
    pub fn specular_part(&self, varying: Option<f64>) -> Result<Option<Box<dyn Brdf + Send>>> {
        Ok(match self.lobe(varying)? {
            ClassicalLobe::Lambert => None,
            lobe => Some(Box::new(ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe })),
        })
    }

    /// The model's lobe, as [`Self::specular_part`].
    fn lobe(&self, varying: Option<f64>) -> Result<ClassicalLobe> {
        self.check()?;
        let asked = |what: &str| Error::parameter(format!("material: {} needs {what}", self.model));
        let values = |parameter: &Option<JobParameter<JobPair>>, name: &str| match parameter {
            Some(JobParameter::Constant(pair)) => Ok(pair.values()),
            Some(JobParameter::Texture { .. }) => varying.map(|value| [value; 2]).ok_or_else(|| asked(name)),
            None => Err(asked(name)),
        };
        let rough = || {
            let pair = values(&self.roughness, "roughness")?;
            let fits = pair.iter().all(|r| (0.001..=2.0).contains(r));
            if fits { Ok(pair) } else { Err(asked("a roughness of 0.001 to 2")) }
        };
        let exponents = || values(&self.exponent, "exponent");
        let reflectance = self.reflectance.unwrap_or(1.0);
        let lobe = match self.model.as_str() {
            "lambert" => ClassicalLobe::Lambert,
            "blinn-phong" => ClassicalLobe::BlinnPhong { exponent: exponents()?[0] },
            "cook-torrance" => match self.distribution.as_deref() {
                None | Some("beckmann") => ClassicalLobe::CookTorranceBeckmann { roughness: rough()?[0], reflectance },
                Some("ggx") => ClassicalLobe::CookTorranceGgx { roughness: rough()?[0], reflectance },
                Some(other) => {
                    return Err(Error::Unsupported(format!("distribution {}; known: beckmann, ggx", quoted(other))));
                }
            },
            "ward" => ClassicalLobe::WardAnisotropic { roughness: rough()? },
            "ashikhmin-shirley" => ClassicalLobe::AshikhminShirley { exponents: exponents()?, reflectance },
            "lafortune" => {
                let [xy, z] = self.coefficients.unwrap_or([-1.0, 1.0]);
                ClassicalLobe::Lafortune { xy, z, exponent: exponents()?[0] }
            }
            "torrance-sparrow" => ClassicalLobe::TorranceSparrow { sigma: rough()?[0] },
            "metallic-roughness" => {
                return Err(Error::parameter("material: metallic-roughness has no lobe apart from its diffuse part"));
            }
            other => {
                let known = MODELS.map(|(model, _)| model).join(", ");
                return Err(Error::Unsupported(format!("material model {}; known: {known}", quoted(other))));
            }
        };
        lobe.check()?;
        Ok(lobe)
    }

    /// Whether the model stands in a file of fitted materials.
    fn is_of_file(&self) -> bool {
        matches!(self.model.as_str(), "dsbrdf" | "fitted")
    }

    /// The parameters of `metallic-roughness`.
    fn microfacets(&self) -> Result<Microfacets> {
        self.check()?;
        let rgb = |colour: Option<JobColour>| colour.map_or([1.0; 3], JobColour::rgb);
        let Some(JobParameter::Constant(roughness)) = &self.roughness else {
            return Err(Error::parameter("material: metallic-roughness needs roughness"));
        };
        let material = Microfacets {
            base_colour: rgb(self.base_colour),
            metallic: self.metallic.unwrap_or(0.0),
            roughness: roughness.values()[0],
            specular_colour: rgb(self.specular_colour),
        };
        material.check().map_err(|error| Error::parameter(format!("material: {error}")))?;
        Ok(material)
    }

    /// The material as a file holds it, read from its own file in `folder` where the model needs one; and what its own file calls it.
    ///
    /// # Errors
    ///
    /// As [`Self::specular_part`], [`Error::Unsupported`] for textures and for factors of a fitted material.
    pub fn fitted(&self, folder: &Folder, limits: Limits) -> Result<(FittedMaterial, Option<String>)> {
        self.check()?;
        let textured = [&self.diffuse, &self.specular].into_iter().flatten().any(JobParameter::is_texture);
        if textured || self.has_varying_lobe() {
            let message = "material: a texture drives a parameter; a file's materials have numbers and colours only";
            return Err(Error::Unsupported(message.into()));
        }
        if self.is_of_file() {
            let factors = [&self.diffuse, &self.specular];
            let is_one = |factor: &&Option<JobParameter<JobColour>>| match factor {
                Some(JobParameter::Constant(colour)) => colour.rgb() == [1.0; 3],
                _ => true,
            };
            if !factors.iter().all(is_one) {
                let message =
                    format!("material: a file holds {} as it was fitted, without factors of its parts", self.model);
                return Err(Error::Unsupported(message));
            }
            let (name, material) = self.read(folder, limits)?;
            return Ok((material, Some(name)));
        }
        if self.model == "metallic-roughness" {
            return Ok((FittedMaterial::MetallicRoughness(self.microfacets()?), None));
        }
        let lobe = self.lobe(None)?;
        let specular = if lobe == ClassicalLobe::Lambert { [0.0; 3] } else { self.specular_factor() };
        let model = ClassicalModel { diffuse: self.albedo(), specular, lobe };
        model.check()?;
        Ok((FittedMaterial::Classical(model), None))
    }

    /// The fitted material of the model's file, and its name.
    fn read(&self, folder: &Folder, limits: Limits) -> Result<(String, FittedMaterial)> {
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
        let material = match self.model.as_str() {
            "dsbrdf" => FittedMaterial::Dsbrdf(found.material.to_dsbrdf()?),
            _ => found.material.clone(),
        };
        Ok((found.name.clone(), material))
    }

    /// The material, read from its file in `folder` where the model needs one.
    pub fn material(&self, folder: &Folder, limits: Limits) -> Result<Material> {
        if self.model == "metallic-roughness" {
            return Ok(Material::of_fitted(&FittedMaterial::MetallicRoughness(self.microfacets()?)));
        }
        if !self.is_of_file() {
            return self.uniform();
        }
        self.check()?;
        let factor = |parameter: &Option<JobParameter<JobColour>>| match parameter {
            Some(JobParameter::Constant(colour)) => colour.rgb(),
            _ => [1.0; 3],
        };
        let (diffuse, specular) = (factor(&self.diffuse), factor(&self.specular));
        let Material { albedo, specular: part, specular_scale } = Material::of_fitted(&self.read(folder, limits)?.1);
        let times = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| a[c] * b[c]);
        let (albedo, specular_scale) = (times(albedo, diffuse), times(specular_scale, specular));
        Ok(Material { albedo, specular: part, specular_scale })
    }

    /// Diffuse albedo; 1 where an image drives it.
    fn albedo(&self) -> [f64; 3] {
        colour(&self.diffuse, if self.model == "lambert" { 0.5 } else { 0.0 })
    }

    /// Factor of the specular part; 1 where an image drives it.
    fn specular_factor(&self) -> [f64; 3] {
        colour(&self.specular, 1.0)
    }

    /// The material, where nothing in it varies; factors that an image drives are taken as 1, and a lobe that one drives is left out.
    ///
    /// # Errors
    ///
    /// Those of [`Self::specular_part`].
    pub fn uniform(&self) -> Result<Material> {
        let part = if self.has_varying_lobe() { None } else { self.specular_part(None)? };
        Ok(Material {
            albedo: self.albedo(),
            specular: part.map(SpecularPart::new),
            specular_scale: self.specular_factor(),
        })
    }
}

/// A colour that may be driven by an image, which is 1 then, or not be there.
fn colour(parameter: &Option<JobParameter<JobColour>>, none: f64) -> [f64; 3] {
    match parameter {
        Some(JobParameter::Constant(colour)) => colour.rgb(),
        Some(JobParameter::Texture { .. }) => [1.0; 3],
        None => [none; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> std::result::Result<JobMaterial, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn what_a_model_does_not_take_is_an_error() {
        for (text, said) in [
            (
                r#"{"model": "blinn-phong", "exponent": 9, "roughness": {"texture": "r.png"}}"#,
                r#""blinn-phong" takes no "roughness"; it takes diffuse, specular, exponent"#,
            ),
            (r#"{"model": "lambert", "specular": 1}"#, r#""lambert" takes no "specular"; it takes diffuse"#),
            (
                r#"{"model": "ward", "roughness": 0.2, "shine": 1}"#,
                r#"takes no "shine"; it takes diffuse, specular, roughness"#,
            ),
            (r#"{"model": "ward", "roughness": 0.2, "file": "a"}"#, r#"takes no "file""#),
            (
                r#"{"model": "cook-torrance", "roughness": 0.2, "exponent": 3}"#,
                r#"takes no "exponent"; it takes diffuse, specular, roughness, reflectance, distribution"#,
            ),
            (r#"{"model": "fitted", "file": "a", "roughness": 1}"#, r#"takes no "roughness"; it takes file, name"#),
            (r#"{"model": "fitted", "file": "a", "diffuse": {"texture": "d.png"}}"#, "takes factors, not textures"),
            (
                r#"{"model": "blinn-phong", "exponent": [9, 10]}"#,
                "takes one exponent, not two (ashikhmin-shirley does)",
            ),
            (r#"{"model": "cook-torrance", "roughness": [0.1, 0.2]}"#, "takes one roughness, not two (ward does)"),
            (r#"{"model": "ward", "roughness": {"texture": "r.png", "scael": 2}}"#, "\"scale\": FACTOR"),
            (r#"{"model": "ward", "roughness": "rough"}"#, "a value is a number"),
            (r#"{"roughness": 1}"#, "missing field `model`"),
        ] {
            let found = read(text).unwrap_err();
            assert!(found.contains(said), "{text}: {found}");
        }
        // What was not read from a file is checked, too.
        let material = read(r#"{"model": "ward", "roughness": 0.2}"#).unwrap();
        let wrong = JobMaterial { reflectance: Some(0.1), ..material };
        assert!(wrong.specular_part(None).is_err() && wrong.uniform().is_err());
        // Names that steer a terminal are shown escaped.
        let found = read("{\"model\": \"ward\", \"a\\u001b[31m\": 1}").unwrap_err();
        assert!(!found.contains('\u{1b}') && found.contains("takes no"), "{found}");
    }

    #[test]
    fn an_image_drives_the_exponent() {
        let material =
            read(r#"{"model": "blinn-phong", "exponent": {"texture": "e.png", "scale": 100}, "specular": 0.5}"#)
                .unwrap();
        assert!(material.has_varying_lobe() && material.specular_part(None).is_err());
        let peak = |exponent: f64| {
            let part = material.specular_part(Some(exponent)).unwrap().unwrap();
            part.evaluate([0.0, 0.0, 1.0], [0.0, 0.0, 1.0])[0]
        };
        assert!((peak(98.0) / peak(8.0) - 10.0).abs() < 1e-9);
        let uniform = material.uniform().unwrap();
        // The lobe comes from the image; nothing else is made up in its place.
        assert!(uniform.specular.is_none() && uniform.albedo == [0.0; 3] && uniform.specular_scale == [0.5; 3]);
        let again: JobMaterial = serde_json::from_str(&serde_json::to_string(&material).unwrap()).unwrap();
        assert_eq!(again, material);
    }
}
