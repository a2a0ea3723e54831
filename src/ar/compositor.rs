//! Shadow and object over a frame, with the camera's gain and noise.

use super::canvas::{self, CanvasWindow, LensCanvas};
use super::object_renderer::ObjectRenderer;
use super::plate::{Plate, SrgbCurve};
use super::sensor::{self, PAPER_ALBEDO};
use super::{ArObject, ArOptions, FrameReport, FrameTimes};
use crate::capture::calibration::Calibration;
use crate::error::Result;
use crate::image::Grid;
use crate::marker::PoseEstimate;
use crate::marker::detection::MarkerDetection;
use crate::relight::{GroundShadow, PreparedEnvironment, RealtimeFrame};
use crate::views::Camera;
use std::borrow::Cow;
use std::time::Instant;

/// Part of a new frame's gain in the one that is used.
const GAIN_STEP: f32 = 0.2;

/// A frame and its markers.
pub(super) struct TrackedFrame {
    pub(super) frame: usize,
    pub(super) grey: Grid<u8>,
    pub(super) found: Option<(PoseEstimate, Vec<MarkerDetection>)>,
    pub(super) seconds: f64,
}

/// An object as a frame's camera sees it.
pub(super) struct ObjectView<'r> {
    pub(super) report: FrameReport,
    /// That the object's shadow is seen by; `None` where its marker is not.
    camera: Option<Camera>,
    object: Option<(CanvasWindow, Cow<'r, RealtimeFrame>)>,
    /// From the camera to the object's middle, in the unit of the marker's size.
    pub(super) distance: f64,
}

/// Blends the object and its shadow with frames.
pub(super) struct Compositor<'a> {
    pub(super) object: &'a ArObject<'a>,
    pub(super) options: ArOptions,
    canvas: LensCanvas,
    shadow: GroundShadow<'a>,
    gain: Option<[f32; 3]>,
    paper_irradiance: [f32; 3],
}

impl<'a> Compositor<'a> {
    pub(super) fn new(object: &'a ArObject<'a>, calibration: &Calibration, options: ArOptions) -> Result<Self> {
        let shadow = GroundShadow::new(object.object.mesh(), &object.placement.ground())?;
        let canvas = LensCanvas::new(calibration);
        Ok(Compositor { object, options, canvas, shadow, gain: None, paper_irradiance: [0.0; 3] })
    }

    /// Takes the light that the markers' paper is under; `cast` gives it to the shadow.
    pub(super) fn set_light(&mut self, prepared: &PreparedEnvironment, cast: impl FnOnce(&mut GroundShadow)) {
        // The markers' print faces the world's +Y, or stands.
        let out_of_paper = self.options.mount.rig_of_world().inverse().transform_point([0.0, 0.0, 1.0]);
        self.paper_irradiance = prepared.irradiance(self.object.placement.to_local(out_of_paper).map(|x| x as f32));
        cast(&mut self.shadow);
        self.shadow.keep();
    }

    /// Draws the object as the frame's camera sees it, and reads the frame's gain and noise; `times` has the steps before.
    pub(super) fn look<'r>(
        &mut self,
        renderer: &'r mut ObjectRenderer,
        curve: &SrgbCurve,
        plate: &Plate,
        TrackedFrame { frame, grey, found, .. }: TrackedFrame,
        mut times: FrameTimes,
    ) -> Result<ObjectView<'r>> {
        let Some((estimate, detections)) = found else {
            let gain = self.gain.unwrap_or([1.0; 3]);
            times.render = 0.0;
            let report = FrameReport { frame, estimate: None, gain, noise: 0.0, times };
            return Ok(ObjectView { report, camera: None, object: None, distance: f64::MAX });
        };
        let rig_of_world = self.options.mount.rig_of_world();
        let placement = &self.object.placement;
        let camera = placement.camera(&self.canvas.camera, &estimate.pose, &rig_of_world);

        let clock = Instant::now();
        let mesh = self.object.object.mesh();
        let object = match canvas::window_around(mesh, &camera) {
            Some(window) => Some((window, renderer.render(self.object, &canvas::cropped(&camera, window))?)),
            None => None,
        };
        times.render += clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let gain = self.update_gain(curve, plate, &detections).map(|c| c * self.options.gain);
        let noise = self.options.noise.unwrap_or_else(|| sensor::noise_sigma(&grey));
        times.composite = clock.elapsed().as_secs_f64();
        let (middle, _) = mesh.bounding_sphere();
        let centre = camera.centre();
        let distance = (0..3).map(|k| (middle[k] - centre[k]).powi(2)).sum::<f64>().sqrt() * placement.scale;
        let report = FrameReport { frame, estimate: Some(estimate), gain, noise, times };
        Ok(ObjectView { report, camera: Some(camera), object, distance })
    }

    /// Darkens the ground.
    pub(super) fn blend_shadow(&self, view: &mut ObjectView, curve: &SrgbCurve, plate: &mut Plate) {
        let clock = Instant::now();
        if let (Some(camera), true) = (&view.camera, self.options.shadow) {
            self.canvas.blend_shadow(&self.shadow, camera, curve, plate);
        }
        view.report.times.composite += clock.elapsed().as_secs_f64();
    }

    /// Puts the object over the frame.
    pub(super) fn blend_object(&self, view: &mut ObjectView, curve: &SrgbCurve, plate: &mut Plate) {
        let clock = Instant::now();
        let FrameReport { frame, gain, noise, .. } = view.report;
        if let Some((window, object)) = &view.object {
            self.canvas.blend_object(object, *window, gain, (noise, frame as u32), curve, plate);
        }
        view.report.times.composite += clock.elapsed().as_secs_f64();
    }

    /// Updates and returns the factors of the surroundings' radiance that make the markers' paper as bright as the frame shows it.
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
