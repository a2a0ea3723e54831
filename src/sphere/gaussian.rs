//! Spherical Gaussians: `G(v) = m exp(l (v.p - 1))` with axis `p`, sharpness `l` and amplitude `m`.
//!
//! Wang et al. 2009; the visibility of a half-space also after Tokuyoshi 2022. Functions with suffix `_wang` take the fit that Sonoda 2011
//! uses.

use crate::vector::dot;
use std::f64::consts::PI;

/// A spherical Gaussian of three colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalGaussian {
    /// Unit vector to the middle.
    pub axis: [f64; 3],
    /// Sharpness, not negative; 0 is constant.
    pub sharpness: f64,
    /// Value on the axis, linear red, green, blue.
    pub amplitude: [f64; 3],
}

/// Sharpness and amplitude of the clamped cosine as one lobe (Wang 2009).
pub(crate) const CLAMPED_COSINE: (f64, f64) = (2.133, 1.170);

/// Sub-lobes of [`SphericalGaussian::split`].
pub(crate) const SPLIT: usize = 7;

impl SphericalGaussian {
    /// One with the same amplitude in all colours.
    pub fn grey(axis: [f64; 3], sharpness: f64, amplitude: f64) -> Self {
        SphericalGaussian { axis, sharpness, amplitude: [amplitude; 3] }
    }

    /// The clamped cosine about a normal as one lobe, 8 % too bright in all, largest error 0.17 (Wang 2009).
    pub fn clamped_cosine(normal: [f64; 3]) -> Self {
        Self::grey(normal, CLAMPED_COSINE.0, CLAMPED_COSINE.1)
    }

    /// Value in a unit direction.
    pub fn evaluate(&self, direction: [f64; 3]) -> [f64; 3] {
        let value = (self.sharpness * (dot(self.axis, direction) - 1.0)).exp();
        self.amplitude.map(|m| m * value)
    }

    /// Integral over the sphere.
    pub fn integral(&self) -> [f64; 3] {
        let sphere = sphere_integral(self.sharpness);
        self.amplitude.map(|m| m * sphere)
    }

    /// The product of two, a spherical Gaussian again.
    pub fn product(&self, other: &Self) -> Self {
        let (axis, sharpness, exponent) = product(self.axis, self.sharpness, other.axis, other.sharpness);
        let scale = exponent.exp();
        let amplitude = std::array::from_fn(|c| self.amplitude[c] * other.amplitude[c] * scale);
        SphericalGaussian { axis, sharpness, amplitude }
    }

    /// Integral of the product of two over the sphere.
    pub fn inner_product(&self, other: &Self) -> [f64; 3] {
        // 2 pi exp(d - l1 - l2) (1 - exp(-2 d)) / d, the sharpness of the product being d.
        self.product(other).integral()
    }

    /// Integral over the half-space whose boundary lies at the signed angle `distance` from the axis (positive: the axis is within),
    /// -pi/2 to pi/2. Error at most 0.44 % of the lobe (Tokuyoshi 2022).
    pub fn visible(&self, distance: f64) -> [f64; 3] {
        let part = half_space(self.sharpness, distance.clamp(-PI / 2.0, PI / 2.0).sin());
        self.amplitude.map(|m| m * part)
    }

    /// Returns the visible integral by Wang's logistic fit, error 2.5 % of the lobe for sharpness 5 to 1312.
    pub fn visible_wang(&self, distance: f64) -> [f64; 3] {
        let part = half_space_wang(self.sharpness, distance);
        self.amplitude.map(|m| m * part)
    }

    /// Returns the lobe as visibility leaves it: axis and sharpness stay, the amplitude is scaled. `distance` is the signed spherical
    /// distance of the visibility at the axis.
    pub fn shadowed(&self, distance: f64) -> Self {
        self.scaled(visible_share(self.sharpness, distance))
    }

    /// Returns the lobe as visibility leaves it, by Wang's fit.
    pub fn shadowed_wang(&self, distance: f64) -> Self {
        let whole = half_space_wang(self.sharpness, PI / 2.0);
        self.scaled(half_space_wang(self.sharpness, distance) / whole)
    }

    /// With the amplitude scaled.
    pub fn scaled(&self, scale: f64) -> Self {
        SphericalGaussian { amplitude: self.amplitude.map(|m| m * scale), ..*self }
    }

