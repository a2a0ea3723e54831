//! State kept from frame to frame: tracker, light, renderer and compositor.

use super::compositor::{Compositor, ObjectView, TrackedFrame};
use super::object_renderer::ObjectRenderer;
use super::plate::{Plate, SrgbCurve};
use super::{ArObject, ArOptions, FrameReport, FrameTimes, LightSource};
use crate::capture::calibration::Calibration;
use crate::error::{Error, Result};
use crate::image::Mask;
use crate::lighting::{EnvironmentMap, follow::LightFollower};
use crate::marker::Rig;
use crate::marker::track::MarkerTracker;
use crate::relight::{
    EnvironmentOptions, EnvironmentScene, EvaluatorKind, PreparedEnvironment, PreparedEnvironmentOptions,
};
use std::sync::Arc;
use std::time::Instant;

/// Lobes of a light that comes with the frames.
const LOBES: usize = 10;

/// Puts an object into the frames of one camera, one after the other. The result depends on the frames alone, not on the number of threads.
pub struct Session<'a> {
    tracker: FrameTracker,
    light: SessionLight,
    renderer: Option<ObjectRenderer<'a>>,
    compositor: Compositor<'a>,
    curve: SrgbCurve,
}

impl<'a> Session<'a> {
    /// Prepares the object, and the light where it is fixed.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a placement without a ground, an object without visibility, or samples or taps out of range.
    pub fn new(
        object: &'a ArObject<'a>,
        calibration: &Calibration,
        rig: Rig,
        light: LightSource,
        options: ArOptions,
    ) -> Result<Self> {
        let mut compositor = Compositor::new(object, calibration, options)?;
        let tracker = FrameTracker {
            tracker: MarkerTracker::new(rig, calibration.camera, calibration.lens)?,
            frame: 0,
            size: [calibration.camera.width as usize, calibration.camera.height as usize],
        };
        let light = match light {
            LightSource::Fixed(environment) => {
                let prepared = PreparedEnvironment::new(environment, &PreparedEnvironmentOptions::default());
                let finer = PreparedEnvironmentOptions { distant_lights: 32, ..PreparedEnvironmentOptions::default() };
                compositor.set_light(&prepared, |shadow| {
                    shadow.light(&PreparedEnvironment::new(environment, &finer));
                });
                SessionLight::Fixed(Arc::new(prepared))
            }
            LightSource::PerFrame => SessionLight::PerFrame {
                follower: Box::new(LightFollower::new(LOBES)),
                prepared: Arc::new(PreparedEnvironment::from_prefiltered(&[])),
            },
        };
        let renderer = match light {
            SessionLight::Fixed(_) => Some(ObjectRenderer::new(light.scene(object, &options)?, options.mode)),
            SessionLight::PerFrame { .. } => None,
        };
        Ok(Session { tracker, light, renderer, compositor, curve: SrgbCurve::new() })
    }

    /// Puts the object into a frame; pixels of `nearer` keep what they show. With [`LightSource::PerFrame`] `environment` is the light from this
    /// frame on; without one the last stays, and all is black before the first.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a frame or mask of another size than the calibration's, or an environment where the light is fixed.
    pub fn frame(
        &mut self,
        plate: &mut Plate,
        nearer: Option<&Mask>,
        environment: Option<&EnvironmentMap>,
    ) -> Result<FrameReport> {
        Ok(Self::frame_of_all(std::slice::from_mut(self), plate, nearer, &[environment])?.swap_remove(0))
    }

    /// Puts the objects of several sessions, whose markers move apart from each other, into one frame, each as [`Self::frame`] does with its own
    /// `environment`. All markers are looked for in the frame as it was; grounds are darkened first, and objects drawn one over the
    /// other, the farther one's middle first. Objects of different sessions do not shadow each other.
    ///
    /// # Errors
    ///
    /// Those of [`Self::frame`]; [`Error::Parameter`] for another number of environments than of sessions.
    pub fn frame_of_all(
        sessions: &mut [Session],
        plate: &mut Plate,
        nearer: Option<&Mask>,
        environments: &[Option<&EnvironmentMap>],
    ) -> Result<Vec<FrameReport>> {
        if sessions.len() != environments.len() {
            let (a, b) = (environments.len(), sessions.len());
            return Err(Error::parameter(format!("{a} environments for {b} sessions")));
        }
        let mut views = Vec::with_capacity(sessions.len());
        for (session, environment) in sessions.iter_mut().zip(environments) {
            let clock = Instant::now();
            let Session { tracker, light, renderer, compositor, curve } = session;
            let mut view = look(tracker, light, renderer, compositor, curve, plate, *environment)?;
            view.report.times.whole = clock.elapsed().as_secs_f64() - view.report.times.composite;
            views.push((view, &*compositor, &*curve));
        }
        let before = nearer.map(|nearer| (nearer, plate.clone()));
        views.iter_mut().for_each(|(view, compositor, curve)| compositor.blend_shadow(view, curve, plate));
        let mut order: Vec<usize> = (0..views.len()).collect();
        order.sort_by(|&a, &b| views[b].0.distance.total_cmp(&views[a].0.distance));
        for k in order {
            let (view, compositor, curve) = &mut views[k];
            compositor.blend_object(view, curve, plate);
        }
        if let Some((nearer, before)) = &before {
            plate.restore(before, nearer)?;
        }
        let report = |(mut view, ..): (ObjectView, _, _)| {
            view.report.times.whole += view.report.times.composite;
            view.report
        };
        Ok(views.into_iter().map(report).collect())
    }
}

