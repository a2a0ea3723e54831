//! An object in the frames of a camera: where it stands from markers, lit by the surroundings, with its shadow on the ground.
//!
//! A [`Session`] holds what stays from frame to frame; the caller owns the loop and hands it one frame after the other. Each goes through four
//! steps: **pose** ([`crate::marker`]), **light** (the surroundings, if they change), **render** ([`crate::relight`]) and **composite**
//! (shadow, object, the camera's gain and noise). See `spec/placing.md`.

mod assembly;
mod canvas;
mod compositor;
mod object_renderer;
pub(crate) mod placement;
mod plate;
mod sensor;
mod session;
mod y4m;

pub use assembly::ArAssembly;
pub use placement::{Placement, RigMount};
pub use plate::Plate;
pub use sensor::PAPER_ALBEDO;
pub use session::Session;
pub use y4m::{Y4mChroma, Y4mFrame, Y4mHeader, Y4mReader, Y4mWriter};

use crate::asset::Asset;
use crate::lighting::EnvironmentMap;
use crate::marker::PoseEstimate;
use crate::relight::{AssetRenderer, RenderObject, ShadingModel};

/// Object that is put into the frames.
pub struct ArObject<'a> {
    /// Mesh with its visibility.
    pub object: RenderObject<'a>,
    /// Reflectance of its surface.
    pub shading: &'a dyn ShadingModel,
    /// Position, rotation and scale in the world.
    pub placement: Placement,
    /// Photographs finer than its maps, for [`RenderMode::Offline`].
    pub detail: Option<(&'a AssetRenderer<'a>, &'a Asset)>,
}

/// Source of the light, in the object's own axes.
#[derive(Clone, Copy)]
pub enum LightSource<'a> {
    /// One environment for all frames.
    Fixed(&'a EnvironmentMap),
    /// Environments that come with the frames.
    PerFrame,
}

/// Trade-off between quality and frame rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RenderMode {
    /// Exact shadows and all detail, at about a second a frame.
    Offline,
    /// Many frames a second.
    Realtime,
}

/// Options of a [`Session`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArOptions {
    /// Position of the ground relative to the markers.
    pub mount: RigMount,
    /// Trade-off between quality and frame rate.
    pub mode: RenderMode,
    /// Samples of a pixel along each side, 1 to 8.
    pub samples: u32,
    /// Samples of the specular lobe, 1 or more.
    pub taps: usize,
    /// Whether exposure and white balance are read off the markers' paper; without it radiance 1 of the surroundings is 1 of the frames.
    pub match_white: bool,
    /// Factor of the object's brightness.
    pub gain: f32,
    /// Standard deviation of the noise on the object in display values, 0 to 255; `None`: as measured in each frame.
    pub noise: Option<f32>,
    /// Whether the object casts a shadow on the ground.
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

/// Durations of a frame's steps, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameTimes {
    /// The whole frame; pose and light are found at the same time.
    pub whole: f64,
    /// Finding the markers and their pose.
    pub pose: f64,
    /// Fitting and filtering the light.
    pub light: f64,
    /// Summing light on the object's vertices, and drawing it.
    pub render: f64,
    /// Shadow, blending, noise.
    pub composite: f64,
}

/// Result of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameReport {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Pose of the rig in the camera's axes; `None` if no marker was found and the frame is as it was.
    pub estimate: Option<PoseEstimate>,
    /// Factors of the surroundings' radiance, red, green, blue.
    pub gain: [f32; 3],
    /// Standard deviation of the noise added to the object, display values.
    pub noise: f32,
    /// Durations of the steps.
    pub times: FrameTimes,
}
