//! Lens distortion, and pictures without it.

use crate::image::{Mask, RgbImage};
use crate::views::Camera;

/// Lens model: maps the ideal image position `(x, y) = (q.x / q.z, q.y / q.z)` before focal length and principal point apply.
/// The models and coefficient orders are OpenCV's and COLMAP's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Lens {
    /// A pinhole.
    #[default]
    Pinhole,
    /// With `r2 = x^2 + y^2`: `(x, y) * (1 + k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4) / (1 + d1 r2 + d2 r2^2 + d3 r2^3)` plus
    /// `(2 p1 x y + p2 (r2 + 2 x^2), p1 (r2 + 2 y^2) + 2 p2 x y)`; then `x + shear y` for `x`.
    Radial {
        /// `k1 k2 k3 k4`.
        numerator: [f64; 4],
        /// `d1 d2 d3` (COLMAP's FULL_OPENCV `k4 k5 k6`).
        denominator: [f64; 3],
        /// `p1 p2`.
        tangential: [f64; 2],
        /// Skew of the pixels over the focal length of the rows.
        shear: f64,
    },
    /// `(x, y) * theta_d / r`, `theta = atan r`, `theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`.
    Fisheye {
        /// `k1 k2 k3 k4`.
        coefficients: [f64; 4],
    },
    /// `(x, y) * atan(2 r tan(omega / 2)) / (omega r)` (Devernay and Faugeras 2001, equation 13).
    FieldOfView {
        /// Angle in radians, above 0 and below pi.
        omega: f64,
    },
    /// `(x, y) * 2 / (1 + sqrt(1 - 4 k r^2))`, the inverse of a division by `1 + k r^2` (Fitzgibbon 2001).
    Division {
        /// `k`.
        coefficient: f64,
    },
}

impl Lens {
    /// Returns `true` if the lens distorts nothing.
    pub fn is_pinhole(&self) -> bool {
        match self {
            Lens::Pinhole => true,
            Lens::Radial { numerator, denominator, tangential, shear } => {
                numerator.iter().chain(denominator).chain(tangential).chain([shear]).all(|&k| k == 0.0)
            }
            Lens::Division { coefficient } => *coefficient == 0.0,
            Lens::Fisheye { .. } | Lens::FieldOfView { .. } => false,
        }
    }

