//! An object in the pictures of a camera: where it stands from markers, lit by the surroundings, with its shadow on the ground.
//!
//! Each frame goes through four steps: **pose** ([`crate::marker`]), **light** (the surroundings, if they change), **render**
//! ([`crate::relight`]) and **composite** (shadow, object, the camera's gain and noise). See `spec/placing.md`.

mod canvas;
pub(crate) mod placement;
mod plate;
mod sensor;

pub use placement::{Placement, RigMount};
pub use plate::Plate;
pub use sensor::PAPER_ALBEDO;

use crate::asset::Asset;
use crate::capture::calibration::Calibration;
use crate::error::Result;
use crate::image::{Grid, Mask};
use crate::lighting::{EnvironmentMap, follow::LightFollower};
use crate::marker::detection::MarkerDetection;
use crate::marker::track::MarkerTracker;
use crate::marker::{PoseEstimate, Rig};
use crate::mesh::Mesh;
use crate::relight::{
    AssetRenderer, EnvironmentOptions, EnvironmentScene, Evaluator, GroundShadow, Occlusion, PreparedEnvironment,
    PreparedEnvironmentOptions, RealtimeFrame, RealtimeRenderer, RenderObject, ShadingModel, add_detail,
};
use crate::views::Camera;
use canvas::LensCanvas;
use plate::SrgbCurve;
use std::borrow::Cow;
use std::time::Instant;

/// Lobes of a light that is followed.
const LOBES: usize = 10;
/// Part of a new frame's gain in the one that is used.
const GAIN_STEP: f32 = 0.2;

/// What is put into the pictures.
pub struct ArObject<'a> {
    /// Its mesh.
    pub mesh: &'a Mesh,
    /// What its vertices see.
    pub occlusion: &'a Occlusion,
    /// What it is made of.
    pub look: &'a dyn ShadingModel,
    /// Where it stands.
    pub placement: Placement,
    /// Photographs finer than its maps, for [`RenderMode::Offline`].
    pub detail: Option<(&'a AssetRenderer<'a>, &'a Asset)>,
}

/// Where light comes from, in the object's own axes.
pub enum LightSource<'a> {
    /// The same in all frames.
    Fixed(&'a EnvironmentMap),
    /// Another one for each frame; after `None` the last one stays.
    PerFrame(&'a mut dyn FnMut() -> Result<Option<EnvironmentMap>>),
}

/// How frames are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RenderMode {
    /// Exact shadows, all detail; a second or so a frame.
    Offline,
    /// Many frames a second.
    Realtime,
}

/// How an object is put into pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArOptions {
    /// How the ground lies to the markers.
    pub mount: RigMount,
    /// How frames are drawn.
    pub mode: RenderMode,
    /// Samples of a pixel along each side, 1 to 8.
    pub samples: u32,
    /// Looks at a specular lobe.
    pub taps: usize,
    /// Whether exposure and white balance are read off the markers' paper; without it radiance 1 of the surroundings is 1 of the frames.
    pub match_white: bool,
    /// Factor of the object's brightness.
    pub gain: f32,
    /// Standard deviation of the noise on the object in display values; `None`: as measured in each frame.
    pub noise: Option<f32>,
    /// Whether it casts a shadow.
    pub shadow: bool,
}

impl Default for ArOptions {
    fn default() -> Self {
        ArOptions {
            mount: RigMount::default(),
            mode: RenderMode::Realtime,
            samples: 2,
            taps: 7,
            match_white: true,
            gain: 1.0,
            noise: None,
            shadow: true,
        }
    }
}

/// A frame to work on.
pub struct ArFrame {
    /// The picture.
    pub plate: Plate,
    /// Pixels that show what is nearer than the object.
    pub nearer: Option<Mask>,
}

/// Time of a frame's steps, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameTimes {
    /// The whole frame: pose and light are found at the same time.
    pub whole: f64,
    /// Finding the markers and their pose.
    pub pose: f64,
    /// Taking up the light.
    pub light: f64,
    /// Light on the object's vertices, and drawing it.
    pub render: f64,
    /// Shadow, blending, noise.
    pub composite: f64,
}

/// What was done with a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameReport {
    /// Its number, from 0.
    pub frame: usize,
    /// Rig to camera; `None`: no marker was found, the frame is as it was.
    pub estimate: Option<PoseEstimate>,
    /// What the surroundings' radiance was multiplied by, red, green, blue.
    pub gain: [f32; 3],
    /// Noise put on the object, display values.
    pub noise: f32,
    /// Time.
    pub times: FrameTimes,
}

