//! Images under an environment: what `render --environment`, `render --job` and `composite` share.

use crate::source;
use crate::values::OutsideArgument;
use anyhow::Result;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tsuya::Asset;
use tsuya::Camera;
use tsuya::Mesh;
use tsuya::decoder::ViewSelection;
use tsuya::image::RgbImage;
use tsuya::input::{FileAccess, Folder};
use tsuya::lighting::{self, EnvironmentMap, EnvironmentReadOptions};
use tsuya::relight::{
    AssetRenderer, AssetShading, EnvironmentOptions, EnvironmentRender, EnvironmentScene, EvaluatorKind, Job,
    JobEnvironment, JobEvaluator, JobMaterial, JobParameter, Occlusion, PreparedEnvironment,
    PreparedEnvironmentOptions, ReferenceOptions, RenderLayers, RenderObject, ShadingModel, Texture, TexturedShading,
    Textures, UniformMaterial, add_detail, reference,
};
use tsuya::visibility::{BakeOptions, Visibility, bake};
use tsuya::{Error, mesh};

/// Bytes of a job, at most.
const MAX_JOB_BYTES: u64 = 1 << 20;
/// Cells along a side of the sharpest level.
const LEVEL_SIDE: usize = 256;

/// What is shown: an asset, or a mesh of one material.
pub enum JobAsset {
    Asset(Box<Asset>),
    Mesh {
        mesh: Mesh,
        visibility: Option<Box<Visibility>>,
        /// Texture coordinates, along which the surface's axes lie; where there are any.
        coordinates: Option<Vec<mesh::CornerCoordinates>>,
        material: Box<JobMaterial>,
        folder: Folder,
        file: PathBuf,
    },
}

impl JobAsset {
    pub fn mesh(&self) -> &Mesh {
        match self {
            JobAsset::Asset(asset) => &asset.mesh,
            JobAsset::Mesh { mesh, .. } => mesh,
        }
    }

    fn render_object<'a>(&'a self, occlusion: Option<&'a Occlusion>) -> Result<RenderObject<'a>> {
        Ok(match self {
            JobAsset::Asset(asset) => RenderObject::of_asset(asset, occlusion)?,
            JobAsset::Mesh { mesh, coordinates, .. } => {
                let object = RenderObject::new(mesh, occlusion)?;
                match coordinates {
                    Some(coordinates) => object.with_coordinates(coordinates)?,
                    None => object,
                }
            }
        })
    }

    fn shading_model(&self, taps: usize) -> Result<Box<dyn ShadingModel + '_>> {
        Ok(match self {
            JobAsset::Asset(asset) => Box::new(AssetShading::new(asset, taps)?),
            JobAsset::Mesh { mesh, material, folder, file, .. } => {
                let textures = textures(material, folder, file)?;
                if textures == Textures::default() {
                    return Ok(Box::new(UniformMaterial::new(material.material(folder, source::limits())?, taps)));
                }
                let part = |value: f64| {
                    let none = || Error::parameter("material: this model has no lobe");
                    material.specular_part(Some(value))?.ok_or_else(none)
                };
                Box::new(TexturedShading::new(material.uniform()?, textures, mesh.triangles.len(), taps, part)?)
            }
        })
    }
}

/// How light is summed and how finely.
#[derive(Clone, Copy)]
pub struct EnvironmentSettings {
    pub evaluator: JobEvaluator,
    pub shadows: bool,
    pub samples: u32,
    /// Of which the residual stands for detail.
    pub layers: RenderLayers,
}

/// Light from all around.
pub struct JobLight {
    pub environment: EnvironmentMap,
    /// Lobes and levels, where a file has them.
    stored: Option<lighting::EnvironmentLobes>,
}

