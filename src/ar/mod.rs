//! An object in the pictures of a camera: where it stands from markers, lit by the surroundings, with its shadow on the ground.
//!
//! Each frame goes through four steps: **pose** ([`crate::marker`]), **light** (the surroundings, if they change), **render**
//! ([`crate::relight`]) and **composite** (shadow, object, the camera's gain and noise). See `spec/placing.md`.

mod canvas;
pub mod placement;
mod plate;
mod sensor;

pub use plate::Plate;
pub use sensor::PAPER;

use crate::asset::Asset;
use crate::capture::calibration::Calibration;
use crate::error::Result;
use crate::image::{Grid, Mask};
use crate::lighting::{Environment, follow::Follower};
use crate::marker::detection::Detection;
use crate::marker::track::Tracker;
use crate::marker::{Estimate, Rig};
use crate::mesh::Mesh;
use crate::relight::{
    EnvironmentOptions, Evaluator, Frame, GroundShadow, Look, Motion, Object, Occlusion, Renderer, Scene, Surround,
    SurroundOptions, add_detail,
};
use crate::views::Camera;
use canvas::Canvas;
use placement::{Placement, Stands};
use plate::Curve;
use std::borrow::Cow;
use std::time::Instant;

/// Lobes of a light that is followed.
const LOBES: usize = 10;
/// Part of a new frame's gain in the one that is used.
const GAIN_STEP: f32 = 0.2;

/// What is put into the pictures.
pub struct Subject<'a> {
    /// Its mesh.
    pub mesh: &'a Mesh,
    /// What its vertices see.
    pub occlusion: &'a Occlusion,
    /// What it is made of.
    pub look: &'a dyn Look,
    /// Where it stands.
    pub placement: Placement,
    /// Photographs finer than its maps, for [`Quality::Still`].
    pub detail: Option<(&'a Renderer<'a>, &'a Asset)>,
}

/// Where light comes from, in the object's own axes.
pub enum Light<'a> {
    /// The same in all frames.
    Still(&'a Environment),
    /// Another one for each frame; after `None` the last one stays.
    Moving(&'a mut dyn FnMut() -> Result<Option<Environment>>),
}

/// How frames are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// Exact shadows, all detail; a second or so a frame.
    Still,
    /// Many frames a second.
    Motion,
}

/// How an object is put into pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How the ground lies to the markers.
    pub stands: Stands,
    /// How frames are drawn.
    pub quality: Quality,
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

