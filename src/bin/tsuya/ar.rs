//! `tsuya ar`: an object in the pictures of a camera that sees a marker.

mod frames;
mod video;

use crate::surroundings::{self, JobAsset};
use crate::values::{Numbers, numbers, triple};
use crate::{Failed, output, source};
use anyhow::Result;
use clap::{Args, ValueEnum};
use frames::{Sink, Source};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::View;
use tsuya::ar::{ArFrame, ArOptions, FrameReport, FrameTimes, LightSource, Placement, RenderMode, RigMount, run};
use tsuya::capture::Calibration;
use tsuya::decoder::ViewSelection;
use tsuya::image::Mask;
use tsuya::lighting::{
    self, EnvironmentMap, EnvironmentProjection, EnvironmentReadOptions, FisheyeAxis, FisheyeModel, Unwrapper,
    raise_clipped, read_environment, turn_y,
};
use tsuya::marker::Rig;
use tsuya::relight::{AssetRenderer, AssetShading};
use tsuya::{Asset, container::metres_per_unit};
use tsuya::{Error, capture};

/// Columns of the environments that light is taken from: those that stay, and those of sequences.
const COLUMNS: std::ops::RangeInclusive<usize> = 512..=2048;
const MOVING_COLUMNS: usize = 256;

/// Puts an object into a photograph, a folder of frames or a video, where a marker lies.
///
/// The marker gives the place, an environment the light; the ground is darkened by the object's shadow. World axes: +Y up, the marker's
/// middle at the origin, in the unit of the marker's size.
#[derive(Args)]
pub struct Ar {
    /// A photograph, a folder of frames, or a video (read by ffmpeg).
    frames: PathBuf,
    /// The object, best with its visibility (tsuya bake). One; for another run it again on the pictures that were made.
    #[arg(long, value_name = "FILE")]
    asset: PathBuf,
    /// The marker, FAMILY:ID:SIZE as in tag36h11:76:0.065 (* for any number), or a JSON file with several that belong together.
    /// Families: tag36h11, tag25h9, tag16h5, tagStandard41h12, aruco, aruco-mip-36h12.
    #[arg(long, value_name = "MARKER")]
    marker: String,
    /// The camera's calibration: OpenCV or ROS YAML, or JSON.
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    #[command(flatten)]
    light: LightArguments,
    #[command(flatten)]
    place: PlacementArguments,
    /// What is in front of the object: a picture, white where; or a folder with one for each frame.
    #[arg(long, value_name = "PATH")]
    occlusion: Option<PathBuf>,
    /// Where the pictures go: .png or .exr for a photograph, a folder, or a video (.mp4, .mkv, ..., written by ffmpeg).
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Exact shadows and all detail in every frame of a sequence, too: slow. A single photograph has them anyway.
    #[arg(long)]
    still: bool,
    /// Samples of a pixel along each side, 1 to 8 [default: 3 for stills, 2 in motion].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: Option<u32>,
    /// Takes the environment's radiance as it is; otherwise exposure and white balance are those of the marker's paper.
    #[arg(long)]
    no_match: bool,
    /// The object brighter by this many stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true)]
    exposure: f64,
    /// Standard deviation of the camera's noise, of 255 [default: as measured in each frame].
    #[arg(long, value_name = "CODES")]
    noise: Option<f32>,
    /// The object casts no shadow.
    #[arg(long)]
    no_shadow: bool,
    /// Frames a second of a video made of a folder [default: 30].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: Option<u32>,
    /// The program that reads and writes videos.
    #[arg(long, value_name = "PATH", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Overwrites existing pictures.
    #[arg(long)]
    force: bool,
    /// Prints poses and times as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct LightArguments {
    /// Light from all around: a picture as of tsuya light fit, a bracket of several, a .tsuya file with light; or a folder or a video with
    /// one picture for each frame.
    #[arg(long, value_name = "PATH", required = true)]
    env: Vec<PathBuf>,
    /// How the pictures show the sphere [default: by their shape].
    #[arg(long, value_enum)]
    env_projection: Option<Shape>,
    /// Angle from edge to edge of a fisheye picture, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0)]
    env_field: f64,
    /// The fisheye looks up, its picture's lower edge to +Z; otherwise to +Z.
    #[arg(long)]
    env_looks_up: bool,
    /// Exposure of each picture of a bracket.
    #[arg(long, value_name = "T,T,...", value_parser = numbers)]
    env_exposures: Option<Numbers>,
    /// Turns the environment about +Y, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotation: f64,
    /// Factor of its radiance.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    env_scale: f32,
    /// Factor of what 8-bit pictures cut off, such as lamps and the sun.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    lamp_gain: f32,
}