/// Puts the object into frame after frame: `next` gives them, `done` takes them. The result depends on the frames alone, not on the number of
/// threads.
///
/// Errors: those of `next` and `done`; frames of another size than the calibration's; a mesh without triangles.
pub fn run(
    subject: &ArObject,
    calibration: &Calibration,
    rig: Rig,
    light: LightSource,
    options: &ArOptions,
    next: &mut dyn FnMut() -> Result<Option<ArFrame>>,
    done: &mut dyn FnMut(Plate, &FrameReport) -> Result<()>,
) -> Result<()> {
    let object = RenderObject::new(subject.mesh, Some(subject.occlusion))?;
    let shadow = GroundShadow::new(subject.mesh, &subject.placement.ground())?;
    let tracker = MarkerTracker::new(rig, calibration.camera, calibration.lens)?;
    let canvas = LensCanvas::new(calibration);
    let mut eye = FrameTracker {
        tracker,
        curve: SrgbCurve::new(),
        frame: 0,
        size: [calibration.camera.width as usize, calibration.camera.height as usize],
    };
    let mut stage = Compositor { subject, options, canvas, shadow, gain: None, paper_irradiance: [0.0; 3] };
    let environment_options =
        |evaluator| EnvironmentOptions { evaluator, shadows: true, samples: options.samples, taps: options.taps };
    match light {
        LightSource::Fixed(environment) => {
            let surround = PreparedEnvironment::new(environment, &PreparedEnvironmentOptions::default());
            stage.paper_irradiance = paper_irradiance(subject, options, &surround);
            let finer = PreparedEnvironmentOptions { distant_lights: 32, ..PreparedEnvironmentOptions::default() };
            stage.shadow.light(&PreparedEnvironment::new(environment, &finer));
            stage.shadow.keep();
            let scene = EnvironmentScene::new(&object, &surround, None, environment_options(Evaluator::Filtered))?;
            let mut painter = ObjectRenderer::new(&scene, options.mode);
            while let Some(shot) = next()? {
                let began = FrameTimer { clock: Instant::now(), light: 0.0, vertices: 0.0 };
                let seen = eye.track(&shot.plate)?;
                stage.composite(&mut painter, &eye.curve, shot, seen, began, done)?;
            }
        }
        LightSource::PerFrame(source) => {
            let mut follower = LightFollower::new(LOBES);
            let mut ended = false;
            let mut surround = PreparedEnvironment::from_prefiltered(&[]);
            let mut shot = next()?;
            while let Some(first) = shot {
                let environment = if ended { None } else { source()? };
                ended |= environment.is_none();
                let clock = Instant::now();
                let take_light = || {
                    if let Some(environment) = environment {
                        surround = PreparedEnvironment::from_prefiltered(&follower.update(&environment).prefiltered);
                        stage.paper_irradiance = paper_irradiance(subject, options, &surround);
                        stage.shadow.light_blurred(&surround);
                        stage.shadow.keep();
                    }
                    clock.elapsed()
                };
                let (seen, taken) = crate::parallel::join(|| eye.track(&first.plate), take_light);
                let preparing = Instant::now();
                let light = follower.light();
                let scene = EnvironmentScene::new(
                    &object,
                    &surround,
                    Some(light),
                    environment_options(Evaluator::SphericalGaussian),
                )?;
                let mut painter = ObjectRenderer::new(&scene, options.mode);
                let vertices = preparing.elapsed().as_secs_f64();
                let began = FrameTimer { clock, light: taken.as_secs_f64(), vertices };
                stage.composite(&mut painter, &eye.curve, first, seen?, began, done)?;
                shot = next()?;
                // Under the last light nothing is prepared again.
                while ended && let Some(another) = shot.take() {
                    let began = FrameTimer { clock: Instant::now(), light: 0.0, vertices: 0.0 };
                    let seen = eye.track(&another.plate)?;
                    stage.composite(&mut painter, &eye.curve, another, seen, began, done)?;
                    shot = next()?;
                }
            }
        }
    }
    Ok(())
}

/// Irradiance of the markers, whose print faces the world's +Y, or stands.
fn paper_irradiance(subject: &ArObject, options: &ArOptions, surround: &PreparedEnvironment) -> [f32; 3] {
    let out_of_paper = options.mount.rig_of_world().inverse().transform_point([0.0, 0.0, 1.0]);
    surround.irradiance(subject.placement.to_local(out_of_paper).map(|x| x as f32))
}

/// Finds the markers.
struct FrameTracker {
    tracker: MarkerTracker,
    curve: SrgbCurve,
    /// Of the next frame.
    frame: usize,
    size: [usize; 2],
}

/// A frame's markers.
struct TrackedFrame {
    frame: usize,
    grey: Grid<u8>,
    found: Option<(PoseEstimate, Vec<MarkerDetection>)>,
    seconds: f64,
}

impl FrameTracker {
    fn track(&mut self, plate: &Plate) -> Result<TrackedFrame> {
        let clock = Instant::now();
        let frame = self.frame;
        self.frame += 1;
        if plate.size() != self.size {
            let ([w, h], [width, height]) = (plate.size(), self.size);
            let message = format!("frame {frame} has {w} x {h} pixels, the calibration is of {width} x {height}");
            return Err(crate::Error::parameter(message));
        }
        let grey = self.curve.grey(plate);
        let found = self.tracker.track(&grey)?;
        Ok(TrackedFrame { frame, grey, found, seconds: clock.elapsed().as_secs_f64() })
    }
}