    /// Integral of the lobe times the cosine to the normal over the upper hemisphere: `1182.25 (exp(0.000845609 z) - 1)` is the
    /// cosine to 1e-4 (Tokuyoshi 2022).
    pub fn irradiance(&self, normal: [f64; 3]) -> [f64; 3] {
        let (axis, sharpness, exponent) = product(self.axis, self.sharpness, normal, COSINE_SHARPNESS);
        let with = (exponent + COSINE_SHARPNESS).exp() * half_space(sharpness, dot(axis, normal));
        let without = half_space(self.sharpness, dot(self.axis, normal));
        let part = (COSINE_AMPLITUDE * (with - without)).max(0.0);
        self.amplitude.map(|m| m * part)
    }

    /// Splits the lobe into one on its axis and six on a ring around it, each three times as sharp, equal integrals, the same integral in all.
    /// Halves the error of the half-space assumption for sharpness up to about 82.
    pub fn split(&self) -> [Self; SPLIT] {
        let sharpness = 3.0 * self.sharpness;
        let share = sphere_integral(self.sharpness) / (SPLIT as f64 * sphere_integral(sharpness));
        let radius = (2.0 * (1.0 - 1.0 / 3.0) / self.sharpness.max(1e-3) / (6.0 / 7.0)).sqrt().min(PI / 2.0);
        let (sine, cosine) = radius.sin_cos();
        let (x, y) = tangents(self.axis);
        let middle = SphericalGaussian { sharpness, ..self.scaled(share) };
        std::array::from_fn(|k| {
            if k == 0 {
                return middle;
            }
            let (s, c) = (PI / 3.0 * k as f64).sin_cos();
            let axis = std::array::from_fn(|i| cosine * self.axis[i] + sine * (c * x[i] + s * y[i]));
            SphericalGaussian { axis, ..middle }
        })
    }
}

const COSINE_SHARPNESS: f64 = 0.000_845_608_722_414_801_2;
const COSINE_AMPLITUDE: f64 = 1_182.246_733_967_815_3;

/// Integral of `exp(l (v.p - 1))` over the sphere, `2 pi / l (1 - exp(-2 l))`.
pub(crate) fn sphere_integral(sharpness: f64) -> f64 {
    4.0 * PI * falling(2.0 * sharpness)
}

/// Integral of a lobe over the hemisphere around its axis, `2 pi / l (1 - exp(-l))`.
pub(crate) fn hemisphere_integral(sharpness: f64) -> f64 {
    2.0 * PI * falling(sharpness)
}

/// `(1 - exp(-x)) / x`, 1 at 0.
fn falling(x: f64) -> f64 {
    if x > 1e-12 { -(-x).exp_m1() / x } else { 1.0 }
}

/// Integral of `exp(l (v.p - 1))` over a half-space, by the sine of the signed angle of its boundary from the axis, that is the
/// cosine between the axis and the half-space's normal (Tokuyoshi 2022).
pub(crate) fn half_space(sharpness: f64, sine: f64) -> f64 {
    let l = sharpness;
    let steep = l * ((0.5 * l + 0.651_732_88) / ((l + 1.341_828_00) * l + 7.221_668_78)).sqrt();
    let ratio = if steep > 1e-9 { erf(steep * sine) / erf(steep) } else { sine };
    let share = 0.5 + 0.5 * ratio;
    let far = (-l).exp();
    hemisphere_integral(l) * (far + (1.0 - far) * share)
}

/// Integral of a lobe over a half-space at a signed angle, radians, by Wang's fit.
pub(crate) fn half_space_wang(sharpness: f64, distance: f64) -> f64 {
    half_space_share_wang(sharpness.max(1e-3).ln() as f32, distance as f32) as f64 * hemisphere_integral(sharpness)
}

/// [`half_space_wang`] over the hemisphere's integral, by the natural logarithm of the sharpness: a logistic function of the angle, its
/// steepness a polynomial of the logarithm.
#[inline]
pub(crate) fn half_space_share_wang(log: f32, distance: f32) -> f32 {
    let steep = ((0.204 * log - 0.892) * log + 2.995) * log + 0.067;
    // Overflow and underflow are slow.
    1.05 / (1.0 + (-steep * distance).clamp(-80.0, 80.0).exp()) - 0.025
}

/// Share of the lobe that a half-space at a signed angle leaves, 0 to 1.
pub(crate) fn visible_share(sharpness: f64, distance: f64) -> f64 {
    half_space(sharpness, distance.clamp(-PI / 2.0, PI / 2.0).sin()) / sphere_integral(sharpness)
}