/// Finds an object's marker, follows its light, and draws it.
fn look<'r, 'a: 'r>(
    tracker: &mut FrameTracker,
    light: &mut SessionLight,
    renderer: &'r mut Option<ObjectRenderer<'a>>,
    compositor: &mut Compositor<'a>,
    curve: &SrgbCurve,
    plate: &Plate,
    environment: Option<&EnvironmentMap>,
) -> Result<ObjectView<'r>> {
    if environment.is_some() && matches!(light, SessionLight::Fixed(_)) {
        return Err(Error::parameter("an environment for one frame of a session whose light is fixed"));
    }
    let clock = Instant::now();
    let (tracked, seconds) = crate::parallel::join(
        || tracker.track(plate, curve),
        || {
            light.follow(environment, compositor);
            if environment.is_some() { clock.elapsed().as_secs_f64() } else { 0.0 }
        },
    );
    let tracked = tracked?;
    let preparing = Instant::now();
    let mut times = FrameTimes { pose: tracked.seconds, light: seconds, ..FrameTimes::default() };
    if environment.is_some() {
        *renderer = None;
    }
    let renderer = match renderer {
        Some(renderer) => renderer,
        none => {
            let scene = light.scene(compositor.object, &compositor.options)?;
            none.insert(ObjectRenderer::new(scene, compositor.options.mode))
        }
    };
    times.render = preparing.elapsed().as_secs_f64();
    compositor.look(renderer, curve, plate, tracked, times)
}

/// Light of the frames.
enum SessionLight {
    /// Prepared once.
    Fixed(Arc<PreparedEnvironment>),
    /// Fitted anew for each environment that comes.
    PerFrame { follower: Box<LightFollower>, prepared: Arc<PreparedEnvironment> },
}

impl SessionLight {
    /// Fits a new environment and casts the shadow that it gives.
    fn follow(&mut self, environment: Option<&EnvironmentMap>, compositor: &mut Compositor) {
        if let (SessionLight::PerFrame { follower, prepared }, Some(environment)) = (self, environment) {
            *prepared = Arc::new(PreparedEnvironment::from_prefiltered(&follower.update(environment).prefiltered));
            compositor.set_light(prepared, |shadow| shadow.light_blurred(prepared));
        }
    }

    fn scene<'a>(&self, object: &'a ArObject<'a>, options: &ArOptions) -> Result<EnvironmentScene<'a>> {
        let (evaluator, prepared, light) = match self {
            SessionLight::Fixed(prepared) => (EvaluatorKind::Filtered, prepared, None),
            SessionLight::PerFrame { follower, prepared } => {
                (EvaluatorKind::SphericalGaussian, prepared, Some(follower.light().clone()))
            }
        };
        let &ArOptions { samples, taps, .. } = options;
        let options = EnvironmentOptions { evaluator, shadows: true, samples, taps };
        EnvironmentScene::new(&object.object, prepared.clone(), light, options)
    }
}

/// Finds the markers of each frame.
struct FrameTracker {
    tracker: MarkerTracker,
    /// Number of the next frame.
    frame: usize,
    size: [usize; 2],
}

impl FrameTracker {
    fn track(&mut self, plate: &Plate, curve: &SrgbCurve) -> Result<TrackedFrame> {
        let clock = Instant::now();
        let frame = self.frame;
        self.frame += 1;
        if plate.size() != self.size {
            let ([w, h], [width, height]) = (plate.size(), self.size);
            let message = format!("frame {frame} has {w} x {h} pixels, the calibration is of {width} x {height}");
            return Err(Error::parameter(message));
        }
        let grey = curve.grey(plate);
        let found = self.tracker.track(&grey)?;
        Ok(TrackedFrame { frame, grey, found, seconds: clock.elapsed().as_secs_f64() })
    }
}