    /// Returns the distorted position of an ideal image position (both in focal lengths from the principal point).
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        let scale = self.radial_scale(square.sqrt());
        let ([p1, p2], shear) = match self {
            Lens::Radial { tangential, shear, .. } => (*tangential, *shear),
            _ => ([0.0; 2], 0.0),
        };
        let across = x * scale + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x);
        let down = y * scale + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y;
        [across + shear * down, down]
    }

    /// The ideal image position that the lens puts at `distorted`, by Newton's method; `None` where there is none.
    pub fn undistort(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        let mut ideal = match self {
            Lens::Pinhole => return Some(distorted),
            Lens::Fisheye { .. } => {
                // Starting from the lens without coefficients: r = tan theta.
                let theta = distorted[0].hypot(distorted[1]);
                let scale = if theta > 1e-9 { theta.min(1.5).tan() / theta } else { 1.0 };
                distorted.map(|c| c * scale)
            }
            Lens::Radial { .. } => distorted,
            Lens::FieldOfView { omega } => {
                let radius = distorted[0].hypot(distorted[1]);
                let ideal = (radius * omega).min(1.5).tan() / (2.0 * (0.5 * omega).tan());
                distorted.map(|c| if radius > 1e-9 { c * ideal / radius } else { c })
            }
            Lens::Division { coefficient } => {
                let scale = 1.0 / (1.0 + coefficient * (distorted[0].powi(2) + distorted[1].powi(2)));
                distorted.map(|c| c * scale)
            }
        };
        for _ in 0..50 {
            let at = self.distort(ideal);
            let miss = [distorted[0] - at[0], distorted[1] - at[1]];
            let size = 1.0 + ideal[0].abs() + ideal[1].abs();
            if miss[0].abs() + miss[1].abs() < 1e-13 * size {
                break;
            }
            let h = 1e-6 * size;
            let column = |dx: f64, dy: f64| {
                let plus = self.distort([ideal[0] + dx, ideal[1] + dy]);
                let minus = self.distort([ideal[0] - dx, ideal[1] - dy]);
                [(plus[0] - minus[0]) / (2.0 * h), (plus[1] - minus[1]) / (2.0 * h)]
            };
            let (u, v) = (column(h, 0.0), column(0.0, h));
            let determinant = u[0] * v[1] - v[0] * u[1];
            ideal[0] += (v[1] * miss[0] - v[0] * miss[1]) / determinant;
            ideal[1] += (u[0] * miss[1] - u[1] * miss[0]) / determinant;
        }
        let at = self.distort(ideal);
        let miss = (at[0] - distorted[0]).hypot(at[1] - distorted[1]);
        let radius = ideal[0].hypot(ideal[1]);
        (miss < 1e-9 && radius <= self.radius_limit(radius, 64)).then_some(ideal)
    }

    fn radial_scale(&self, radius: f64) -> f64 {
        match self {
            Lens::Pinhole => 1.0,
            Lens::Radial { numerator: k, denominator: d, .. } => {
                let s = radius * radius;
                (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))) / (1.0 + s * (d[0] + s * (d[1] + s * d[2])))
            }
            Lens::Fisheye { coefficients: k } => {
                let theta = radius.atan();
                let s = theta * theta;
                let bent = theta * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
                if radius > 1e-12 { bent / radius } else { 1.0 }
            }
            Lens::FieldOfView { omega } => {
                let slope = 2.0 * (0.5 * omega).tan();
                if radius > 1e-9 { (slope * radius).atan() / (omega * radius) } else { slope / omega }
            }
            // Beyond its largest radius nothing is seen: not a number.
            Lens::Division { coefficient } => 2.0 / (1.0 + (1.0 - 4.0 * coefficient * radius * radius).sqrt()),
        }
    }

    /// The ideal radius up to which the distorted one grows; beyond it the polynomial folds back and means nothing.
    fn radius_limit(&self, largest: f64, steps: u32) -> f64 {
        let mut before = (0.0, 0.0);
        for step in 1..=steps {
            // Even steps of the angle resolve wide fields and narrow ones alike.
            let radius = if step == steps { largest } else { (largest.atan() * step as f64 / steps as f64).tan() };
            let bent = radius * self.radial_scale(radius);
            if bent.is_nan() || (bent <= before.1 && radius > 0.0) {
                return before.0;
            }
            before = (radius, bent);
        }
        largest
    }

    /// For every pixel of a pinhole camera of the same size the position in the photograph, in pixels (centres at +0.5).
    fn source_positions(&self, camera: &Camera, mut visit: impl FnMut(usize, Option<[f64; 2]>)) {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ideal =
            |x: f64, y: f64| [(x - camera.principal[0]) / camera.focal[0], (y - camera.principal[1]) / camera.focal[1]];
        let corners = [(0.0, 0.0), (width as f64, 0.0), (0.0, height as f64), (width as f64, height as f64)];
        let largest = corners.iter().map(|&(x, y)| ideal(x, y)).map(|[x, y]| x.hypot(y)).fold(0.0, f64::max);
        let limit = self.radius_limit(largest, 4096);
        for y in 0..height {
            for x in 0..width {
                let p = ideal(x as f64 + 0.5, y as f64 + 0.5);
                let position = (p[0].hypot(p[1]) <= limit).then(|| {
                    let q = self.distort(p);
                    [q[0] * camera.focal[0] + camera.principal[0], q[1] * camera.focal[1] + camera.principal[1]]
                });
                visit(y * width + x, position);
            }
        }
    }

    /// The photograph that a pinhole of the same size and focal length would have taken: Catmull-Rom interpolation of linear
    /// radiance. Missing (NaN) pixels weigh nothing; a pixel is missing where its nearest one is, and beyond the photograph.
    pub fn undistort_image(&self, camera: &Camera, image: &RgbImage) -> RgbImage {
        let mut result = RgbImage::filled(image.width, image.height, [f32::NAN; 3]);
        self.source_positions(camera, |index, position| {
            if let Some(pixel) = position.and_then(|p| interpolate(image, p)) {
                result.data[index] = pixel;
            }
        });
        result
    }

    /// Removes the distortion from a mask: bilinear, set from one half on; not set beyond the photograph.
    pub fn undistort_mask(&self, camera: &Camera, mask: &Mask) -> Mask {
        let mut result = Mask::filled(mask.width, mask.height, false);
        self.source_positions(camera, |index, position| {
            let Some([x, y]) = position else { return };
            if !(0.0..mask.width as f64).contains(&x) || !(0.0..mask.height as f64).contains(&y) {
                return;
            }
            let (x, y) = (x - 0.5, y - 0.5);
            let (left, top) = (x.floor(), y.floor());
            let (u, v) = (x - left, y - top);
            let at = |dx: f64, dy: f64| {
                let column = (left + dx).clamp(0.0, mask.width as f64 - 1.0) as usize;
                let row = (top + dy).clamp(0.0, mask.height as f64 - 1.0) as usize;
                *mask.value_at(column, row) as u8 as f64
            };
            let upper = at(0.0, 0.0) * (1.0 - u) + at(1.0, 0.0) * u;
            let lower = at(0.0, 1.0) * (1.0 - u) + at(1.0, 1.0) * u;
            result.data[index] = upper * (1.0 - v) + lower * v >= 0.5;
        });
        result
    }
}

