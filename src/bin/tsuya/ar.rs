//! `tsuya ar`: an object in the images of a camera that sees a marker.

mod frames;
mod light;
mod objects;
mod report;
mod sinks;
mod video;

use crate::{Failed, output, source};
use anyhow::Result;
use clap::Args;
use frames::Source;
use indicatif::{ProgressBar, ProgressStyle};
use light::{LightArguments, LightInput};
use objects::{Objects, PlacementArguments};
use report::Work;
use sinks::Sink;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::ar::{ArObject, ArOptions, RenderMode, RigMount, Session};
use tsuya::capture::Calibration;
use tsuya::image::{ImageOrientation, Mask};
use tsuya::marker::Rig;
use tsuya::{Error, capture};

/// Puts objects into a photograph, a folder of frames or a video, where a marker lies.
///
/// The marker gives the place, an environment the light; the ground is darkened by the object's shadow. World axes: +Y up, the marker's
/// middle at the origin, in the unit of the marker's size.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya ar table.jpg --asset vase.tsuya --marker tag36h11:0:0.08 --camera phone.yaml \\\n",
    "    --environment room.hdr -o placed.png\n",
    "  tsuya ar shot.mp4 --asset vase.tsuya --marker rig.json --camera phone.yaml \\\n",
    "    --environment room.hdr -o placed.mp4",
))]
pub struct Ar {
    /// A photograph, a folder of frames, or a video (read by ffmpeg; .y4m without it); - is a video on standard input, YUV4MPEG2 of 8 bits.
    frames: PathBuf,
    /// The object, best with its visibility (tsuya bake). Several stand on one ground and shadow each other; their visibility is computed anew.
    #[arg(long, help_heading = "Object and camera", value_name = "FILE", required = true)]
    asset: Vec<PathBuf>,
    /// The marker, FAMILY:ID:SIZE as in tag36h11:76:0.065 (* for any number), or a JSON file with several that belong together.
    /// Families: tag36h11, tag25h9, tag16h5, tagStandard41h12, aruco, aruco-mip-36h12, OpenCV's aruco-4x4-50 to aruco-7x7-1000,
    /// artoolkit-3x3 (barcodes), and artoolkit, whose ID is a pattern file: artoolkit:patt.hiro:80. Several times: one for each object, in their order; objects on one marker shadow
    /// each other, those on different ones only hide each other.
    #[arg(long, help_heading = "Object and camera", value_name = "MARKER", required = true)]
    marker: Vec<String>,
    /// Width of the black border of artoolkit markers over their side [default: 0.25].
    #[arg(long, help_heading = "Object and camera", value_name = "SHARE")]
    marker_border: Option<f64>,
    /// Least likeness of artoolkit markers to their pattern, 0 to 1 [default: 0.6].
    #[arg(long, help_heading = "Object and camera", value_name = "NUMBER")]
    marker_confidence: Option<f64>,
    /// The camera's calibration: OpenCV or ROS YAML, JSON, or ARToolKit's camera_para.dat.
    #[arg(long, help_heading = "Object and camera", value_name = "FILE")]
    camera: PathBuf,
    /// The images are the calibrated ones made smaller or larger: scales the calibration to them.
    #[arg(long, help_heading = "Object and camera")]
    scale_camera: bool,
    #[command(flatten)]
    light: LightArguments,
    #[command(flatten)]
    placement: PlacementArguments,
    #[command(flatten)]
    render: RenderArguments,
    /// What is in front of the object: an image, white where; or a folder with one for each frame.
    #[arg(long, value_name = "PATH")]
    occlusion: Option<PathBuf>,
    /// Where the images go: .png or .exr for a photograph, a folder, or a video (.mp4, .mkv, ..., written by ffmpeg; .y4m without it); - is
    /// standard output, as YUV4MPEG2, frame by frame.
    #[arg(short, long, help_heading = "Output", value_name = "PATH")]
    output: PathBuf,
    /// Frames a second of a video [default: those of the frames, 30 of a folder].
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

impl Ar {
    pub fn run(self) -> Result<()> {
        let began = Instant::now();
        let streams = self.asset.iter().chain([&self.frames]).filter(|path| output::is_stream(path)).count();
        if streams > 1 {
            return Err(Error::parameter("standard input is one thing: the frames or an object").into());
        }
        let access = source::access();
        let calibration = capture::read_calibration(&self.camera, &access)?;
        output::warn(&access.remarks());
        let rigs = self.rigs()?;
        let mut source = Source::open_frames(&self.frames, &self.ffmpeg)?;
        let rate = self.rate.map(|rate| [rate, 1]);
        let mut sink = Sink::create(&self.output, &source, rate, &self.ffmpeg, self.force)?;
        let quality =
            if self.render.offline || source.is_single() { RenderMode::Offline } else { RenderMode::Realtime };
        let still = quality == RenderMode::Offline;
        let options = self.options(quality)?;

        let bar = progress(&source);
        bar.set_message("reading the object");
        let read = |(rig, which): &(Rig, Vec<usize>)| Objects::read(&self.asset, which, &self.placement, rig, still);
        let groups: Vec<Objects> = rigs.iter().map(read).collect::<Result<_>>()?;
        let prepare = |objects| Objects::prepare(objects, options.taps, still);
        let prepared: Vec<_> = groups.iter().map(prepare).collect::<Result<_>>()?;
        let objects: Vec<_> = prepared.iter().map(|prepared| prepared.object()).collect::<Result<_>>()?;
        let light = |object: &ArObject| self.light.input(&object.placement, &self.ffmpeg);
        let mut lights: Vec<_> = objects.iter().map(light).collect::<Result<_>>()?;
        let mut masks = Masks::open(self.occlusion.as_deref(), &self.ffmpeg)?;
        bar.set_message("frames");

        let mut work = Work::new(rigs.iter().map(|(rig, _)| rig.describe()).collect(), self.json);
        let single = source.is_single();
        let clock = Instant::now();
        let mut upcoming = source.next()?;
        work.reading += clock.elapsed().as_secs_f64();
        // All frames are upright, and so is the calibration.
        let orientation = source.orientation();
        let calibration = match &upcoming {
            Some(plate) => self.calibration_of(calibration, orientation, plate.size()),
            None => calibration,
        };
        let mut sessions = Vec::new();
        for ((object, (rig, _)), light) in objects.iter().zip(&rigs).zip(&lights) {
            sessions.push(Session::new(object, &calibration, rig.clone(), light.source(), options)?);
        }
        while let Some(mut plate) = upcoming.take() {
            let clock = Instant::now();
            let [width, height] = plate.size();
            let name = source.name(work.frames);
            calibration.check_size(&self.camera, Path::new(&name), width, height)?;
            if source.orientation() != orientation {
                let (first, this) = (orientation.to_exif(), source.orientation().to_exif());
                let message = format!("its orientation (EXIF {this}) is not the first frame's (EXIF {first})");
                return Err(Error::input(&name, message).into());
            }
            let nearer = masks.next()?;
            work.reading += clock.elapsed().as_secs_f64();
            let environments: Vec<_> = lights.iter_mut().map(LightInput::next).collect::<tsuya::Result<_>>()?;
            let environments: Vec<_> = environments.iter().map(Option::as_ref).collect();
            let reports = Session::frame_of_all(&mut sessions, &mut plate, nearer, &environments)?;
            let clock = Instant::now();
            // A photograph without its object is no result.
            if !single || reports.iter().any(|report| report.estimate.is_some()) {
                sink.put(&plate, &mut source, work.frames)?;
            }
            work.add(&reports, &source);
            work.writing += clock.elapsed().as_secs_f64();
            bar.inc(1);
            // The next one only now: what is shown waits for no camera.
            let clock = Instant::now();
            upcoming = source.next()?;
            work.reading += clock.elapsed().as_secs_f64();
        }
        output::warn(&source.remarks());
        bar.finish_and_clear();
        if work.seen == 0 {
            let place = if single { source.name(0) } else { format!("any of the {} frames", work.frames) };
            return Err(Failed(format!(
                "no marker {} in {place}: it must be wholly in the picture with its white margin, and of this family and number",
                rigs.iter().map(|(rig, _)| rig.describe()).collect::<Vec<_>>().join(" or ")
            ))
            .into());
        }
        sink.finish()?;
        output::warn(&work.warnings());
        work.print(&calibration, began.elapsed().as_secs_f64(), output::is_stream(&self.output))
    }

