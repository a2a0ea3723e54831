//! `tsuya render`: images from any camera, under any point lights or an environment.

use crate::surroundings::{self, EnvironmentSettings, JobAsset, JobLight};
use crate::values::{Numbers, OutsideArgument, find_view, numbers, size, triple};
use crate::{output, pictures, progress, source};
use anyhow::Result;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use tsuya::Asset;
use tsuya::Error;
use tsuya::decoder::ViewSelection;
use tsuya::image::RgbImage;
use tsuya::input::Folder;
use tsuya::metrics::to_display;
use tsuya::relight::{
    self, AssetRenderer, AssetShading, EnvironmentOptions, EnvironmentRender, JobEnvironment, JobEvaluator, Occlusion,
    PointLightOptions, RenderLayers, RenderLighting, RenderObject, RenderOptions,
};
use tsuya::{Camera, PointLight};

/// Size of images of files without photographs.
const SIZE: [u32; 2] = [800, 600];
/// Where the first camera around such an object stands: turned about +Y from +Z, raised, degrees.
const ANGLES: [f64; 2] = [30.0, 20.0];

/// Renders images of the object.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya render vase.tsuya -o vase.png --view 0 --light 1,2,3\n",
    "  tsuya render vase.tsuya -o vase.png --environment studio.exr --camera 0,1,3,0,0,0\n",
    "  tsuya render vase.tsuya -o around.png --orbit 36 --size 800x800\n",
    "  tsuya render --job job.json -o vase.exr",
))]
pub struct Render {
    /// The file; - is standard input.
    #[arg(required_unless_present = "job", conflicts_with = "job")]
    file: Option<PathBuf>,
    /// Takes everything from this file, JSON: mesh and material, or asset; environment, camera, size. The image is linear, Rec. 709.
    #[arg(long, value_name = "JOB.json", group = "around")]
    job: Option<PathBuf>,
    #[command(flatten)]
    surround: EnvironmentArguments,
    /// The image: .png (sRGB; the white board is 255, under an environment radiance 1 is) or .exr (linear radiance). With --orbit a number is put into the name.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    place: CameraArguments,
    /// Field of view of --camera, the longer side, in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 35.0, requires = "camera")]
    fov: f64,
    /// Upward direction of --camera [default: upward in the photographs, +Y without any].
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true, requires = "camera")]
    up: Option<[f64; 3]>,
    /// Size of the image [default: as the photographs, 800x600 without any].
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// A point light instead of the capture's: its place, and its intensity as one number or three [default: as the capture's];
    /// may come several times. A lamp of the capture gives its photograph.
    #[arg(long, value_name = "X,Y,Z[,I]", value_parser = numbers, allow_hyphen_values = true)]
    light: Vec<Numbers>,
    /// Which of the capture's lights, 0 the most used, where it has several.
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with = "light")]
    capture_light: usize,
    /// What is shown, with commas between [default: all].
    #[arg(long, value_name = "LAYER,...", value_delimiter = ',', value_enum)]
    layers: Vec<Layer>,
    /// Takes the nearest captured view's residual instead of interpolating.
    #[arg(long, conflicts_with = "around")]
    nearest: bool,
    /// Disables self-shadowing.
    #[arg(long)]
    no_shadows: bool,
    /// Brighter by this many stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true)]
    exposure: f64,
    /// Samples of a pixel along each side, 1 to 8, from 2 on twice as many at the outline [default: 2; under lamps 1 from a captured camera, which
    /// gives its photograph].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: Option<u32>,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites existing images.
    #[arg(long)]
    force: bool,
}

#[derive(Args)]
struct EnvironmentArguments {
    /// Light from all around: EXR, HDR, PNG or JPEG, 2:1 latitude and longitude or a cube; or a .tsuya file with light (tsuya light fit).
    #[arg(long = "environment", visible_alias = "env", value_name = "FILE", group = "around", conflicts_with_all = ["light", "capture_light"])]
    env: Option<PathBuf>,
    /// Factor of the environment's radiance.
    #[arg(
        long = "environment-scale",
        alias = "env-scale",
        value_name = "FACTOR",
        default_value_t = 1.0,
        requires = "env"
    )]
    env_scale: f64,
    /// Turns the environment about +Y, degrees.
    #[arg(
        long = "environment-rotation",
        alias = "env-rotation",
        value_name = "DEG",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        requires = "env"
    )]
    env_rotation: f64,
    /// How the environment's light is summed [default: filtered, or what the job says].
    #[arg(long, value_name = "NAME", value_enum, requires = "around")]
    evaluator: Option<EvaluatorName>,
    /// Sums direct light by brute force: slow, exact.
    #[arg(long, conflicts_with = "evaluator", requires = "around")]
    reference: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum EvaluatorName {
    /// Spherical Gaussians throughout.
    #[value(alias = "published")]
    Sg,
    /// Filtered importance sampling; compact sources apart, with exact shadows.
    #[value(alias = "better")]
    Filtered,
}

