//! Light of `tsuya ar`: one environment, or one for each frame.

use super::frames::Source;
use super::video;
use crate::source;
use crate::values::{Numbers, numbers};
use anyhow::Result;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use tsuya::Error;
use tsuya::ar::{LightSource, Placement};
use tsuya::lighting::{
    self, EnvironmentMap, EnvironmentProjection, EnvironmentReadOptions, FisheyeAxis, FisheyeModel, Unwrapper,
    raise_clipped, read_environment, turn_y,
};

/// Columns of the environments that light is taken from: those that stay, and those of sequences.
const COLUMNS: std::ops::RangeInclusive<usize> = 512..=2048;
const MOVING_COLUMNS: usize = 256;

#[derive(Args)]
#[command(next_help_heading = "Light")]
pub struct LightArguments {
    /// Light from all around: an image as of tsuya light fit, a bracket of several, a .tsuya file with light; or a folder or a video with
    /// one image for each frame.
    #[arg(long = "environment", visible_alias = "env", value_name = "PATH", required = true)]
    env: Vec<PathBuf>,
    /// How the images show the sphere [default: by their shape].
    #[arg(long = "environment-projection", alias = "env-projection", value_enum)]
    env_projection: Option<Shape>,
    /// Angle from edge to edge of a fisheye image, degrees.
    #[arg(long = "environment-field", alias = "env-field", value_name = "DEGREES", default_value_t = 180.0)]
    env_field: f64,
    /// The fisheye looks up, its image's lower edge to +Z; otherwise to +Z.
    #[arg(long = "environment-looks-up", alias = "env-looks-up")]
    env_looks_up: bool,
    /// Exposure of each image of a bracket.
    #[arg(long = "environment-exposures", alias = "env-exposures", value_name = "T,T,...", value_parser = numbers)]
    env_exposures: Option<Numbers>,
    /// Turns the environment about +Y, degrees.
    #[arg(
        long = "environment-rotation",
        alias = "env-rotation",
        value_name = "DEG",
        default_value_t = 0.0,
        allow_hyphen_values = true
    )]
    env_rotation: f64,
    /// Factor of its radiance.
    #[arg(long = "environment-scale", alias = "env-scale", value_name = "FACTOR", default_value_t = 1.0)]
    env_scale: f32,
    /// Factor of what 8-bit images cut off, such as lamps and the sun.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    lamp_gain: f32,
}

#[derive(Clone, Copy, ValueEnum)]
enum Shape {
    /// Latitude and longitude, 2:1.
    LatLong,
    /// A mirror ball that touches the image's edges.
    MirrorBall,
    /// Fisheye, distance proportional to the angle.
    Equidistant,
    /// Fisheye, equal areas for equal solid angles.
    Equisolid,
}

/// Light as it was given: one environment, or a sequence of them, `None` at its end.
pub enum LightInput {
    Still(Box<EnvironmentMap>),
    Moving(Option<NextLight>),
}

type NextLight = Box<dyn FnMut() -> tsuya::Result<Option<EnvironmentMap>>>;

impl LightInput {
    pub fn source(&self) -> LightSource<'_> {
        match self {
            LightInput::Still(environment) => LightSource::Fixed(environment),
            LightInput::Moving(_) => LightSource::PerFrame,
        }
    }

    /// The next frame's environment, if it has one of its own.
    pub fn next(&mut self) -> tsuya::Result<Option<EnvironmentMap>> {
        let LightInput::Moving(next) = self else { return Ok(None) };
        let environment = next.as_mut().map(|next| next()).transpose()?.flatten();
        if environment.is_none() {
            *next = None;
        }
        Ok(environment)
    }
}