    /// The markers, each once, with the numbers of the objects that stand on it.
    fn rigs(&self) -> Result<Vec<(Rig, Vec<usize>)>> {
        let (markers, objects) = (self.marker.len(), self.asset.len());
        if markers != 1 && markers != objects {
            let message = format!("--marker comes {markers} times for {objects} objects: once, or once for each");
            return Err(Error::parameter(message).into());
        }
        let mut rigs: Vec<(&str, Rig, Vec<usize>)> = Vec::new();
        for object in 0..objects {
            let marker = &self.marker[object % markers];
            match rigs.iter_mut().find(|(known, ..)| known == marker) {
                Some((_, _, which)) => which.push(object),
                None => rigs.push((marker, self.rig(marker)?, vec![object])),
            }
        }
        let asked = self.marker_border.is_some() || self.marker_confidence.is_some();
        if asked && rigs.iter().all(|(_, rig, _)| rig.patterns.is_empty()) {
            let message = "--marker-border and --marker-confidence are of artoolkit markers, of which there is none";
            return Err(Error::parameter(message).into());
        }
        Ok(rigs.into_iter().map(|(_, rig, which)| (rig, which)).collect())
    }

    fn rig(&self, marker: &str) -> Result<Rig> {
        let mut rig = if marker.contains(':') && !Path::new(marker).exists() {
            Rig::parse(marker, &source::access())?
        } else {
            Rig::read(marker, &source::access())?
        };
        for pattern in &mut rig.patterns {
            self.marker_border.map_or(Ok(()), |border| pattern.set_border(border))?;
            self.marker_confidence.map_or(Ok(()), |confidence| pattern.set_min_confidence(confidence))?;
        }
        Ok(rig)
    }

    /// The calibration of frames that are shown upright in this size.
    fn calibration_of(&self, calibration: Calibration, orientation: ImageOrientation, size: [usize; 2]) -> Calibration {
        let stored = orientation.swap_sides(size);
        let calibrated = [calibration.camera.width, calibration.camera.height].map(|side| side as usize);
        if !self.scale_camera || calibrated == size || calibrated == stored {
            return calibration.upright(orientation, size);
        }
        // Of the stored and the shown size the one of the same shape.
        let shape = |[width, height]: [usize; 2]| (width as f64 / height as f64).ln();
        let apart = |size: [usize; 2]| (shape(size) - shape(calibrated)).abs();
        let target = if apart(stored) <= apart(size) { stored } else { size };
        let scaled = (calibrated[1] * target[0]) as f64 / calibrated[0] as f64;
        if (scaled - target[1] as f64).abs() > 1.0 {
            let ([width, height], [w, h]) = (target, calibrated);
            let message = format!(
                "frames of {width} x {height} pixels are no scaled ones of the calibrated {w} x {h}: each axis is scaled by itself, and \
                 poses are off where they were cropped instead"
            );
            output::warn(&[message]);
        }
        calibration.scaled_to(target).upright(orientation, size)
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
