//! Shadow and object over a frame, with the camera's gain and noise.

use super::canvas::{self, LensCanvas};
use super::object_renderer::ObjectRenderer;
use super::plate::{Plate, SrgbCurve};
use super::sensor::{self, PAPER_ALBEDO};
use super::{ArObject, ArOptions, FrameReport, FrameTimes};
use crate::capture::calibration::Calibration;
use crate::error::Result;
use crate::image::{Grid, Mask};
use crate::marker::PoseEstimate;
use crate::marker::detection::MarkerDetection;
use crate::relight::{GroundShadow, PreparedEnvironment};
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

    /// Puts the object into a frame; `times` has the steps before.
    pub(super) fn composite(
        &mut self,
        renderer: &mut ObjectRenderer,
        curve: &SrgbCurve,
        plate: &mut Plate,
        nearer: Option<&Mask>,
        TrackedFrame { frame, grey, found, .. }: TrackedFrame,
        mut times: FrameTimes,
    ) -> Result<FrameReport> {
        let Some((estimate, detections)) = found else {
            let gain = self.gain.unwrap_or([1.0; 3]);
            times.render = 0.0;
            return Ok(FrameReport { frame, estimate: None, gain, noise: 0.0, times });
        };
        let rig_of_world = self.options.mount.rig_of_world();
        let camera = self.object.placement.camera(&self.canvas.camera, &estimate.pose, &rig_of_world);

        let clock = Instant::now();
        let window = canvas::window_around(self.object.object.mesh(), &camera);
        let object = match window {
            Some(window) => Some((window, renderer.render(self.object, &canvas::cropped(&camera, window))?)),
            None => None,
        };
        times.render += clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let before = nearer.map(|nearer| (nearer, plate.clone()));
        let gain = self.update_gain(curve, plate, &detections).map(|c| c * self.options.gain);
        if self.options.shadow {
            self.canvas.blend_shadow(&self.shadow, &camera, curve, plate);
        }
        let noise = self.options.noise.unwrap_or_else(|| sensor::noise_sigma(&grey));
        if let Some((window, object)) = &object {
            self.canvas.blend_object(object, *window, gain, (noise, frame as u32), curve, plate);
        }
        if let Some((nearer, before)) = &before {
            plate.restore(before, nearer)?;
        }
        times.composite = clock.elapsed().as_secs_f64();
        Ok(FrameReport { frame, estimate: Some(estimate), gain, noise, times })
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