/// Axis, sharpness and logarithm of the amplitude of a product of two lobes of amplitude 1, without cancellation.
fn product(axis_a: [f64; 3], a: f64, axis_b: [f64; 3], b: f64) -> ([f64; 3], f64, f64) {
    let (large, small) = (a.max(b), a.min(b));
    if large <= 0.0 {
        return (axis_a, 0.0, 0.0);
    }
    let ratio = small / large;
    let cosine = dot(axis_a, axis_b).clamp(-1.0, 1.0);
    let sum: [f64; 3] = std::array::from_fn(|i| (a * axis_a[i] + b * axis_b[i]) / large);
    let length = dot(sum, sum).sqrt();
    let exponent =
        2.0 * small * (cosine - 1.0) / ((2.0 * ratio * cosine + ratio * ratio + 1.0).max(0.0).sqrt() + ratio + 1.0);
    let axis = if length > 1e-12 { sum.map(|x| x / length) } else { axis_a };
    (axis, large * length, exponent)
}

/// Two unit vectors across a unit vector and each other, right-handed with it as the third (Duff et al. 2017).
pub(crate) fn tangents(z: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let sign = 1f64.copysign(z[2]);
    let a = -1.0 / (sign + z[2]);
    let b = z[0] * z[1] * a;
    ([1.0 + sign * z[0] * z[0] * a, sign * b, -sign * z[0]], [b, sign + z[1] * z[1] * a, -z[1]])
}

/// Error function, to 1e-14.
fn erf(x: f64) -> f64 {
    let magnitude = x.abs();
    if magnitude > 6.0 {
        return 1f64.copysign(x);
    }
    let gauss = (-x * x).exp() / PI.sqrt();
    if magnitude < 3.0 {
        // All terms of x exp(-x^2) (1 + 2 x^2 / 3 + (2 x^2)^2 / 15 + ...) have the same sign.
        let (mut term, mut sum, mut n) = (2.0 * x, 2.0 * x, 1.0);
        while term.abs() > 1e-17 * sum.abs() {
            n += 2.0;
            term *= 2.0 * x * x / n;
            sum += term;
        }
        return gauss * sum;
    }
    let fraction = (1..=40).rev().fold(magnitude, |below, k| magnitude + k as f64 / 2.0 / below);
    (1.0 - gauss / fraction).copysign(x)
}

#[cfg(test)]
mod tests {
    use crate::sphere::gaussian::*;

    fn direction(theta: f64, phi: f64) -> [f64; 3] {
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
    }

    /// Integral over the sphere about `axis`, finely sampled where a lobe of this sharpness is.
    fn integrate(axis: [f64; 3], sharpness: f64, f: impl Fn([f64; 3]) -> f64) -> f64 {
        let (x, y) = tangents(axis);
        let reach = if sharpness > 20.0 { (40.0 / sharpness).min(2.0) } else { 2.0 };
        let (rings, sectors) = (1500, 256);
        let mut sum = 0.0;
        for ring in 0..rings {
            let z = 1.0 - reach * (ring as f64 + 0.5) / rings as f64;
            let s = (1.0 - z * z).sqrt();
            for sector in 0..sectors {
                let (sine, cosine) = ((sector as f64 + 0.5) / sectors as f64 * 2.0 * PI).sin_cos();
                sum += f(std::array::from_fn(|i| z * axis[i] + s * (cosine * x[i] + sine * y[i])));
            }
        }
        sum * reach * 2.0 * PI / (rings * sectors) as f64
    }

    #[test]
    fn integrals_products_and_inner_products_agree_with_quadrature() {
        for (sharp_a, sharp_b, apart) in [(0.0, 2.0, 1.0), (3.0, 5.0, 2.5), (82.0, 2.133, 0.7), (1312.0, 1000.0, 0.03)]
        {
            let a = SphericalGaussian::grey(direction(0.3, 0.1), sharp_a, 1.5);
            let b = SphericalGaussian::grey(direction(0.3 + apart, 0.1), sharp_b, 0.7);
            let product = a.product(&b);
            let exact = integrate(product.axis, product.sharpness, |v| a.evaluate(v)[0] * b.evaluate(v)[0]);
            assert!((a.inner_product(&b)[0] / exact - 1.0).abs() < 1e-4, "{sharp_a} {sharp_b}");
            let v = direction(0.5, 0.4);
            assert!((product.evaluate(v)[0] - a.evaluate(v)[0] * b.evaluate(v)[0]).abs() < 1e-12);
            let whole = integrate(a.axis, sharp_a, |v| a.evaluate(v)[0]);
            assert!((a.integral()[0] / whole - 1.0).abs() < 1e-4);
        }
        // Nothing overflows where lobes are sharp.
        let mirror = SphericalGaussian::grey([0.0, 0.0, 1.0], 1e6, 1.0);
        let value = mirror.inner_product(&mirror)[0];
        assert!((value / (PI / 1e6) - 1.0).abs() < 1e-9, "{value}");
        assert_eq!(mirror.inner_product(&SphericalGaussian::grey([0.0, 0.0, -1.0], 1e6, 1.0))[0], 0.0);
        assert!((hemisphere_integral(0.0) - 2.0 * PI).abs() < 1e-12 && (sphere_integral(0.0) - 4.0 * PI).abs() < 1e-12);
    }