impl LightArguments {
    fn projection(&self) -> Option<EnvironmentProjection> {
        let looks = if self.env_looks_up { FisheyeAxis::Up } else { FisheyeAxis::Ahead };
        let fisheye = |model| EnvironmentProjection::Fisheye { model, field_degrees: self.env_field, looks };
        self.env_projection.map(|shape| match shape {
            Shape::LatLong => EnvironmentProjection::LatLong,
            Shape::MirrorBall => EnvironmentProjection::MirrorBall,
            Shape::Equidistant => fisheye(FisheyeModel::Equidistant),
            Shape::Equisolid => fisheye(FisheyeModel::Equisolid),
        })
    }

    /// The light, in the object's axes.
    pub fn input(&self, placement: &Placement, ffmpeg: &Path) -> Result<LightInput> {
        let finite = self.env_scale.is_finite() && self.env_scale >= 0.0 && self.env_rotation.is_finite();
        if !(finite && self.lamp_gain.is_finite() && self.lamp_gain >= 1.0) {
            return Err(Error::parameter("--environment-scale is 0 or more, --lamp-gain 1 or more").into());
        }
        let (placement, rotation) = (*placement, self.env_rotation);
        let turn = move |d: [f64; 3]| turn_y(placement.to_world(d), -rotation);
        let (scale, gain) = (self.env_scale, self.lamp_gain);
        if let [path] = &self.env[..]
            && (path.is_dir() || video::is_video(path))
        {
            let mut source = Source::open(path, ffmpeg)?;
            let projection = self.projection();
            let path = path.clone();
            let mut unwrapper = None;
            let next = move || {
                let Some(plate) = source.next()? else { return Ok(None) };
                let mut picture = plate.to_linear();
                if matches!(plate, tsuya::ar::Plate::Display(_)) && gain > 1.0 {
                    raise_clipped(&mut picture, gain);
                }
                let size = [picture.width, picture.height];
                if unwrapper.is_none() {
                    let guessed = (size[0] == 2 * size[1]).then_some(EnvironmentProjection::LatLong);
                    let Some(projection) = projection.or(guessed) else {
                        let message = format!(
                            "pictures of {} x {} pixels: say how they show the sphere (--environment-projection)",
                            size[0], size[1]
                        );
                        return Err(Error::input(&path, message));
                    };
                    unwrapper = Some(Unwrapper::new(size, projection, MOVING_COLUMNS, turn)?);
                }
                let environment = unwrapper.as_ref().map(|unwrapper| unwrapper.environment(&picture)).transpose()?;
                Ok(environment.map(|environment| if scale == 1.0 { environment } else { environment.scaled(scale) }))
            };
            return Ok(LightInput::Moving(Some(Box::new(next))));
        }
        let environment = match &self.env[..] {
            [path] if source::has_extension(path, "tsuya") => {
                let stored: lighting::EnvironmentLobes = source::read_light(path)?;
                let none = || Error::input(path, "its light has no levels: tsuya light fit makes them");
                stored.environment().ok_or_else(none)?
            }
            paths => {
                let exposures = self.env_exposures.clone().map_or(Vec::new(), |numbers| numbers.0);
                let options = EnvironmentReadOptions {
                    projection: self.projection(),
                    exposures,
                    limits: source::limits(),
                    ..EnvironmentReadOptions::default()
                };
                let environment = read_environment(paths, &options)?.0;
                let display = paths.iter().all(|p| !["exr", "hdr"].iter().any(|e| source::has_extension(p, e)));
                if display && paths.len() == 1 && gain > 1.0 {
                    let mut image = environment.image().clone();
                    raise_clipped(&mut image, gain);
                    EnvironmentMap::new(image)?.0
                } else {
                    environment
                }
            }
        };
        let image = environment.image();
        let columns = image.width.clamp(*COLUMNS.start(), *COLUMNS.end());
        // Larger ones are averaged, not skipped over.
        let environment = if image.width > columns { environment.resized(columns, columns / 2) } else { environment };
        let image = environment.image();
        let unwrapper = Unwrapper::new([image.width, image.height], EnvironmentProjection::LatLong, columns, turn)?;
        Ok(LightInput::Still(Box::new(unwrapper.environment(image)?.scaled(scale))))
    }
}
