//! Cameras, lights and photographs, and the VIEW section that holds them.

pub(crate) mod codec;
#[cfg(feature = "encode")]
pub(crate) mod source;

use crate::image::{Mask, Region, RgbImage};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A pinhole camera. Pixel (0, 0) covers `0..1` in both directions, centre 0.5.
///
/// OpenCV axes: x right, y down, z forward. A world point `p` has camera coordinates `q = rotation * p + translation`
/// and the image position `(fx q.x / q.z + cx, fy q.y / q.z + cy)`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Camera {
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub principal: [f64; 2],
    /// World to camera, rows.
    pub rotation: [[f64; 3]; 3],
    /// World to camera.
    pub translation: [f64; 3],
}

impl Camera {
    /// World to camera coordinates.
    pub fn to_camera(&self, p: [f64; 3]) -> [f64; 3] {
        let r = &self.rotation;
        std::array::from_fn(|i| r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2] + self.translation[i])
    }
    /// Image position in pixels and depth of a world point; `None` behind the camera.
    pub fn project(&self, p: [f64; 3]) -> Option<([f64; 2], f64)> {
        let q = self.to_camera(p);
        (q[2] > 0.0).then(|| {
            ([self.focal[0] * q[0] / q[2] + self.principal[0], self.focal[1] * q[1] / q[2] + self.principal[1]], q[2])
        })
    }
    /// Returns the camera of the same view in an image of another size (width, height) and of `factor` times as many pixels to a length,
    /// across and down.
    pub fn scaled(&self, [width, height]: [u32; 2], factor: [f64; 2]) -> Camera {
        let [focal, principal] =
            [self.focal, self.principal].map(|values| std::array::from_fn(|k| values[k] * factor[k]));
        Camera { width, height, focal, principal, ..*self }
    }
    /// Returns the camera of the same view in an image of another size, width and height in pixels.
    pub(crate) fn resized(&self, size: [u32; 2]) -> Camera {
        let factor = [f64::from(size[0]) / f64::from(self.width), f64::from(size[1]) / f64::from(self.height)];
        self.scaled(size, factor)
    }
    /// Returns the camera of the same view in an image no side of which is longer than `longest` pixels.
    #[cfg(feature = "encode")]
    pub(crate) fn reduced(&self, longest: f64) -> Camera {
        let scale = (longest / f64::from(self.width.max(self.height))).min(1.0);
        self.resized([self.width, self.height].map(|side| ((f64::from(side) * scale).round() as u32).max(1)))
    }
    /// Returns the camera of a region of its image.
    pub fn cropped(&self, region: &Region) -> Camera {
        let [x, y] = self.principal;
        let principal = [x - f64::from(region.left), y - f64::from(region.top)];
        Camera { width: region.width, height: region.height, principal, ..*self }
    }
    /// The camera's place in the world.
    pub fn centre(&self) -> [f64; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]))
    }
    /// World direction (depth 1, not unit) of the ray through an image position.
    pub fn ray(&self, pixel: [f64; 2]) -> [f64; 3] {
        let q = [(pixel[0] - self.principal[0]) / self.focal[0], (pixel[1] - self.principal[1]) / self.focal[1], 1.0];
        let r = &self.rotation;
        std::array::from_fn(|i| r[0][i] * q[0] + r[1][i] * q[1] + r[2][i] * q[2])
    }
}

/// A point light: irradiance at distance `r` is `intensity / r^2`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PointLight {
    /// World position.
    pub position: [f64; 3],
    /// Radiant intensity, red, green, blue.
    pub intensity: [f64; 3],
}

/// One captured photograph's circumstances: a camera and, where it is known, its light.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name of the photograph, as the capture calls it.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
    /// Its light, where known.
    pub light: Option<PointLight>,
}

impl View {
    /// Returns the rotation, a unit quaternion x, y, z, w, that maps the photographs' mean up direction to +Y; `None` if that is already
    /// within 45 degrees of it.
    pub fn upright_rotation(views: &[View]) -> Option<[f32; 4]> {
        let up: DVec3 = views.iter().map(|view| -DVec3::from_array(view.camera.rotation[1])).sum();
        let up = up.try_normalize().filter(|up| up.y < 0.7)?;
        Some(DQuat::from_rotation_arc(up, DVec3::Y).normalize().as_quat().normalize().to_array())
    }
}

/// Component of reflection that a set of photographs shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Component {
    /// Diffuse reflection: the cross-polarised photograph over the board's `beta`.
    Diffuse,
    /// Specular reflection: unpolarised minus diffuse. Signed.
    Specular,
    /// Both together, of a capture without polarisers.
    Combined,
}

/// Pixels of a view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Photograph {
    /// Pixels that show the object.
    pub mask: Mask,
    /// Linear radiance per component, parallel to [`crate::asset::Asset::components`]; zero outside the mask.
    pub images: Vec<RgbImage>,
}

impl Photograph {
    /// Returns the part in a region, which lies within the photograph.
    pub fn cropped(&self, region: &Region) -> Photograph {
        Photograph {
            mask: self.mask.cropped(region),
            images: self.images.iter().map(|image| image.cropped(region)).collect(),
        }
    }
}

#[cfg(feature = "encode")]
impl Photograph {
    /// Returns the sum of all components in linear radiance; specular radiance below zero counts as 0.
    pub fn sum(&self) -> RgbImage {
        let mut images = self.images.iter();
        let mut sum = images.next().cloned().unwrap_or_default();
        for image in images {
            for (total, pixel) in sum.data.iter_mut().zip(&image.data) {
                (0..3).for_each(|c| total[c] += pixel[c].max(0.0));
            }
        }
        sum
    }
}