#[derive(Args)]
#[group(multiple = false)]
struct CameraArguments {
    /// From the camera of this captured view, by number or name [default: the first; of a modelled object one that shows it whole].
    #[arg(long, value_name = "VIEW")]
    view: Option<String>,
    /// This many images around the object.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10000))]
    orbit: Option<u16>,
    /// From this place, looking at that one: px,py,pz,tx,ty,tz.
    #[arg(long, value_name = "P,T", value_parser = numbers, allow_hyphen_values = true)]
    camera: Option<Numbers>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Layer {
    /// Diffuse reflection.
    Diffuse,
    /// Specular reflection.
    Specular,
    /// The reflectance model.
    Model,
    /// What the photographs have beyond the model.
    Residual,
    /// Light that the object sends to itself.
    Interreflection,
}

impl Render {
    pub fn run(self) -> Result<()> {
        let is_exr = is_exr(&self.output)?;
        if !(1.0..=170.0).contains(&self.fov) {
            return Err(Error::parameter("--fov goes from 1 to 170 degrees").into());
        }
        let layers = self.layers();
        if (self.job.is_some() || self.surround.env.is_some()) && !(layers.diffuse && layers.specular && layers.model) {
            let message = "under an environment both reflections are shown by the model: --layers only adds residual and interreflection to it";
            return Err(Error::parameter(message).into());
        }
        if let Some(job) = &self.job {
            return self.run_job(job, is_exr);
        }
        let file = self.file.as_deref().unwrap_or(Path::new("-"));
        // Read before the object is decoded, which takes longer.
        let environment = self.surround.env.as_deref().map(|path| self.environment(path)).transpose()?;
        let asset = {
            let _busy = progress::busy("decoding");
            let selection = if layers.residual { ViewSelection::All } else { ViewSelection::None };
            source::decode(file, selection)?.0
        };
        if let Some(light) = &environment {
            return self.run_environment(asset, light, is_exr);
        }
        if asset.is_modelled() {
            return self.run_modelled(asset, file, is_exr);
        }
        let is_captured = self.place.orbit.is_none() && self.place.camera.is_none();
        let options = RenderOptions {
            lighting: self.lighting(&asset)?,
            layers,
            views: if self.nearest { 1 } else { RenderOptions::default().views },
            shadows: !self.no_shadows,
            samples: self.samples.unwrap_or(if is_captured { 1 } else { 2 }),
        };
        let cameras = self.cameras(&asset)?;
        let paths = self.paths();
        self.check(&paths, file)?;
        let _busy = progress::busy("rendering");
        let renderer = AssetRenderer::new(&asset)?;
        let mut files = output::Files::new(self.force);
        for (camera, path) in cameras.iter().zip(&paths) {
            let image = renderer.render(camera, &options)?.image;
            files.add(path, &self.picture(&image, asset.white, is_exr)?)?;
        }
        files.commit()
    }

    /// An object whose materials are bound to its mesh, under point lights or the light that its file has.
    fn run_modelled(&self, asset: Asset, file: &Path, is_exr: bool) -> Result<()> {
        let layers = self.layers();
        if !layers.model {
            return Err(Error::parameter("the object was modelled: it has no residual to show").into());
        }
        let lights = match self.lighting(&asset)? {
            RenderLighting::Points(lights) => lights,
            RenderLighting::Capture(_) => asset.views.iter().find_map(|view| view.light).into_iter().collect(),
        };
        let cameras = self.cameras(&asset)?;
        let paths = self.paths();
        self.check(&paths, file)?;
        let _busy = progress::busy("rendering");
        let mut files = output::Files::new(self.force);
        let mut add = |k: usize, relit: EnvironmentRender| {
            let image = match (layers.diffuse, layers.specular) {
                (true, false) => relit.diffuse,
                (false, true) => difference(&relit.image, &relit.diffuse),
                _ => relit.image,
            };
            files.add(&paths[k], &self.picture(&image, [1.0; 3], is_exr)?)
        };
        if !lights.is_empty() {
            let stored = asset.visibility.as_ref().filter(|_| !self.no_shadows).map(Occlusion::from_visibility);
            let options = PointLightOptions { shadows: !self.no_shadows, samples: self.samples.unwrap_or(2) };
            let object = RenderObject::of_asset(&asset, stored.as_ref())?;
            let shading = AssetShading::new(&asset, EnvironmentOptions::default().taps)?;
            for (k, camera) in cameras.iter().enumerate() {
                add(k, relight::render_point_lights(&object, camera, &shading, &lights, &options)?)?;
            }
        } else if let Some(stored) = asset.light.clone() {
            let light = surroundings::stored_light(stored, file)?;
            let quality = self.settings();
            surroundings::pictures(&JobAsset::Asset(Box::new(asset)), &light, &cameras, quality, add)?;
        } else {
            let message = "the object was modelled, and its file has no light: --light X,Y,Z,I or --environment FILE gives one, tsuya light fit \
                           makes one for the file";
            return Err(Error::parameter(message).into());
        }
        files.commit()
    }

