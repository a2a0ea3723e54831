//! Fits of MERL materials that were published, as the collection `bsdfbenchmark` lists them: a line a material,
//! `NAME = Aggregate(Lambertian(albedo = [..]), MODEL(..))`.

use super::{ClassicalLobe, ClassicalModel, ShiftedGamma};
use crate::input::FileAccess;
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;

/// One material of a list.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedFit {
    /// The material, as MERL calls it.
    pub material: String,
    /// The fitted model.
    pub model: ClassicalModel,
}

/// Ngan, Durand, Matusik 2005 fitted the three colours with the scale of red: against tables with MERL's three scales, their green is
/// 1.15 and their blue 1.66 times too small.
const NGAN_SCALES: [f64; 3] = [1.0, 1.15, 1.66];
/// A list has some 100 lines of some 500 bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a list. Comments (`#`) and empty lines are skipped.
pub fn read_published(path: impl AsRef<Path>, access: &FileAccess) -> Result<Vec<PublishedFit>> {
    let path = path.as_ref();
    let text = access.read_text(path, "list of fits", MAX_BYTES)?;
    parse(&text, path)
}

/// The text of a list; `path` is how errors call it.
pub(crate) fn parse(text: &str, path: &Path) -> Result<Vec<PublishedFit>> {
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    lines
        .map(|(number, line)| {
            let wrong = |what: String| Error::input(path, format!("line {}: {what}", number + 1));
            let (name, fit) = line.split_once('=').ok_or_else(|| wrong("no '='".into()))?;
            let model = read_model(fit).map_err(wrong)?;
            model.check().map_err(|e| wrong(e.to_string()))?;
            Ok(PublishedFit { material: name.trim().to_owned(), model })
        })
        .collect()
}

fn read_model(text: &str) -> std::result::Result<ClassicalModel, String> {
    let (diffuse, rest) = text.split_once("),").ok_or("no second part after Lambertian(..)")?;
    let diffuse = colours(diffuse, "albedo")?;
    let rest = rest.trim_start();
    let (model, parameters) = rest.split_once('(').ok_or("no model")?;
    let specular = colours(parameters, "albedo")?;
    let scaled = |colour: [f64; 3], factor: f64| std::array::from_fn(|c| colour[c] * NGAN_SCALES[c] * factor);
    let (lobe, factor) = match model.trim() {
        "NganBlinnPhong" => (ClassicalLobe::BlinnPhong { exponent: number(parameters, "sharpness")? }, 1.0),
        "NganWard" => (ClassicalLobe::Ward { roughness: number(parameters, "roughness")? }, 1.0),
        "NganCookTorrance" => {
            let (roughness, reflectance) = (number(parameters, "roughness")?, number(parameters, "eta")?);
            // Theirs divides by pi where this one divides by 4.
            (ClassicalLobe::CookTorranceBeckmann { roughness, reflectance }, 4.0 / PI)
        }
        "NganAshikhminShirley" => {
            let exponents = [number(parameters, "sharpness")?; 2];
            (ClassicalLobe::AshikhminShirley { exponents, reflectance: number(parameters, "fresnelReflectance")? }, 1.0)
        }
        "NganLafortune" => {
            let (xy, z) = (number(parameters, "Cxy")?, number(parameters, "Cz")?);
            (ClassicalLobe::Lafortune { xy, z, exponent: number(parameters, "sharpness")? }, 1.0)
        }
        "Bagher" => {
            let fresnel = numbers(parameters, "eta")?;
            let list = |name: &str| colours(parameters, name);
            let half = |from: usize| -> std::result::Result<[f64; 3], String> {
                fresnel
                    .get(from..from + 3)
                    .and_then(|x| x.try_into().ok())
                    .ok_or_else(|| "eta is not 2 x 3 numbers".into())
            };
            let shape = ShiftedGamma {
                alpha: list("alpha")?,
                p: list("p")?,
                f0: half(0)?,
                f1: half(3)?,
                normalisation: list("K")?,
                lambda: list("Lambda")?,
                c: list("c")?,
                k: list("k")?,
                theta0: list("theta0")?,
            };
            return Ok(ClassicalModel { diffuse, specular, lobe: ClassicalLobe::ShiftedGamma(Box::new(shape)) });
        }
        other => return Err(format!("a model that is not known: {other}")),
    };
    Ok(ClassicalModel { diffuse: scaled(diffuse, 1.0), specular: scaled(specular, factor), lobe })
}

/// The numbers after `NAME = `, brackets left out.
fn numbers(text: &str, name: &str) -> std::result::Result<Vec<f64>, String> {
    let key = format!("{name} = ");
    let begin = (text.match_indices(&key).map(|(at, _)| at))
        .find(|&at| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
        .ok_or_else(|| format!("{name} is missing"))?;
    let rest = &text[begin + key.len()..];
    let mut depth = 0;
    let end = rest.find(|c: char| {
        depth += i32::from(c == '[') - i32::from(c == ']');
        c == ')' || (depth <= 0 && c == ',')
    });
    let list = &rest[..end.unwrap_or(rest.len())];
    let parts = list.split(',').map(|part| part.trim_matches(|c: char| "[] ".contains(c)));
    parts.map(|part| part.parse().map_err(|_| format!("{name}: '{part}' is not a number"))).collect()
}

fn colours(text: &str, name: &str) -> std::result::Result<[f64; 3], String> {
    numbers(text, name)?.try_into().map_err(|found: Vec<f64>| format!("{name}: {} numbers, 3 expected", found.len()))
}

fn number(text: &str, name: &str) -> std::result::Result<f64, String> {
    numbers(text, name)?.first().copied().filter(|x| x.is_finite()).ok_or_else(|| format!("{name} is not a number"))
}
