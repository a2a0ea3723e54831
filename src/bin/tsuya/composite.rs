//! `tsuya composite`: an object over a photograph, with its shadow on the ground.

use crate::surroundings::{self, EnvironmentSettings};
use crate::values::OutsideArgument;
use crate::{output, pictures, progress, source};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use tsuya::Error;
use tsuya::image::{RgbImage, read_radiance};
use tsuya::metrics::to_display;
use tsuya::relight::{Ground, PreparedEnvironment, PreparedEnvironmentOptions, RenderLayers, composite, ground_shadow};

/// Puts an object into a photograph whose camera and surroundings are known.
///
/// The job's camera is the photograph's; its environment lights the object and is taken away from the ground where the object
/// stands before it.
#[derive(Args)]
pub struct Composite {
    /// The job, as of `tsuya render --job`: asset (or mesh and material), environment, camera, size.
    job: PathBuf,
    /// The photograph, of the job's size: EXR (linear) or PNG, JPEG, TIFF (sRGB). `environment`: what the camera sees of the
    /// environment.
    #[arg(long, value_name = "FILE")]
    photograph: PathBuf,
    /// The image: .png (sRGB, radiance 1 is 255) or .exr.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Height of the ground along the camera's upward direction [default: below the object's lowest vertex].
    #[arg(long, value_name = "HEIGHT", allow_hyphen_values = true)]
    ground: Option<f64>,
    /// Brighter by this many stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true)]
    exposure: f64,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites an existing image.
    #[arg(long)]
    force: bool,
}

impl Composite {
    pub fn run(self) -> Result<()> {
        let is_exr = crate::render::is_exr(&self.output)?;
        output::check_outputs(&[&self.output], &[&self.job, &self.photograph], self.force)?;
        let (job, folder) = surroundings::read_job(&self.job, self.outside)?;
        let camera = job.camera()?;
        let _busy = progress::busy("rendering");
        let light = surroundings::light(&job.environment, &folder)?;
        let environment = &light.environment;
        let photograph: RgbImage = if self.photograph.as_os_str() == "environment" {
            let (width, height) = (camera.width as usize, camera.height as usize);
            let pixel = |k: usize| {
                let ray = camera.ray([(k % width) as f64 + 0.5, (k / width) as f64 + 0.5]);
                let length = ray.iter().map(|x| x * x).sum::<f64>().sqrt();
                environment.radiance(ray.map(|x| x / length))
            };
            RgbImage { width, height, data: (0..width * height).map(pixel).collect() }
        } else {
            read_radiance(&self.photograph, &source::access())?
        };
        if [photograph.width, photograph.height] != job.size.map(|side| side as usize) {
            let message = format!("{} x {} pixels, the job says {:?}", photograph.width, photograph.height, job.size);
            return Err(Error::input(&self.photograph, message).into());
        }
        let subject = surroundings::subject(&job, &folder, true)?;
        let length = job.camera.up.iter().map(|x| x * x).sum::<f64>().sqrt();
        let up = job.camera.up.map(|x| x / length.max(1e-30));
        let ground = match self.ground {
            Some(height) => Ground { point: up.map(|x| x * height), up },
            None => Ground::below(subject.mesh(), up),
        };
        // More lights than on the object: steps between their shadows show most on a plane.
        let finer = PreparedEnvironmentOptions { distant_lights: 32, ..PreparedEnvironmentOptions::default() };
        let surround = PreparedEnvironment::new(environment, &finer);
        let shadow = ground_shadow(subject.mesh(), &surround, &ground, &camera)?;
        let quality = EnvironmentSettings {
            evaluator: job.evaluator,
            shadows: job.shadows,
            samples: job.samples.unwrap_or(2),
            layers: RenderLayers::default(),
        };
        let gain = self.exposure.exp2() as f32;
        surroundings::pictures(&subject, &light, &[camera], quality, |_, relit| {
            let image = composite(&photograph, &relit, &shadow)?.map(|pixel| pixel.map(|v| v * gain));
            let bytes =
                if is_exr { pictures::exr(&image, false)? } else { pictures::png(&to_display(&image, [1.0; 3]))? };
            output::write(&self.output, &bytes, self.force)
        })
    }
}
