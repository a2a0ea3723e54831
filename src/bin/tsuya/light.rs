//! `tsuya light`: environments made ready for shading.

use crate::source::limits;
use crate::{output, progress, source, values};
use anyhow::{Context, Result};
use clap::{Args, Subcommand, ValueEnum};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::container::{self, ContainerWriter, SectionCodec, Tag};
use tsuya::lighting;
use tsuya::lighting::{
    EnvironmentMap, EnvironmentProjection, EnvironmentReadOptions, FisheyeAxis, FisheyeModel, LobeFitOptions,
    read_environment,
};

/// Environments as light: fits lobes and prefilters levels.
#[derive(Args)]
pub struct Light {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Fit(Box<Fit>),
}

impl Light {
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Fit(fit) => fit.run(),
        }
    }
}

/// Fits an environment: spherical Gaussians for diffuse reflection, prefiltered levels for specular reflection.
///
/// Several images of different exposure are merged. World axes: +Y up; the middle of a latitude-longitude image is +Z, a
/// quarter from its left edge is +X.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya light fit museum.exr -o museum.tsuya",
))]
pub struct Fit {
    /// Images of the environment: EXR, HDR, PNG, JPEG, TIFF.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// The .tsuya file to write; - is standard output. Without it only the figures are printed.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// A .tsuya file whose other sections the written one keeps.
    #[arg(long, value_name = "FILE")]
    asset: Option<PathBuf>,
    /// A .tsuya file with the light of a similar environment (the frame before), from which the fit starts.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Lobes of the diffuse part, 1 to 64.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=64))]
    lobes: u16,
    /// Cells along a side of the sharpest level, 8 to 1024.
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u16).range(8..=1024))]
    level_size: u16,
    /// Step of the stored levels in 1/64 of a doubling; smaller is better and longer.
    #[arg(long, value_name = "STEP", default_value_t = 3.0)]
    step: f32,
    /// Columns that the environment is brought to first [default: as many as the image's detail needs].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(4..=8192))]
    width: Option<u16>,
    /// How an image shows the sphere [default: by its shape].
    #[arg(long, value_enum)]
    projection: Option<Shape>,
    /// Angle from edge to edge of a fisheye image, in degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0)]
    field: f64,
    /// A fisheye lens looks to the zenith, not ahead.
    #[arg(long)]
    looks_up: bool,
    /// Exposure of each image, in seconds or anything proportional to the light let in.
    #[arg(long, value_name = "T,T,...", value_parser = values::numbers)]
    exposures: Option<values::Numbers>,
    /// Colour space of PNG, JPEG and TIFF images [default: srgb].
    #[arg(long, value_name = "NAME")]
    color_space: Option<String>,
    /// Turns the environment about +Y, in degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    rotation_y: f64,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

/// Projections by name.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Shape {
    /// Latitude and longitude, 2:1.
    LatLong,
    /// Cube: a cross or a strip of six squares.
    Cube,
    /// A mirror ball that touches the image's edges.
    MirrorBall,
    /// Fisheye, distance proportional to the angle.
    Equidistant,
    /// Fisheye, equal areas for equal solid angles.
    Equisolid,
}

/// Directions in which the levels' error is measured.
const DIRECTIONS: usize = 32;

