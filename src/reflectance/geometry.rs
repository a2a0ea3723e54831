//! Angles at a surface point between a light and a camera.

use crate::vector::direction;
use crate::vector::dot;
use crate::views::PointLight;

/// Smallest `cos(theta_r)` that the specular model divides by: beyond it (87 degrees) the model is cut off.
pub(crate) const MIN_COS_VIEW: f32 = 0.05;

/// Light and view seen from a surface point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReflectionGeometry {
    /// Irradiance of a surface that faces the light, `intensity / r^2`, red, green, blue.
    pub irradiance: [f32; 3],
    /// `N.L`, in `-1..=1`; the point is unlit where it is not positive.
    pub cos_light: f32,
    /// `N.V`, in `-1..=1`; the point is unseen where it is not positive.
    pub cos_view: f32,
    /// Cosine of `alpha`.
    pub cos_half: f32,
    /// Angle between the normal and the half vector `(L + V) / |L + V|`, radians.
    pub alpha: f32,
    /// Angle between the half vector and either direction, radians.
    pub difference: f32,
    /// Cosine of `difference`.
    pub cos_difference: f32,
}

impl ReflectionGeometry {
    /// The geometry of a world point with a unit normal, a camera's centre and a point light.
    pub fn new(point: [f64; 3], normal: [f64; 3], camera_centre: [f64; 3], light: &PointLight) -> Self {
        let (to_light, squared) = direction(point, light.position);
        let (to_view, _) = direction(point, camera_centre);
        let half: [f64; 3] = std::array::from_fn(|i| to_light[i] + to_view[i]);
        let length = dot(half, half).sqrt();
        let cos_half = if length > 0.0 { dot(normal, half) / length } else { 0.0 };
        ReflectionGeometry {
            irradiance: light.intensity.map(|l| if squared > 0.0 { (l / squared) as f32 } else { 0.0 }),
            cos_light: dot(normal, to_light) as f32,
            cos_view: dot(normal, to_view) as f32,
            cos_half: cos_half.clamp(-1.0, 1.0) as f32,
            alpha: cos_half.clamp(-1.0, 1.0).acos() as f32,
            difference: (0.5 * length).clamp(0.0, 1.0).acos() as f32,
            cos_difference: (0.5 * length).clamp(0.0, 1.0) as f32,
        }
    }
}