    /// How an environment is summed where no job says it.
    fn settings(&self) -> EnvironmentSettings {
        EnvironmentSettings {
            evaluator: self.evaluator(JobEvaluator::Filtered),
            shadows: !self.no_shadows,
            samples: self.samples.unwrap_or(2),
            layers: self.layers(),
        }
    }

    fn run_job(&self, path: &Path, is_exr: bool) -> Result<()> {
        self.check(std::slice::from_ref(&self.output), path)?;
        let (job, folder) = surroundings::read_job(path, self.outside)?;
        let quality = EnvironmentSettings {
            evaluator: self.evaluator(job.evaluator),
            shadows: job.shadows && !self.no_shadows,
            samples: self.samples.or(job.samples).unwrap_or(2),
            layers: self.layers(),
        };
        let _busy = progress::busy("rendering");
        // The object last, which takes longest.
        let light = surroundings::light(&job.environment, &folder)?;
        let subject = surroundings::subject(&job, &folder, quality.layers.residual)?;
        surroundings::pictures(&subject, &light, &[job.camera()?], quality, |_, relit| {
            output::write(&self.output, &self.picture(&relit.image, [1.0; 3], is_exr)?, self.force)
        })
    }

    fn environment(&self, file: &Path) -> Result<JobLight> {
        self.check(&self.paths(), file)?;
        let EnvironmentArguments { env_scale: scale, env_rotation: rotation_y_deg, .. } = self.surround;
        let environment = JobEnvironment { file: file.to_owned(), scale, rotation_y_deg };
        surroundings::light(&environment, &Folder::new("", file, true))
    }

    fn run_environment(&self, asset: Asset, light: &JobLight, is_exr: bool) -> Result<()> {
        let (cameras, paths) = (self.cameras(&asset)?, self.paths());
        let _busy = progress::busy("rendering");
        let mut files = output::Files::new(self.force);
        surroundings::pictures(&JobAsset::Asset(Box::new(asset)), light, &cameras, self.settings(), |k, relit| {
            files.add(&paths[k], &self.picture(&relit.image, [1.0; 3], is_exr)?)
        })?;
        files.commit()
    }

    fn evaluator(&self, otherwise: JobEvaluator) -> JobEvaluator {
        match self.surround.evaluator {
            _ if self.surround.reference => JobEvaluator::Reference,
            Some(EvaluatorName::Sg) => JobEvaluator::Sg,
            Some(EvaluatorName::Filtered) => JobEvaluator::Filtered,
            None => otherwise,
        }
    }

    fn picture(&self, image: &RgbImage, white: [f64; 3], is_exr: bool) -> Result<Vec<u8>> {
        let gain = self.exposure.exp2() as f32;
        let image = image.map(|pixel| pixel.map(|v| v * gain));
        if is_exr { pictures::exr(&image, false) } else { pictures::png(&to_display(&image, white)) }
    }

    /// Before long work: may the images be written?
    fn check(&self, paths: &[PathBuf], input: &Path) -> Result<()> {
        let inputs: Vec<&Path> = self.file.iter().map(|path| &**path).chain([input]).collect();
        output::check_outputs(&paths.iter().map(|path| &**path).collect::<Vec<_>>(), &inputs, self.force)
    }

    /// The images, one for each camera.
    fn paths(&self) -> Vec<PathBuf> {
        match self.place.orbit {
            Some(count) => (0..count.into()).map(|k| numbered(&self.output, k)).collect(),
            None => vec![self.output.clone()],
        }
    }

    fn layers(&self) -> RenderLayers {
        let has = |layer| self.layers.contains(&layer);
        // Naming only reflections shows them whole, naming only parts shows them of both reflections.
        let reflections = has(Layer::Diffuse) || has(Layer::Specular);
        let parts = [Layer::Model, Layer::Residual, Layer::Interreflection].into_iter().any(has);
        RenderLayers {
            diffuse: has(Layer::Diffuse) || !reflections,
            specular: has(Layer::Specular) || !reflections,
            model: has(Layer::Model) || !parts,
            residual: has(Layer::Residual) || !parts,
            interreflection: has(Layer::Interreflection) || !parts,
        }
    }