    #[test]
    fn a_half_space_leaves_what_quadrature_says() {
        let (mut worst, mut worst_wang) = (0f64, 0f64);
        for sharpness in [0.5, 5.0, 20.0, 82.0, 328.0, 1312.0] {
            let lobe = SphericalGaussian::grey([0.0, 0.0, 1.0], sharpness, 1.0);
            for step in -6..=6 {
                let distance = step as f64 / 6.0 * (2.5 / f64::sqrt(sharpness)).min(1.5);
                // The half-space's normal is 90 degrees less the distance from the axis.
                let normal = direction(PI / 2.0 - distance, 0.0);
                let exact =
                    integrate(lobe.axis, sharpness, |v| if dot(v, normal) > 0.0 { lobe.evaluate(v)[0] } else { 0.0 });
                let whole = lobe.integral()[0];
                worst = worst.max((lobe.visible(distance)[0] - exact).abs() / whole);
                if sharpness >= 5.0 {
                    worst_wang = worst_wang.max((lobe.visible_wang(distance)[0] - exact).abs() / whole);
                }
                let kept = lobe.shadowed(distance).integral()[0];
                assert!((kept - lobe.visible(distance)[0]).abs() < 1e-9 * whole);
            }
        }
        assert!(worst < 0.006 && worst_wang < 0.03, "{worst} {worst_wang}");
    }

    #[test]
    fn irradiance_of_a_lobe() {
        let normal = [0.0, 0.0, 1.0];
        let (mut worst, mut worst_lobe) = (0f64, 0f64);
        for sharpness in [0.5, 3.0, 20.0, 300.0] {
            for theta in [0.0, 0.8, 1.4, 1.6, 2.2] {
                let lobe = SphericalGaussian::grey(direction(theta, 0.3), sharpness, 1.0);
                let exact = integrate(lobe.axis, sharpness, |v| v[2].max(0.0) * lobe.evaluate(v)[0]);
                let whole = lobe.integral()[0];
                worst = worst.max((lobe.irradiance(normal)[0] - exact).abs() / whole);
                let found = lobe.inner_product(&SphericalGaussian::clamped_cosine(normal))[0];
                worst_lobe = worst_lobe.max((found - exact).abs() / whole);
            }
        }
        assert!(worst < 0.004, "{worst}");
        assert!((0.1..0.2).contains(&worst_lobe), "{worst_lobe}");
    }

    #[test]
    fn split_lobes_are_the_lobe_again() {
        for sharpness in [5.0, 20.0, 82.0] {
            let lobe = SphericalGaussian::grey(direction(0.4, 1.0), sharpness, 2.0);
            let parts = lobe.split();
            let sum: f64 = parts.iter().map(|p| p.integral()[0]).sum();
            assert!((sum / lobe.integral()[0] - 1.0).abs() < 1e-12);
            let value = |v: [f64; 3]| parts.iter().map(|p| p.evaluate(v)[0]).sum::<f64>();
            let error = integrate(lobe.axis, sharpness, |v| (value(v) - lobe.evaluate(v)[0]).powi(2));
            let energy = integrate(lobe.axis, sharpness, |v| lobe.evaluate(v)[0].powi(2));
            assert!((error / energy).sqrt() < 0.23, "{sharpness}: {}", (error / energy).sqrt());
        }
    }

    #[test]
    fn error_function_at_known_points() {
        for (x, value) in
            [(0.5, 0.520_499_877_813_046_5), (2.0, 0.995_322_265_018_952_7), (3.5, 0.999_999_256_901_627_7)]
        {
            assert!((erf(x) - value).abs() < 1e-14 && (erf(-x) + value).abs() < 1e-14, "{x}: {}", erf(x));
        }
        assert!((erf(1e-6) / 1.128_379_167_095_512_6e-6 - 1.0).abs() < 1e-11);
    }
}