impl Default for Options {
    fn default() -> Self {
        Options {
            stands: Stands::default(),
            quality: Quality::Motion,
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
pub struct Shot {
    /// The picture.
    pub plate: Plate,
    /// Pixels that show what is nearer than the object.
    pub nearer: Option<Mask>,
}

/// Time of a frame's steps, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Times {
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
pub struct Done {
    /// Its number, from 0.
    pub frame: usize,
    /// Rig to camera; `None`: no marker was found, the frame is as it was.
    pub estimate: Option<Estimate>,
    /// What the surroundings' radiance was multiplied by, red, green, blue.
    pub gain: [f32; 3],
    /// Noise put on the object, display values.
    pub noise: f32,
    /// Time.
    pub times: Times,
}

/// Puts the object into frame after frame: `next` gives them, `done` takes them. The result depends on the frames alone, not on the number of
/// threads.
///
/// Errors: those of `next` and `done`; frames of another size than the calibration's; a mesh without triangles.
pub fn run(
    subject: &Subject,
    calibration: &Calibration,
    rig: Rig,
    light: Light,
    options: &Options,
    next: &mut dyn FnMut() -> Result<Option<Shot>>,
    done: &mut dyn FnMut(Plate, &Done) -> Result<()>,
) -> Result<()> {
    let object = Object::new(subject.mesh, Some(subject.occlusion))?;
    let shadow = GroundShadow::new(subject.mesh, &subject.placement.ground())?;
    let tracker = Tracker::new(rig, calibration.camera, calibration.lens)?;
    let canvas = Canvas::new(calibration);
    let mut eye = Eye {
        tracker,
        curve: Curve::new(),
        frame: 0,
        size: [calibration.camera.width as usize, calibration.camera.height as usize],
    };
    let mut stage = Stage { subject, options, canvas, shadow, gain: None, paper_irradiance: [0.0; 3] };
    let environment_options =
        |evaluator| EnvironmentOptions { evaluator, shadows: true, samples: options.samples, taps: options.taps };
    match light {
        Light::Still(environment) => {
            let surround = Surround::new(environment, &SurroundOptions::default());
            stage.paper_irradiance = paper_irradiance(subject, options, &surround);
            let finer = SurroundOptions { distant_lights: 32, ..SurroundOptions::default() };
            stage.shadow.light(&Surround::new(environment, &finer));
            stage.shadow.keep();
            let scene = Scene::new(&object, &surround, None, environment_options(Evaluator::Better))?;
            let mut painter = Painter::new(&scene, options.quality);
            while let Some(shot) = next()? {
                let began = Began { clock: Instant::now(), light: 0.0, vertices: 0.0 };
                let seen = eye.look(&shot.plate)?;
                stage.work(&mut painter, &eye.curve, shot, seen, began, done)?;
            }
        }
        Light::Moving(source) => {
            let mut follower = Follower::new(LOBES);
            let mut ended = false;
            let mut surround = Surround::of_levels(&[]);
            let mut shot = next()?;
            while let Some(first) = shot {
                let environment = if ended { None } else { source()? };
                ended |= environment.is_none();
                let clock = Instant::now();
                let take_light = || {
                    if let Some(environment) = environment {
                        surround = Surround::of_levels(&follower.update(&environment).levels);
                        stage.paper_irradiance = paper_irradiance(subject, options, &surround);
                        stage.shadow.light_blurred(&surround);
                        stage.shadow.keep();
                    }
                    clock.elapsed()
                };
                let (seen, taken) = crate::parallel::join(|| eye.look(&first.plate), take_light);
                let preparing = Instant::now();
                let light = follower.light();
                let scene = Scene::new(&object, &surround, Some(light), environment_options(Evaluator::Published))?;
                let mut painter = Painter::new(&scene, options.quality);
                let vertices = preparing.elapsed().as_secs_f64();
                let began = Began { clock, light: taken.as_secs_f64(), vertices };
                stage.work(&mut painter, &eye.curve, first, seen?, began, done)?;
                shot = next()?;
                // Under the last light nothing is prepared again.
                while ended && let Some(another) = shot.take() {
                    let began = Began { clock: Instant::now(), light: 0.0, vertices: 0.0 };
                    let seen = eye.look(&another.plate)?;
                    stage.work(&mut painter, &eye.curve, another, seen, began, done)?;
                    shot = next()?;
                }
            }
        }
    }
    Ok(())
}

/// Irradiance of the markers, whose print faces the world's +Y, or stands.
fn paper_irradiance(subject: &Subject, options: &Options, surround: &Surround) -> [f32; 3] {
    let out_of_paper = options.stands.rig_of_world().inverse().apply([0.0, 0.0, 1.0]);
    surround.irradiance(subject.placement.to_local(out_of_paper).map(|x| x as f32))
}

/// Finds the markers.
struct Eye {
    tracker: Tracker,
    curve: Curve,
    /// Of the next frame.
    frame: usize,
    size: [usize; 2],
}

/// A frame's markers.
struct Seen {
    frame: usize,
    grey: Grid<u8>,
    found: Option<(Estimate, Vec<Detection>)>,
    seconds: f64,
}

impl Eye {
    fn look(&mut self, plate: &Plate) -> Result<Seen> {
        let clock = Instant::now();
        let frame = self.frame;
        self.frame += 1;
        if plate.size() != self.size {
            let ([w, h], [width, height]) = (plate.size(), self.size);
            let message = format!("frame {frame} has {w} x {h} pixels, the calibration is of {width} x {height}");
            return Err(crate::Error::parameter(message));
        }
        let grey = self.curve.grey(plate);
        let found = self.tracker.next(&grey)?;
        Ok(Seen { frame, grey, found, seconds: clock.elapsed().as_secs_f64() })
    }
}

/// Draws the object.
enum Painter<'s, 'a> {
    Still(&'s Scene<'a>),
    Motion(Box<Motion<'s>>),
}

impl<'s> Painter<'s, '_> {
    fn new<'a>(scene: &'s Scene<'a>, quality: Quality) -> Painter<'s, 'a>
    where
        'a: 's,
    {
        match quality {
            Quality::Still => Painter::Still(scene),
            Quality::Motion => Painter::Motion(Box::new(Motion::new(scene))),
        }
    }

    /// What `camera`, a part of the canvas, sees.
    fn draw(&mut self, subject: &Subject, camera: &Camera) -> Result<Cow<'_, Frame>> {
        match self {
            Painter::Still(scene) => {
                let mut relit = scene.render(camera, subject.look)?;
                if let Some((renderer, asset)) = subject.detail {
                    add_detail(&mut relit, renderer, asset, camera)?;
                }
                Ok(Cow::Owned(Frame { image: relit.image, coverage: relit.coverage }))
            }
            Painter::Motion(motion) => Ok(Cow::Borrowed(motion.draw(camera, subject.look)?)),
        }
    }
}

/// When work on a frame began, and the seconds that its light and the light of the object's vertices took.
struct Began {
    clock: Instant,
    light: f64,
    vertices: f64,
}

/// What stays from frame to frame.
struct Stage<'s, 'a> {
    subject: &'s Subject<'a>,
    options: &'s Options,
    canvas: Canvas,
    shadow: GroundShadow<'s>,
    gain: Option<[f32; 3]>,
    paper_irradiance: [f32; 3],
}

impl Stage<'_, '_> {
    /// Puts the object into a frame and passes it on.
    fn work(
        &mut self,
        painter: &mut Painter,
        curve: &Curve,
        Shot { mut plate, nearer }: Shot,
        Seen { frame, grey, found, seconds: pose }: Seen,
        began: Began,
        done: &mut dyn FnMut(Plate, &Done) -> Result<()>,
    ) -> Result<()> {
        let mut times = Times { pose, light: began.light, ..Times::default() };
        let Some((estimate, detections)) = found else {
            times.whole = began.clock.elapsed().as_secs_f64();
            let gain = self.gain.unwrap_or([1.0; 3]);
            return done(plate, &Done { frame, estimate: None, gain, noise: 0.0, times });
        };
        let rig_of_world = self.options.stands.rig_of_world();
        let camera = self.subject.placement.camera(&self.canvas.camera, &estimate.pose, &rig_of_world);

        let clock = Instant::now();
        let part = canvas::part_around(self.subject.mesh, &camera);
        let object = match part {
            Some(part) => Some((part, painter.draw(self.subject, &canvas::cropped(&camera, part))?)),
            None => None,
        };
        times.render = began.vertices + clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let before = nearer.is_some().then(|| plate.clone());
        let gain = self.white(curve, &plate, &detections).map(|c| c * self.options.gain);
        if self.options.shadow {
            self.canvas.darken(&self.shadow, &camera, curve, &mut plate);
        }
        let noise = self.options.noise.unwrap_or_else(|| sensor::noise(&grey));
        if let Some((part, object)) = &object {
            self.canvas.put(object, *part, gain, (noise, frame as u32), curve, &mut plate);
        }
        if let (Some(nearer), Some(before)) = (&nearer, &before) {
            plate.put_back(before, nearer)?;
        }
        times.composite = clock.elapsed().as_secs_f64();
        times.whole = began.clock.elapsed().as_secs_f64();
        done(plate, &Done { frame, estimate: Some(estimate), gain, noise, times })
    }

    /// What the surroundings' radiance is multiplied by, so that the markers' paper is as bright as the frame shows it.
    fn white(&mut self, curve: &Curve, plate: &Plate, detections: &[Detection]) -> [f32; 3] {
        if !self.options.match_white {
            return [1.0; 3];
        }
        let papers: Vec<[f32; 3]> = detections.iter().filter_map(|d| sensor::paper(curve, plate, d)).collect();
        let expected = self.paper_irradiance.map(|e| e * (PAPER / std::f64::consts::PI) as f32);
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