#[derive(Clone, Copy, ValueEnum)]
enum Shape {
    /// Latitude and longitude, 2:1.
    LatLong,
    /// A mirror ball that touches the picture's edges.
    MirrorBall,
    /// Fisheye, distance proportional to the angle.
    Equidistant,
    /// Fisheye, equal areas for equal solid angles.
    Equisolid,
}

#[derive(Args)]
struct PlacementArguments {
    /// The marker stands upright; otherwise it lies on the ground.
    #[arg(long)]
    upright: bool,
    /// The point of the ground where the object stands, in the unit of the marker's size: x to the right on the print, y up, z towards its lower edge (upright: out
    /// of it).
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    at: [f64; 3],
    /// Turns it, counter-clockwise from above, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    turn: f64,
    /// Length of the file's unit in the unit of the marker's size [default: metres by the file's units, else so that its longest side is the
    /// marker's].
    #[arg(long, value_name = "FACTOR", conflicts_with = "size")]
    scale: Option<f64>,
    /// Length of its longest side, in the unit of the marker's size.
    #[arg(long, value_name = "LENGTH")]
    size: Option<f64>,
}

impl Ar {
    pub fn run(self) -> Result<()> {
        let began = Instant::now();
        let calibration = capture::read_calibration(&self.camera, &source::access())?;
        let rig = if self.marker.contains(':') && !Path::new(&self.marker).exists() {
            Rig::parse(&self.marker)?
        } else {
            Rig::read(&self.marker, &source::access())?
        };
        let mut source = Source::open(&self.frames, &self.ffmpeg)?;
        let rate = self.rate.map(|rate| [rate, 1]);
        let mut sink = Sink::create(&self.output, &source, rate, &self.ffmpeg, self.force)?;
        let quality = if self.still || source.is_single() { RenderMode::Offline } else { RenderMode::Realtime };
        let still = quality == RenderMode::Offline;
        let options = self.options(quality)?;

        let bar = progress(&source);
        bar.set_message("reading the object");
        let selection = if still { ViewSelection::All } else { ViewSelection::None };
        let subject = JobAsset::Asset(Box::new(source::decode(&self.asset, selection)?.0));
        let JobAsset::Asset(asset) = &subject else { return Ok(()) };
        let placement = self.place.placement(asset, &rig)?;
        let occlusion = surroundings::occlusion(&subject)?;
        let look = AssetShading::new(asset, options.taps)?;
        let renderer = if still { Some(AssetRenderer::new(asset)?) } else { None };
        let stands = tsuya::ar::ArObject {
            mesh: &asset.mesh,
            occlusion: &occlusion,
            look: &look,
            placement,
            detail: renderer.as_ref().map(|renderer| (renderer, &**asset)),
        };
        let masks = self.occlusion.as_deref().map(|path| Source::open(path, &self.ffmpeg)).transpose()?;
        let masks = std::cell::RefCell::new(masks.map(|source| (source, None)));
        bar.set_message("frames");

        let mut work = Work { frames: Vec::new(), reading: 0.0, writing: 0.0 };
        let single = source.is_single();
        // Both ways through the frames use the source.
        let source_cell = std::cell::RefCell::new(&mut source);
        let reading = std::cell::Cell::new(0.0);
        let mut next = || {
            let clock = Instant::now();
            let mut source = source_cell.borrow_mut();
            let path = source.upcoming().map(Path::to_owned);
            let Some(plate) = source.next()? else { return Ok(None) };
            let [width, height] = plate.size();
            calibration.check_size(&self.camera, path.as_deref().unwrap_or(&self.frames), width, height)?;
            let nearer = match masks.borrow_mut().as_mut() {
                Some((masks, last)) => next_mask(masks, last)?,
                None => None,
            };
            reading.set(reading.get() + clock.elapsed().as_secs_f64());
            Ok(Some(ArFrame { plate, nearer }))
        };
        let mut done = |plate: tsuya::ar::Plate, done: &FrameReport| {
            let clock = Instant::now();
            work.frames.push(*done);
            // A photograph without its object is no result.
            if !(single && done.estimate.is_none()) {
                sink.put(&plate, &source_cell.borrow(), done.frame)?;
            }
            work.writing += clock.elapsed().as_secs_f64();
            bar.inc(1);
            Ok(())
        };
        let described = rig.describe();
        let mut light_source = self.light.source(&placement, &self.ffmpeg)?;
        let light = match &mut light_source {
            LightInput::Still(environment) => LightSource::Fixed(environment),
            LightInput::Moving(next) => LightSource::PerFrame(next),
        };
        run(&stands, &calibration, rig, light, &options, &mut next, &mut done)?;
        work.reading = reading.get();
        bar.finish_and_clear();

        let missing: Vec<usize> = work.frames.iter().filter(|d| d.estimate.is_none()).map(|d| d.frame).collect();
        if missing.len() == work.frames.len() {
            let place = if single { source.name(0) } else { format!("any of the {} frames", work.frames.len()) };
            return Err(Failed(format!(
                "no marker {described} in {place}: it must be wholly in the picture with its white margin, and of this family and number"
            ))
            .into());
        }
        sink.finish()?;
        if let Some(first) = missing.first() {
            let message = format!(
                "{} of {} frames show no marker {described} (the first: {}); they are as they were",
                missing.len(),
                work.frames.len(),
                source.name(*first)
            );
            output::warn(&[message]);
        }
        work.report(&source, &calibration, began.elapsed().as_secs_f64(), self.json)
    }

