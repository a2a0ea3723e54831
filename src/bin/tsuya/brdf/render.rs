//! `tsuya brdf render`: a sphere of a material.

use super::eval::environment;
use super::material::read_one;
use super::sheet::sweep_lights;
use crate::values::triple;
use crate::{output, pictures, progress};
use anyhow::Result;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use tsuya::Error;
use tsuya::brdf::{POINT_LIGHT, SphereScenes, sphere_exposure};
use tsuya::metrics::to_display;

/// Renders a sphere of a material under a point light or in an environment.
#[derive(Args)]
pub struct Render {
    /// A MERL table (.binary), an RGL material (.bsdf) or a fitted material (.tsuya, .json).
    input: PathBuf,
    /// The picture: .png (sRGB) or .exr (linear).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Light on the sphere.
    #[arg(long, value_enum, default_value_t = SphereLighting::Environment)]
    scene: SphereLighting,
    /// A lat-long picture as the environment [default: one of the program's own].
    #[arg(long, visible_alias = "env", value_name = "FILE")]
    environment: Option<PathBuf>,
    /// Place of the point light; the sphere has radius 1, the camera looks along -z.
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    light: Option<[f64; 3]>,
    /// A row of this many pictures under a point light that moves from left to right.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), conflicts_with_all = ["scene", "light"])]
    sweep: Option<u16>,
    /// Width and height in pixels.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(8..=1024))]
    size: u16,
    /// Radiance that is shown as white [default: the 95th percentile of the sphere's pixels].
    #[arg(long, value_name = "X")]
    white: Option<f64>,
    /// Which material, where the file has several.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// Overwrites an existing picture.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum SphereLighting {
    /// A point light.
    Point,
    /// An environment.
    Environment,
}

impl Render {
    pub fn run(self) -> Result<()> {
        output::check_outputs(&[&self.output], &[&self.input], self.force)?;
        let extension = self.output.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if !["png", "exr"].contains(&extension.as_str()) && !output::is_stream(&self.output) {
            let message = format!("{}: a picture's name ends with .png or .exr", self.output.display());
            return Err(Error::parameter(message).into());
        }
        let _busy = progress::busy("rendering");
        let material = read_one(&self.input, self.material.as_deref())?.material;
        let lights: Vec<[f64; 3]> = match (self.sweep, self.scene, self.light) {
            (Some(steps), ..) => sweep_lights(steps.into()),
            (None, _, Some(light)) => vec![light],
            (None, SphereLighting::Point, None) => vec![POINT_LIGHT],
            (None, SphereLighting::Environment, None) => vec![],
        };
        let side = usize::from(self.size);
        let images = if lights.is_empty() {
            let scenes = SphereScenes::new(side, &environment(self.environment.as_deref())?);
            vec![scenes.render_environment(&material.interpolated())]
        } else {
            lights
                .iter()
                .map(|&light| SphereScenes::point_lights(side).render_point_light(&material.interpolated(), light))
                .collect()
        };
        let mask = SphereScenes::point_lights(side).mask().clone();
        let measured = images.iter().map(|image| sphere_exposure(image, &mask)).fold(0.0, f64::max);
        let white = self.white.unwrap_or(measured);
        let bytes = if extension == "exr" {
            let [image] = images.as_slice() else {
                return Err(Error::parameter("a sweep is written as .png").into());
            };
            pictures::exr(image, false)?
        } else {
            let shown: Vec<_> = images.iter().map(|image| to_display(image, [white; 3])).collect();
            pictures::png(&pictures::beside(&shown))?
        };
        output::write(&self.output, &bytes, self.force)
    }
}
