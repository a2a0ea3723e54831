//! `tsuya ar`: an object in the images of a camera that sees a marker.

mod frames;
mod light;
mod video;

use crate::surroundings::{self, JobAsset};
use crate::values::triple;
use crate::{Failed, output, source};
use anyhow::Result;
use clap::Args;
use frames::{Sink, Source};
use indicatif::{ProgressBar, ProgressStyle};
use light::LightArguments;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::View;
use tsuya::ar::{ArObject, ArOptions, FrameReport, FrameTimes, Placement, RenderMode, RigMount, Session};
use tsuya::capture::Calibration;
use tsuya::decoder::ViewSelection;
use tsuya::image::Mask;
use tsuya::marker::Rig;
use tsuya::relight::{AssetRenderer, AssetShading, RenderObject};
use tsuya::{Asset, container::metres_per_unit};
use tsuya::{Error, capture};

/// Puts an object into a photograph, a folder of frames or a video, where a marker lies.
///
/// The marker gives the place, an environment the light; the ground is darkened by the object's shadow. World axes: +Y up, the marker's
/// middle at the origin, in the unit of the marker's size.
#[derive(Args)]
pub struct Ar {
    /// A photograph, a folder of frames, or a video (read by ffmpeg).
    frames: PathBuf,
    /// The object, best with its visibility (tsuya bake). One; for another run it again on the images that were made.
    #[arg(long, help_heading = "Object and camera", value_name = "FILE")]
    asset: PathBuf,
    /// The marker, FAMILY:ID:SIZE as in tag36h11:76:0.065 (* for any number), or a JSON file with several that belong together.
    /// Families: tag36h11, tag25h9, tag16h5, tagStandard41h12, aruco, aruco-mip-36h12, and OpenCV's aruco-4x4-50 to aruco-7x7-1000.
    #[arg(long, help_heading = "Object and camera", value_name = "MARKER")]
    marker: String,
    /// The camera's calibration: OpenCV or ROS YAML, or JSON.
    #[arg(long, help_heading = "Object and camera", value_name = "FILE")]
    camera: PathBuf,
    #[command(flatten)]
    light: LightArguments,
    #[command(flatten)]
    placement: PlacementArguments,
    #[command(flatten)]
    render: RenderArguments,
    /// What is in front of the object: an image, white where; or a folder with one for each frame.
    #[arg(long, value_name = "PATH")]
    occlusion: Option<PathBuf>,
    /// Where the images go: .png or .exr for a photograph, a folder, or a video (.mp4, .mkv, ..., written by ffmpeg).
    #[arg(short, long, help_heading = "Output", value_name = "PATH")]
    output: PathBuf,
    /// Frames a second of a video made of a folder [default: 30].
    #[arg(long, help_heading = "Output", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: Option<u32>,
    /// The program that reads and writes videos.
    #[arg(long, help_heading = "Output", value_name = "PATH", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Overwrites existing images.
    #[arg(long, help_heading = "Output")]
    force: bool,
    /// Prints poses and times as JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Args)]
#[command(next_help_heading = "Rendering")]
struct RenderArguments {
    /// Exact shadows and all detail in every frame of a sequence, too: slow. A single photograph has them anyway.
    #[arg(long, alias = "still")]
    offline: bool,
    /// Samples of a pixel along each side, 1 to 8 [default: 3 offline, 2 otherwise].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: Option<u32>,
    /// Takes the environment's radiance as it is; otherwise exposure and white balance are those of the marker's paper.
    #[arg(long, alias = "no-match")]
    no_exposure_match: bool,
    /// Brightens the object by this many stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true)]
    exposure: f64,
    /// Standard deviation of the camera's noise, of 255 [default: as measured in each frame].
    #[arg(long, value_name = "CODES")]
    noise: Option<f32>,
    /// Casts no shadow on the ground.
    #[arg(long)]
    no_shadow: bool,
}

#[derive(Args)]
#[command(next_help_heading = "Placement")]
struct PlacementArguments {
    /// The marker stands upright; otherwise it lies on the ground.
    #[arg(long)]
    upright: bool,
    /// The point of the ground where the object stands, in the unit of the marker's size: x to the right on the print, y up, z towards its lower edge (upright: out
    /// of it).
    #[arg(long, alias = "at", value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    translate: [f64; 3],
    /// Turns the object about +Y, counter-clockwise from above, degrees.
    #[arg(long, alias = "turn", value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    rotate_y: f64,
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
        let quality =
            if self.render.offline || source.is_single() { RenderMode::Offline } else { RenderMode::Realtime };
        let still = quality == RenderMode::Offline;
        let options = self.options(quality)?;