    fn options(&self, quality: RenderMode) -> Result<ArOptions> {
        if self.noise.is_some_and(|sigma| !(0.0..=100.0).contains(&sigma)) {
            return Err(Error::parameter("--noise is 0 to 100 of 255").into());
        }
        let (samples, taps) = match quality {
            RenderMode::Offline => (3, 24),
            RenderMode::Realtime => (2, 7),
        };
        Ok(ArOptions {
            mount: if self.place.upright { RigMount::BesideMarker } else { RigMount::OnMarker },
            mode: quality,
            samples: self.samples.unwrap_or(samples),
            taps,
            match_white: !self.no_match,
            gain: self.exposure.exp2() as f32,
            noise: self.noise,
            shadow: !self.no_shadow,
        })
    }
}

impl PlacementArguments {
    fn placement(&self, asset: &Asset, rig: &Rig) -> Result<Placement> {
        let upright = View::upright_rotation(&asset.views);
        let measured = Placement::on_ground(&asset.mesh, upright, 0.0, 1.0, [0.0; 3])?;
        let points = || asset.mesh.positions.iter().map(|p| measured.to_world(p.map(f64::from)));
        let extent = |k: usize| {
            let (low, high) = points().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p[k]), high.max(p[k])));
            high - low
        };
        let longest = (0..3).map(extent).fold(0.0, f64::max).max(1e-30);
        let has_units =
            asset.metadata.get("units").and_then(|u| u.as_str()).is_some_and(|u| ["mm", "cm", "m"].contains(&u));
        let scale = match (self.scale, self.size) {
            (Some(scale), _) => scale,
            (None, Some(length)) => length / longest,
            (None, None) if has_units => metres_per_unit(&asset.metadata),
            (None, None) => rig.markers.first().map_or(1.0, |m| m.size) / longest,
        };
        Ok(Placement::on_ground(&asset.mesh, upright, self.turn, scale, self.at)?)
    }
}

type NextLight = Box<dyn FnMut() -> tsuya::Result<Option<EnvironmentMap>>>;