    fn lighting(&self, asset: &Asset) -> Result<RenderLighting> {
        if self.light.is_empty() {
            return Ok(RenderLighting::Capture(self.capture_light));
        }
        let known = asset.views.iter().find_map(|view| view.light);
        let light = |Numbers(values): &Numbers| {
            let intensity = match (values.get(3..), known) {
                (Some([]), Some(light)) => light.intensity,
                (Some([all]), _) => [*all; 3],
                (Some([r, g, b]), _) => [*r, *g, *b],
                _ => {
                    let message = "--light takes x,y,z and, where the capture's lights are unknown, an intensity: one number or \
                                   three";
                    return Err(Error::parameter(message));
                }
            };
            Ok(PointLight { position: [values[0], values[1], values[2]], intensity })
        };
        Ok(RenderLighting::Points(self.light.iter().map(light).collect::<tsuya::Result<_>>()?))
    }

    fn cameras(&self, asset: &Asset) -> Result<Vec<Camera>> {
        let Some(first) = asset.views.first() else { return self.cameras_around(asset) };
        let sized = |camera: Camera| self.size.map_or(camera, |size| resized(camera, size));
        if let Some(count) = self.place.orbit {
            return Ok(relight::orbit(asset, count.into()).into_iter().map(sized).collect());
        }
        if let Some(values) = &self.place.camera {
            let size = self.size.unwrap_or([first.camera.width, first.camera.height]);
            let upright = || {
                let down = asset.views.iter().map(|view| view.camera.rotation[1]);
                down.fold([0.0; 3], |sum, row| std::array::from_fn(|k| sum[k] - row[k]))
            };
            return Ok(vec![self.given_camera(values, size, upright)?]);
        }
        let view = match &self.place.view {
            Some(wanted) => find_view(wanted, &asset.views)?,
            None => 0,
        };
        Ok(vec![sized(asset.views[view].camera)])
    }

    /// Cameras of a file without views.
    fn cameras_around(&self, asset: &Asset) -> Result<Vec<Camera>> {
        let size = self.size.unwrap_or(SIZE);
        if self.place.view.is_some() || asset.mesh.positions.is_empty() {
            return Err(Error::parameter("the file has no view").into());
        }
        match &self.place.camera {
            Some(values) => Ok(vec![self.given_camera(values, size, || [0.0, 1.0, 0.0])?]),
            None => {
                let count = self.place.orbit.map_or(1, usize::from);
                Ok(relight::framing(&asset.mesh, ANGLES.map(f64::to_radians), self.fov.to_radians(), size, count))
            }
        }
    }

    fn given_camera(
        &self,
        Numbers(values): &Numbers,
        [width, height]: [u32; 2],
        upright: impl FnOnce() -> [f64; 3],
    ) -> Result<Camera> {
        let &[px, py, pz, tx, ty, tz] = values.as_slice() else {
            return Err(Error::parameter("--camera takes six numbers: its place and the place it looks at").into());
        };
        let focal = 0.5 * width.max(height) as f64 / (0.5 * self.fov.to_radians()).tan();
        let up = self.up.unwrap_or_else(upright);
        Ok(relight::look_at([px, py, pz], [tx, ty, tz], up, focal, width, height))
    }
}

/// What one image has beyond another.
fn difference(a: &RgbImage, b: &RgbImage) -> RgbImage {
    let beyond = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| a[c] - b[c]);
    RgbImage { width: a.width, height: a.height, data: a.data.iter().zip(&b.data).map(beyond).collect() }
}

/// The same view in an image of another size; where the shape differs, more is shown rather than less.
fn resized(camera: Camera, [width, height]: [u32; 2]) -> Camera {
    let scale = (width as f64 / camera.width as f64).min(height as f64 / camera.height as f64);
    let place = |principal: f64, old: u32, new: u32| (principal - old as f64 / 2.0) * scale + new as f64 / 2.0;
    Camera {
        width,
        height,
        focal: camera.focal.map(|focal| focal * scale),
        principal: [place(camera.principal[0], camera.width, width), place(camera.principal[1], camera.height, height)],
        ..camera
    }
}

pub fn is_exr(path: &Path) -> Result<bool> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(true),
        Some("png") => Ok(false),
        _ if output::is_stream(path) => Ok(false),
        _ => Err(Error::parameter(format!("{}: a picture's name ends with .png or .exr", path.display())).into()),
    }
}

/// `OUT-007.png` of `OUT.png`.
pub fn numbered(path: &Path, number: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number:03}.{extension}"))
}