/// Reads the environment of a job: an image, or the light of a `.tsuya` file.
pub fn light(job: &JobEnvironment, folder: &Folder) -> Result<JobLight> {
    if !(job.scale.is_finite() && job.scale >= 0.0 && job.rotation_y_deg.is_finite()) {
        return Err(
            Error::parameter("an environment's scale and rotation are finite, the scale is not negative").into()
        );
    }
    let path = folder.resolve_path(&job.file)?;
    if source::has_extension(&path, "tsuya") {
        return stored_light(source::read_light(&path)?.turned_y(job.rotation_y_deg).scaled(job.scale), &path);
    }
    let (environment, cleaned) = lighting::read_environment(
        &[path],
        &EnvironmentReadOptions { limits: source::limits(), ..Default::default() },
    )?;
    if cleaned.negative + cleaned.not_finite > 0 {
        tracing::info!("{} negative and {} missing pixels replaced", cleaned.negative, cleaned.not_finite);
    }
    let environment = environment.scaled(job.scale as f32);
    let turned = job.rotation_y_deg != 0.0;
    let environment = if turned { environment.rotated_y(job.rotation_y_deg) } else { environment };
    Ok(JobLight { environment, stored: None })
}

/// The light that a file has.
pub fn stored_light(stored: lighting::EnvironmentLobes, path: &Path) -> Result<JobLight> {
    let Some(environment) = stored.environment() else {
        return Err(Error::input(path, "its light has no levels: tsuya light fit makes them").into());
    };
    Ok(JobLight { environment, stored: Some(stored) })
}

/// Images of a subject from several cameras.
pub fn pictures(
    subject: &JobAsset,
    light: &JobLight,
    cameras: &[Camera],
    quality: EnvironmentSettings,
    mut done: impl FnMut(usize, EnvironmentRender) -> Result<()>,
) -> Result<()> {
    let options = EnvironmentOptions {
        evaluator: match quality.evaluator {
            JobEvaluator::Sg => EvaluatorKind::SphericalGaussian,
            _ => EvaluatorKind::Filtered,
        },
        shadows: quality.shadows,
        samples: quality.samples,
        ..EnvironmentOptions::default()
    };
    let look = subject.shading_model(options.taps)?;
    let asset = match subject {
        JobAsset::Asset(asset) if quality.layers.residual && !asset.is_modelled() => Some(&**asset),
        _ => None,
    };
    let renderer = asset.map(AssetRenderer::new).transpose()?;
    let mut finish = |k: usize, mut relit: EnvironmentRender| -> Result<()> {
        if let (Some(asset), Some(renderer)) = (asset, &renderer) {
            add_detail(&mut relit, renderer, asset, &cameras[k])?;
        }
        done(k, relit)
    };
    if quality.evaluator == JobEvaluator::Reference {
        let object = subject.render_object(None)?;
        let options = ReferenceOptions { samples: quality.samples, shadows: quality.shadows, ..Default::default() };
        for (k, camera) in cameras.iter().enumerate() {
            finish(k, reference(&object, &light.environment, camera, &*look, &options)?)?;
        }
        return Ok(());
    }
    let occlusion = if quality.shadows { Some(occlusion(subject)?) } else { None };
    let object = subject.render_object(occlusion.as_ref())?;
    let environment = &light.environment;
    let prepared = PreparedEnvironment::new(environment, &PreparedEnvironmentOptions::default());
    let light = (options.evaluator == EvaluatorKind::SphericalGaussian).then(|| match &light.stored {
        Some(stored) => stored.clone(),
        None => lighting::EnvironmentLobes {
            diffuse: lighting::fit(environment, &lighting::LobeFitOptions::default(), None),
            prefiltered: lighting::prefiltered_maps(environment, LEVEL_SIDE),
        },
    });
    let scene = EnvironmentScene::new(&object, Arc::new(prepared), light.map(Arc::new), options)?;
    // Of modelled objects a job's material draws the same picture.
    let is_captured = matches!(subject, JobAsset::Asset(asset) if !asset.is_modelled());
    let scene = if is_captured && quality.layers.interreflection { scene.with_interreflection(&*look) } else { scene };
    for (k, camera) in cameras.iter().enumerate() {
        finish(k, scene.render(camera, &*look)?)?;
    }
    Ok(())
}

/// The visibility of what a job shows, or computed now where it has none.
pub fn occlusion(subject: &JobAsset) -> Result<Occlusion> {
    match subject {
        JobAsset::Asset(asset) => stored_occlusion(&asset.mesh, asset.visibility.as_ref()),
        JobAsset::Mesh { mesh, visibility, .. } => stored_occlusion(mesh, visibility.as_deref()),
    }
}