        let bar = progress(&source);
        bar.set_message("reading the object");
        let selection = if still { ViewSelection::All } else { ViewSelection::None };
        let subject = JobAsset::Asset(Box::new(source::decode(&self.asset, selection)?.0));
        let JobAsset::Asset(asset) = &subject else { return Ok(()) };
        let placement = self.placement.placement(asset, &rig)?;
        let occlusion = surroundings::occlusion(&subject)?;
        let shading = AssetShading::new(asset, options.taps)?;
        let renderer = if still { Some(AssetRenderer::new(asset)?) } else { None };
        let object = ArObject {
            object: RenderObject::of_asset(asset, Some(&occlusion))?,
            shading: &shading,
            placement,
            detail: renderer.as_ref().map(|renderer| (renderer, &**asset)),
        };
        let mut masks = Masks::open(self.occlusion.as_deref(), &self.ffmpeg)?;
        bar.set_message("frames");

        let mut work = Work { frames: Vec::new(), reading: 0.0, writing: 0.0 };
        let single = source.is_single();
        let described = rig.describe();
        let mut light = self.light.input(&placement, &self.ffmpeg)?;
        let clock = Instant::now();
        let mut upcoming = source.next()?;
        work.reading += clock.elapsed().as_secs_f64();
        // All frames are upright, and so is the calibration.
        let orientation = source.orientation();
        let calibration = match &upcoming {
            Some(plate) => calibration.upright(orientation, plate.size()),
            None => calibration,
        };
        let mut session = Session::new(&object, &calibration, rig, light.source(), options)?;
        while let Some(mut plate) = upcoming.take() {
            let clock = Instant::now();
            let [width, height] = plate.size();
            let name = source.name(work.frames.len());
            calibration.check_size(&self.camera, Path::new(&name), width, height)?;
            if source.orientation() != orientation {
                let (first, this) = (orientation.to_exif(), source.orientation().to_exif());
                let message = format!("its orientation (EXIF {this}) is not the first frame's (EXIF {first})");
                return Err(Error::input(&name, message).into());
            }
            let nearer = masks.next()?;
            work.reading += clock.elapsed().as_secs_f64();
            let environment = light.next()?;
            let report = session.frame(&mut plate, nearer, environment.as_ref())?;
            let clock = Instant::now();
            work.frames.push(report);
            // A photograph without its object is no result.
            if !(single && report.estimate.is_none()) {
                sink.put(&plate, &source, report.frame)?;
            }
            work.writing += clock.elapsed().as_secs_f64();
            bar.inc(1);
            let clock = Instant::now();
            upcoming = source.next()?;
            work.reading += clock.elapsed().as_secs_f64();
        }
        output::warn(&source.remarks());
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
        if self.render.noise.is_some_and(|sigma| !(0.0..=100.0).contains(&sigma)) {
            return Err(Error::parameter("--noise is 0 to 100 of 255").into());
        }
        let (samples, taps) = match quality {
            RenderMode::Offline => (3, 24),
            RenderMode::Realtime => (2, 7),
        };
        Ok(ArOptions {
            mount: if self.placement.upright { RigMount::BesideMarker } else { RigMount::OnMarker },
            mode: quality,
            samples: self.render.samples.unwrap_or(samples),
            taps,
            match_white: !self.render.no_exposure_match,
            gain: self.render.exposure.exp2() as f32,
            noise: self.render.noise,
            shadow: !self.render.no_shadow,
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
        Ok(Placement::on_ground(&asset.mesh, upright, self.rotate_y, scale, self.translate)?)
    }
}

/// What is in front of the object, frame by frame; the last mask stays.
struct Masks {
    source: Option<Source>,
    last: Option<Mask>,
}

impl Masks {
    fn open(path: Option<&Path>, ffmpeg: &Path) -> Result<Self> {
        Ok(Masks { source: path.map(|path| Source::open(path, ffmpeg)).transpose()?, last: None })
    }

    fn next(&mut self) -> tsuya::Result<Option<&Mask>> {
        if let Some(plate) = self.source.as_mut().map(Source::next).transpose()?.flatten() {
            self.last = Some(plate.to_display().map(|p| p[0].max(p[1]).max(p[2]) >= 128));
        }
        Ok(self.last.as_ref())
    }
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
