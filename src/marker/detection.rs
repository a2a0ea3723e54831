//! A marker found in an image.

use super::MarkerFamily;

/// A marker in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerDetection {
    /// Its family.
    pub family: MarkerFamily,
    /// Its number within the family.
    pub id: u32,
    /// Corners in pixels (centres at +0.5): upper left, upper right, lower right, lower left, as the marker is printed.
    pub corners: [[f64; 2]; 4],
}

/// Area of a marker in an image, in pixels.
pub(super) fn area(detection: &MarkerDetection) -> f64 {
    let c = &detection.corners;
    let twice: f64 = (0..4).map(|k| c[k][0] * c[(k + 1) % 4][1] - c[k][1] * c[(k + 1) % 4][0]).sum();
    0.5 * twice.abs()
}