/// Catmull-Rom weights of the four samples around a fraction.
fn cubic_weights(t: f64) -> [f64; 4] {
    [
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    ]
}

fn interpolate(image: &RgbImage, [x, y]: [f64; 2]) -> Option<[f32; 3]> {
    if !(0.0..image.width as f64).contains(&x) || !(0.0..image.height as f64).contains(&y) {
        return None;
    }
    if image.value_at(x as usize, y as usize)[0].is_nan() {
        return None;
    }
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (across, down) = (cubic_weights(x - 0.5 - left), cubic_weights(y - 0.5 - top));
    let (left, top) = (left as i64 - 1, top as i64 - 1);
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (row, wy) in (top..).zip(down) {
        for (column, wx) in (left..).zip(across) {
            if row < 0 || column < 0 || row >= image.height as i64 || column >= image.width as i64 {
                continue;
            }
            let pixel = image.value_at(column as usize, row as usize);
            if pixel[0].is_nan() {
                continue;
            }
            weights += wx * wy;
            (0..3).for_each(|c| sum[c] += wx * wy * pixel[c] as f64);
        }
    }
    // With few neighbours left the nearest pixel says more than an extrapolation.
    if weights < 0.5 {
        return Some(*image.value_at(x as usize, y as usize));
    }
    Some(sum.map(|s| (s / weights) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> [Lens; 6] {
        [
            Lens::Radial {
                numerator: [-0.12, 0.02, 0.0, 0.0],
                denominator: [0.0; 3],
                tangential: [0.002, -0.001],
                shear: 0.003,
            },
            Lens::Radial { numerator: [0.08, 0.0, 0.0, 0.0], denominator: [0.0; 3], tangential: [0.0; 2], shear: 0.0 },
            Lens::Radial {
                numerator: [0.1, 0.02, 0.01, 0.0],
                denominator: [0.2, 0.01, 0.0],
                tangential: [0.0; 2],
                shear: 0.0,
            },
            Lens::Fisheye { coefficients: [0.03, -0.01, 0.002, 0.0] },
            Lens::FieldOfView { omega: 0.5 },
            Lens::Division { coefficient: -0.05 },
        ]
    }

    #[test]
    fn distort_and_undistort_are_inverse() {
        for lens in lenses() {
            for i in 0..21 {
                for j in 0..21 {
                    let ideal = [(i as f64 - 10.0) * 0.07, (j as f64 - 10.0) * 0.06];
                    let back = lens.undistort(lens.distort(ideal)).unwrap();
                    assert!((back[0] - ideal[0]).hypot(back[1] - ideal[1]) < 1e-9, "{lens:?} {ideal:?} {back:?}");
                }
            }
        }
    }

    #[test]
    fn known_values() {
        // Worked by hand from the equations.
        let lens = Lens::Radial {
            numerator: [0.1, 0.0, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [0.01, 0.02],
            shear: 0.0,
        };
        let [x, y] = lens.distort([0.5, 0.2]);
        assert!((x - (0.5 * 1.029 + 0.002 + 0.02 * 0.79)).abs() < 1e-12);
        assert!((y - (0.2 * 1.029 + 0.01 * 0.37 + 0.004)).abs() < 1e-12);
        let equidistant = Lens::Fisheye { coefficients: [0.0; 4] };
        let [x, _] = equidistant.distort([1.0, 0.0]);
        assert!((x - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    }

    #[test]
    fn a_distorted_photograph_comes_back_as_the_pinhole_one() {
        let camera =
            Camera { width: 160, height: 120, focal: [150.0, 148.0], principal: [82.0, 58.5], ..Camera::default() };
        // A smooth scene as a function of the ideal image position; the photograph samples it through the lens.
        let scene = |p: [f64; 2]| -> [f32; 3] {
            [1.0 + 0.5 * (9.0 * p[0]).sin(), 1.0 + 0.5 * (8.0 * p[1]).cos(), 1.0 + p[0] * p[1]].map(|v| v as f32)
        };
        let ideal = |x: usize, y: usize| {
            [
                (x as f64 + 0.5 - camera.principal[0]) / camera.focal[0],
                (y as f64 + 0.5 - camera.principal[1]) / camera.focal[1],
            ]
        };
        for lens in lenses() {
            let mut photograph = RgbImage::filled(160, 120, [0.0; 3]);
            let mut mask = Mask::filled(160, 120, false);
            for y in 0..120 {
                for x in 0..160 {
                    let p = lens.undistort(ideal(x, y)).unwrap_or([9.0, 9.0]);
                    *photograph.value_at_mut(x, y) = scene(p);
                    *mask.value_at_mut(x, y) = p[0].hypot(p[1]) < 0.25;
                }
            }
            *photograph.value_at_mut(80, 60) = [f32::NAN; 3];
            let straight = lens.undistort_image(&camera, &photograph);
            let straight_mask = lens.undistort_mask(&camera, &mask);
            let (mut worst, mut missing, mut wrong_mask) = (0.0f32, 0, 0);
            for y in 4..116 {
                for x in 4..156 {
                    let (found, expected) = (straight.value_at(x, y), scene(ideal(x, y)));
                    if found[0].is_nan() {
                        missing += 1;
                    } else {
                        (0..3).for_each(|c| worst = worst.max((found[c] - expected[c]).abs()));
                    }
                    let radius = ideal(x, y)[0].hypot(ideal(x, y)[1]);
                    let farther_than_a_pixel = (radius - 0.25).abs() * 150.0 > 1.0;
                    wrong_mask += (farther_than_a_pixel && (radius < 0.25) != *straight_mask.value_at(x, y)) as usize;
                }
            }
            assert!(worst < 4e-3, "{lens:?}: {worst}");
            assert!(wrong_mask == 0, "{lens:?}: {wrong_mask}");
            // The NaN pixel stays one missing pixel or so; pincushion lenses also lose a border.
            assert!(missing >= 1, "{lens:?}");
            let near = (78..83).flat_map(|x| (58..63).map(move |y| (x, y)));
            let holes = near.filter(|&(x, y)| straight.value_at(x, y)[0].is_nan()).count();
            assert!((1..=2).contains(&holes), "{lens:?}: {holes}");
        }
    }

    #[test]
    fn the_fold_of_a_polynomial_is_missing_not_wrong() {
        let lens =
            Lens::Radial { numerator: [-0.5, 0.0, 0.0, 0.0], denominator: [0.0; 3], tangential: [0.0; 2], shear: 0.0 };
        // r (1 - 0.5 r^2) turns at r = sqrt(2/3).
        assert!((lens.radius_limit(2.0, 4096) - (2.0f64 / 3.0).sqrt()).abs() < 2e-3);
        let camera = Camera { width: 40, height: 40, focal: [10.0; 2], principal: [20.0; 2], ..Camera::default() };
        let straight = lens.undistort_image(&camera, &RgbImage::filled(40, 40, [1.0; 3]));
        assert!(straight.value_at(1, 1)[0].is_nan());
        assert_eq!(*straight.value_at(20, 20), [1.0; 3]);
    }
}