impl Fit {
    pub fn run(self) -> Result<()> {
        if let Some(path) = &self.output {
            let pictures: Vec<&Path> = self.pictures.iter().map(PathBuf::as_path).collect();
            output::check_outputs(&[path], &pictures, self.force)?;
        }
        let (environment, cleaned) = read_environment(&self.pictures, &self.read_options())?;
        let environment = match self.rotation_y {
            0.0 => environment,
            degrees => environment.rotated_y(degrees),
        };
        let mut warnings = Vec::new();
        if cleaned.negative + cleaned.not_finite > 0 {
            let (negative, not_finite) = (cleaned.negative, cleaned.not_finite);
            warnings
                .push(format!("{negative} pixels with negative and {not_finite} without finite values were replaced"));
        }
        output::warn(&warnings);
        let previous = self.from.as_deref().map(source::read_light).transpose()?;
        let busy = progress::busy("fitting light");
        let start = Instant::now();
        let options = LobeFitOptions { lobes: self.lobes.into(), ..Default::default() };
        let diffuse = lighting::fit(&environment, &options, previous.as_ref().map(|light| &light.diffuse[..]));
        let diffuse_seconds = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let levels = lighting::prefiltered_maps(&environment, self.level_size.into());
        let levels_seconds = start.elapsed().as_secs_f64();
        let (bytes, light) = lighting::encode(
            &lighting::EnvironmentLobes { diffuse, prefiltered: levels },
            &lighting::LightCodingOptions { step: self.step },
        )?;
        let figures = Figures::new(&environment, &light, [diffuse_seconds, levels_seconds], bytes.len());
        drop(busy);
        let Some(path) = &self.output else { return figures.report(self.json) };
        let section = (Tag::LIGHT, SectionCodec::Own, bytes);
        let file = match &self.asset {
            Some(asset) => container::with_sections(&source::read(asset)?, &[section], limits())
                .with_context(|| source::name(asset))?,
            None => {
                let mut writer = ContainerWriter::new(Vec::new())?;
                writer.write_section(section.0, section.1, &section.2)?;
                writer.finish()?
            }
        };
        output::write(path, &file, self.force)?;
        // The figures must not get into the file.
        if output::is_stream(path) { Ok(()) } else { figures.report(self.json) }
    }

    fn read_options(&self) -> EnvironmentReadOptions {
        let fisheye = |model| EnvironmentProjection::Fisheye {
            model,
            field_degrees: self.field,
            looks: if self.looks_up { FisheyeAxis::Up } else { FisheyeAxis::Ahead },
        };
        EnvironmentReadOptions {
            projection: self.projection.map(|shape| match shape {
                Shape::LatLong => EnvironmentProjection::LatLong,
                Shape::Cube => EnvironmentProjection::Cube,
                Shape::MirrorBall => EnvironmentProjection::MirrorBall,
                Shape::Equidistant => fisheye(FisheyeModel::Equidistant),
                Shape::Equisolid => fisheye(FisheyeModel::Equisolid),
            }),
            width: self.width.map(usize::from),
            color_space: self.color_space.clone(),
            exposures: self.exposures.clone().map_or(Vec::new(), |numbers| numbers.0),
            limits: limits(),
        }
    }
}

/// What is reported.
struct Figures {
    seconds: [f64; 2],
    diffuse_error: f64,
    level_errors: Vec<f64>,
    sharpness: Vec<f64>,
    lobes: usize,
    bytes: usize,
}

impl Figures {
    fn new(environment: &EnvironmentMap, light: &lighting::EnvironmentLobes, seconds: [f64; 2], bytes: usize) -> Self {
        Figures {
            seconds,
            diffuse_error: lighting::irradiance_error(environment, &light.diffuse),
            level_errors: lighting::prefiltered_errors(environment, &light.prefiltered, DIRECTIONS),
            sharpness: light.prefiltered.iter().map(|level| level.sharpness()).collect(),
            lobes: light.diffuse.len(),
            bytes,
        }
    }
    /// Root mean square over the levels.
    fn levels_error(&self) -> f64 {
        let squared: f64 = self.level_errors.iter().map(|e| e * e).sum();
        (squared / self.level_errors.len().max(1) as f64).sqrt()
    }
    fn report(&self, as_json: bool) -> Result<()> {
        if as_json {
            return output::print_json(&json!({
                "diffuse_seconds": self.seconds[0],
                "levels_seconds": self.seconds[1],
                "diffuse_error": self.diffuse_error,
                "levels_error": self.levels_error(),
                "lobes": self.lobes,
            }));
        }
        let mut text = format!(
            "{} lobes in {:.3} s, error of the irradiance {:.2} %\nlevels in {:.2} s, {} bytes together\n",
            self.lobes,
            self.seconds[0],
            100.0 * self.diffuse_error,
            self.seconds[1],
            self.bytes
        );
        for (sharpness, error) in self.sharpness.iter().zip(&self.level_errors) {
            let _ = writeln!(text, "  sharpness {sharpness:5}: error {:.2} %", 100.0 * error);
        }
        output::tell(&text)
    }
}