enum LightInput {
    Still(Box<EnvironmentMap>),
    Moving(NextLight),
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
    fn source(&self, placement: &Placement, ffmpeg: &Path) -> Result<LightInput> {
        let finite = self.env_scale.is_finite() && self.env_scale >= 0.0 && self.env_rotation.is_finite();
        if !(finite && self.lamp_gain.is_finite() && self.lamp_gain >= 1.0) {
            return Err(Error::parameter("--env-scale is 0 or more, --lamp-gain 1 or more").into());
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
                            "pictures of {} x {} pixels: say how they show the sphere (--env-projection)",
                            size[0], size[1]
                        );
                        return Err(Error::input(&path, message));
                    };
                    unwrapper = Some(Unwrapper::new(size, projection, MOVING_COLUMNS, turn)?);
                }
                let environment = unwrapper.as_ref().map(|unwrapper| unwrapper.environment(&picture)).transpose()?;
                Ok(environment.map(|environment| if scale == 1.0 { environment } else { environment.scaled(scale) }))
            };
            return Ok(LightInput::Moving(Box::new(next)));
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

/// The next frame's mask; the last one stays.
fn next_mask(masks: &mut Source, last: &mut Option<Mask>) -> tsuya::Result<Option<Mask>> {
    if let Some(plate) = masks.next()? {
        *last = Some(plate.to_display().map(|p| p[0].max(p[1]).max(p[2]) >= 128));
    }
    Ok(last.clone())
}

fn progress(source: &Source) -> ProgressBar {
    let bar = match source.count() {
        Some(count) => ProgressBar::new(count as u64),
        None => ProgressBar::new_spinner(),
    };
    let template = match source.count() {
        Some(_) => "{msg} {wide_bar} {pos}/{len}, {per_sec}",
        None => "{spinner} {msg} {pos}, {per_sec}",
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// What was done, for the report.
struct Work {
    frames: Vec<FrameReport>,
    reading: f64,
    writing: f64,
}

impl Work {
    fn report(&self, source: &Source, calibration: &Calibration, seconds: f64, as_json: bool) -> Result<()> {
        let seen: Vec<&FrameReport> = self.frames.iter().filter(|d| d.estimate.is_some()).collect();
        let count = seen.len().max(1) as f64;
        let mean = |part: fn(&FrameTimes) -> f64| seen.iter().map(|d| part(&d.times)).sum::<f64>() / count;
        let parts = [mean(|t| t.pose), mean(|t| t.light), mean(|t| t.render), mean(|t| t.composite)];
        let all = self.frames.len().max(1) as f64;
        let (reading, writing) = (self.reading / all, self.writing / all);
        let rms = seen.iter().filter_map(|d| d.estimate).map(|e| e.rms_pixels).sum::<f64>() / count;
        if as_json {
            let poses: Vec<_> = (self.frames.iter())
                .map(|d| {
                    json!({
                        "frame": source.name(d.frame),
                        "rotation": d.estimate.map(|e| e.pose.rotation),
                        "translation": d.estimate.map(|e| e.pose.translation),
                        "rms_pixels": d.estimate.map(|e| e.rms_pixels),
                        "max_pixels": d.estimate.map(|e| e.max_pixels),
                        "markers": d.estimate.map_or(0, |e| e.markers),
                        "gain": d.gain,
                        "noise": d.noise,
                    })
                })
                .collect();
            return output::print_json(&json!({
                "frames": self.frames.len(),
                "with_marker": seen.len(),
                "size": [calibration.camera.width, calibration.camera.height],
                "seconds": seconds,
                "frame_seconds": {
                    "whole": mean(|t| t.whole), "read": reading, "pose": parts[0], "light": parts[1], "render": parts[2], "composite": parts[3], "write": writing,
                },
                "poses": poses,
            }));
        }
        let [pose, light, render, composite] = parts.map(|s| 1e3 * s);
        let whole = mean(|t| t.whole);
        output::print(&format!(
            "{} of {} frames with the object, corners {rms:.2} pixels off\n\
             a frame: pose {pose:.1} ms, light {light:.1} ms, render {render:.1} ms, composite {composite:.1} ms; {:.1} frames a second\n\
             and {:.1} ms reading, {:.1} ms writing\n",
            seen.len(),
            self.frames.len(),
            1.0 / whole.max(1e-9),
            1e3 * reading,
            1e3 * writing
        ))
    }
}