/// Draws the object.
enum ObjectRenderer<'s, 'a> {
    Still(&'s EnvironmentScene<'a>),
    Motion(Box<RealtimeRenderer<'s>>),
}

impl<'s> ObjectRenderer<'s, '_> {
    fn new<'a>(scene: &'s EnvironmentScene<'a>, quality: RenderMode) -> ObjectRenderer<'s, 'a>
    where
        'a: 's,
    {
        match quality {
            RenderMode::Offline => ObjectRenderer::Still(scene),
            RenderMode::Realtime => ObjectRenderer::Motion(Box::new(RealtimeRenderer::new(scene))),
        }
    }

    /// What `camera`, a part of the canvas, sees.
    fn draw(&mut self, subject: &ArObject, camera: &Camera) -> Result<Cow<'_, RealtimeFrame>> {
        match self {
            ObjectRenderer::Still(scene) => {
                let mut relit = scene.render(camera, subject.look)?;
                if let Some((renderer, asset)) = subject.detail {
                    add_detail(&mut relit, renderer, asset, camera)?;
                }
                Ok(Cow::Owned(RealtimeFrame { image: relit.image, coverage: relit.coverage }))
            }
            ObjectRenderer::Motion(motion) => Ok(Cow::Borrowed(motion.render(camera, subject.look)?)),
        }
    }
}

/// When work on a frame began, and the seconds that its light and the light of the object's vertices took.
struct FrameTimer {
    clock: Instant,
    light: f64,
    vertices: f64,
}

/// What stays from frame to frame.
struct Compositor<'s, 'a> {
    subject: &'s ArObject<'a>,
    options: &'s ArOptions,
    canvas: LensCanvas,
    shadow: GroundShadow<'s>,
    gain: Option<[f32; 3]>,
    paper_irradiance: [f32; 3],
}

impl Compositor<'_, '_> {
    /// Puts the object into a frame and passes it on.
    fn composite(
        &mut self,
        painter: &mut ObjectRenderer,
        curve: &SrgbCurve,
        ArFrame { mut plate, nearer }: ArFrame,
        TrackedFrame { frame, grey, found, seconds: pose }: TrackedFrame,
        began: FrameTimer,
        done: &mut dyn FnMut(Plate, &FrameReport) -> Result<()>,
    ) -> Result<()> {
        let mut times = FrameTimes { pose, light: began.light, ..FrameTimes::default() };
        let Some((estimate, detections)) = found else {
            times.whole = began.clock.elapsed().as_secs_f64();
            let gain = self.gain.unwrap_or([1.0; 3]);
            return done(plate, &FrameReport { frame, estimate: None, gain, noise: 0.0, times });
        };
        let rig_of_world = self.options.mount.rig_of_world();
        let camera = self.subject.placement.camera(&self.canvas.camera, &estimate.pose, &rig_of_world);

        let clock = Instant::now();
        let part = canvas::window_around(self.subject.mesh, &camera);
        let object = match part {
            Some(part) => Some((part, painter.draw(self.subject, &canvas::cropped(&camera, part))?)),
            None => None,
        };
        times.render = began.vertices + clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let before = nearer.is_some().then(|| plate.clone());
        let gain = self.update_gain(curve, &plate, &detections).map(|c| c * self.options.gain);
        if self.options.shadow {
            self.canvas.blend_shadow(&self.shadow, &camera, curve, &mut plate);
        }
        let noise = self.options.noise.unwrap_or_else(|| sensor::noise_sigma(&grey));
        if let Some((part, object)) = &object {
            self.canvas.blend_object(object, *part, gain, (noise, frame as u32), curve, &mut plate);
        }
        if let (Some(nearer), Some(before)) = (&nearer, &before) {
            plate.restore(before, nearer)?;
        }
        times.composite = clock.elapsed().as_secs_f64();
        times.whole = began.clock.elapsed().as_secs_f64();
        done(plate, &FrameReport { frame, estimate: Some(estimate), gain, noise, times })
    }

    /// What the surroundings' radiance is multiplied by, so that the markers' paper is as bright as the frame shows it.
    fn update_gain(&mut self, curve: &SrgbCurve, plate: &Plate, detections: &[MarkerDetection]) -> [f32; 3] {
        if !self.options.match_white {
            return [1.0; 3];
        }
        let papers: Vec<[f32; 3]> = detections.iter().filter_map(|d| sensor::paper_radiance(curve, plate, d)).collect();
        let expected = self.paper_irradiance.map(|e| e * (PAPER_ALBEDO / std::f64::consts::PI) as f32);
        if !papers.is_empty() && expected.iter().all(|&e| e > 1e-9) {
            let found: [f32; 3] =
                std::array::from_fn(|c| papers.iter().map(|p| p[c]).sum::<f32>() / papers.len() as f32 / expected[c]);
            self.gain = Some(match self.gain {
                // Slowly, so that it does not flicker.
                Some(last) => std::array::from_fn(|c| last[c] + (found[c] - last[c]) * GAIN_STEP),
                None => found,
            });
        }
        self.gain.unwrap_or([1.0; 3])
    }
}