/// The visibility that a file has of its mesh, or computed now where it has none.
pub fn stored_occlusion(mesh: &Mesh, stored: Option<&Visibility>) -> Result<Occlusion> {
    if let Some(visibility) = stored {
        return Ok(Occlusion::from_visibility(visibility));
    }
    tracing::info!("the file has no visibility (tsuya bake): computing it");
    Ok(Occlusion::from_visibility(&bake(mesh, &BakeOptions::default())?.visibility))
}

/// Reads a job; paths in it are relative to its folder, which comes with it.
pub fn read_job(path: &Path, outside: OutsideArgument) -> Result<(Job, Folder)> {
    let bytes = source::read_at_most(path, "job", MAX_JOB_BYTES)?;
    let job = serde_json::from_slice(&bytes).map_err(|e| Error::input(path, e.to_string()))?;
    Ok((job, outside.folder(path)))
}

/// What a job shows.
pub fn subject(job: &Job, folder: &Folder, detail: bool) -> Result<JobAsset> {
    match (&job.asset, &job.mesh, &job.material) {
        (Some(asset), None, None) => {
            let selection = if detail { ViewSelection::All } else { ViewSelection::None };
            Ok(JobAsset::Asset(Box::new(source::decode(&folder.resolve_path(asset)?, selection)?.0)))
        }
        (None, Some(file), Some(material)) => {
            let file = folder.resolve_path(file)?;
            // What `tsuya bake` writes brings its visibility along.
            let (mesh, visibility, coordinates) = if source::has_extension(&file, "tsuya") {
                let (asset, _) = source::decode(&file, ViewSelection::None)?;
                (asset.mesh, asset.visibility.map(Box::new), asset.coordinates)
            } else {
                let access = source::access().allow_outside(folder.allows_outside());
                let (mesh, coordinates) = (mesh::read(&file, &access)?, read_coordinates(&file, &access)?);
                let of_mesh = |all: &Vec<mesh::CornerCoordinates>| all.len() == mesh.triangles.len();
                let coordinates = coordinates.filter(of_mesh);
                (mesh, None, coordinates)
            };
            let (material, folder) = (Box::new(material.clone()), folder.clone());
            Ok(JobAsset::Mesh { mesh, visibility, coordinates, material, folder, file })
        }
        _ => Err(Error::parameter("a job has either asset, or mesh and material").into()),
    }
}

/// The texture coordinates of a mesh file, if it has any.
pub fn read_coordinates(file: &Path, access: &FileAccess) -> Result<Option<Vec<mesh::CornerCoordinates>>> {
    let is_obj = source::has_extension(file, "obj");
    let coordinates = if is_obj { mesh::texture_coordinates(file, access)? } else { Vec::new() };
    Ok(Some(coordinates).filter(|coordinates| !coordinates.is_empty()))
}

/// An image in linear values: numbers as they are, not decoded from sRGB, unless it is a colour.
fn read_texture(path: &Path, access: &FileAccess, colour: bool, scale: f64) -> Result<Texture> {
    let space = if colour { "srgb" } else { "linear" };
    let image: RgbImage = tsuya::image::read_linear_image(path, access, space)?;
    access.charge(path, "texture", size_of_val(&image.data[..]) as u64)?;
    Ok(Texture { image, scale: scale as f32 })
}

fn textures(material: &JobMaterial, folder: &Folder, mesh: &Path) -> Result<Textures> {
    let access = source::access();
    let mut textures = Textures::default();
    if let Some(JobParameter::Texture { texture, scale }) = &material.diffuse {
        textures.diffuse = Some(read_texture(&folder.resolve_path(texture)?, &access, true, *scale)?);
    }
    if let Some(JobParameter::Texture { texture, scale }) = &material.specular {
        textures.specular = Some(read_texture(&folder.resolve_path(texture)?, &access, true, *scale)?);
    }
    if let Some(JobParameter::Texture { texture, scale }) = &material.roughness {
        textures.roughness = Some(read_texture(&folder.resolve_path(texture)?, &access, false, *scale)?);
    }
    if let Some(JobParameter::Texture { texture, scale }) = &material.exponent {
        textures.exponent = Some(read_texture(&folder.resolve_path(texture)?, &access, false, *scale)?);
    }
    if textures != Textures::default() {
        textures.coordinates = mesh::texture_coordinates(mesh, &access)?;
    }
    Ok(textures)
}
