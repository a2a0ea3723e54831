//! Reflectance as spherical Gaussians of the half vector, and warped to the direction of light.

use crate::brdf::Brdf;
use crate::lighting::SphericalGaussian;
use glam::{DVec2, DVec3};

/// One lobe of the half vector `h` about the normal (z): `amplitude exp(-(sx hx^2 + sy hy^2) / (1 + hz))`. With equal sharpnesses this
/// is the spherical Gaussian `amplitude exp(s (hz - 1))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfLobe {
    /// Sharpness along the tangent and the bitangent.
    pub sharpness: [f64; 2],
    /// Value along the normal.
    pub amplitude: f64,
}

impl HalfLobe {
    /// Value of a half vector.
    pub fn evaluate(&self, half: [f64; 3]) -> f64 {
        let [x, y, z] = half;
        let exponent = (self.sharpness[0] * x * x + self.sharpness[1] * y * y) / (1.0 + z).max(1e-9);
        self.amplitude * (-exponent).exp()
    }

    /// Integral over the sphere, for lobes that do not reach around it.
    pub fn integral(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.amplitude / (self.sharpness[0] * self.sharpness[1]).sqrt()
    }

    /// The lobe over the direction of light for an outgoing direction, isotropic (Sonoda 2011): a quarter of the sharpness over the
    /// cosine of half the angle turned (Wang 2009). An anisotropic one becomes a row of lobes along its wider direction, each as sharp
    /// as the narrow one.
    pub fn warp_isotropic(&self, outgoing: [f64; 3]) -> Vec<SphericalGaussian> {
        let outgoing = DVec3::from_array(outgoing);
        let warped = |axis: DVec3, sharpness: f64, amplitude: f64| {
            let cosine = axis.dot(outgoing);
            let reflected = 2.0 * cosine * axis - outgoing;
            SphericalGaussian::grey(reflected.to_array(), sharpness / (4.0 * cosine.abs()).max(1e-3), amplitude)
        };
        let [sx, sy] = self.sharpness;
        let (wide, narrow) = (sx.min(sy), sx.max(sy));
        if narrow < 1.05 * wide {
            return vec![warped(DVec3::Z, (sx * sy).sqrt(), self.amplitude)];
        }
        // A Gaussian of the wide variance is one of the narrow variance averaged over a Gaussian of the difference.
        let count = ((narrow / wide).sqrt() * 2.5).ceil().clamp(3.0, 25.0) as i32 | 1;
        let spread = (1.0 / (2.0 * wide) - 1.0 / (2.0 * narrow)).sqrt();
        let step = 5.0 / count as f64;
        let places = (-(count / 2)..=count / 2).map(|k| k as f64 * step);
        let total: f64 = places.clone().map(|t| (-0.5 * t * t).exp()).sum();
        let height = self.amplitude * (narrow / wide).sqrt();
        places
            .map(|t| {
                let at = t * spread;
                let plane = if sx < sy { DVec2::new(at, 0.0) } else { DVec2::new(0.0, at) };
                warped(from_plane(plane), narrow, height * (-0.5 * t * t).exp() / total)
            })
            .collect()
    }

    /// The lobe over the direction of light as an anisotropic spherical Gaussian (Xu et al. 2013): the half vector's squared angle is
    /// an eighth of the reflected one's in the plane of incidence (times two of the exponent's form), and `1 / (8 cos^2)` across.
    pub fn warp(&self, outgoing: [f64; 3]) -> WarpedLobe {
        let o = DVec3::from_array(outgoing);
        let cosine = o.z.clamp(1e-3, 1.0);
        let axis = DVec3::new(-o.x, -o.y, o.z).normalize_or(DVec3::Z);
        let inward = DVec2::new(o.x, o.y);
        let length = inward.length();
        // Tangents of the half vector: along the plane of incidence and across it.
        let along = if length > 1e-9 { inward / length } else { DVec2::X };
        let across = DVec2::new(-along.y, along.x);
        // With i = 2 (o.h) h - o a step dh moves i by 2 dh along the plane and by 2 cos dh across it.
        let form = |a: DVec2, b: DVec2| 0.5 * (self.sharpness[0] * a.x * b.x + self.sharpness[1] * a.y * b.y);
        let (aa, ab, bb) = (
            form(along, along) / 4.0,
            form(along, across) / (4.0 * cosine),
            form(across, across) / (4.0 * cosine * cosine),
        );
        // Principal directions of the quadratic form.
        let angle = 0.5 * (2.0 * ab).atan2(aa - bb);
        let (s, c) = angle.sin_cos();
        let (first, second) = (aa * c * c + 2.0 * ab * s * c + bb * s * s, aa * s * s - 2.0 * ab * s * c + bb * c * c);
        let y = DVec3::new(across.x, across.y, 0.0);
        let x = y.cross(axis).normalize_or(DVec3::X);
        WarpedLobe {
            frame: [(x * c + y * s).to_array(), (y * c - x * s).to_array(), axis.to_array()],
            sharpness: [first, second],
            amplitude: self.amplitude,
        }
    }

    /// A half vector at two uniform numbers, distributed as the lobe.
    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        let radius = (-(1.0 - u[0]).max(1e-12).ln()).sqrt();
        let (s, c) = (u[1] * std::f64::consts::TAU).sin_cos();
        from_plane(DVec2::new(radius * c / self.sharpness[0].sqrt(), radius * s / self.sharpness[1].sqrt()))
    }
}

/// Unit vector of a place on the plane of equal areas, `|a|^2 = 1 - z`.
fn from_plane(a: DVec2) -> DVec3 {
    let square = a.length_squared().min(1.999);
    let scale = (2.0 - square).sqrt();
    let a = if a.length_squared() > square { a * (square / a.length_squared()).sqrt() } else { a };
    DVec3::new(a.x * scale, a.y * scale, 1.0 - square)
}

/// An anisotropic spherical Gaussian `amplitude max(v.z, 0) exp(-l (v.x)^2 - m (v.y)^2)` in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpedLobe {
    /// Unit vectors x, y, z (the axis).
    pub frame: [[f64; 3]; 3],
    /// Sharpnesses `l` along x and `m` along y.
    pub sharpness: [f64; 2],
    /// Value on the axis.
    pub amplitude: f64,
}

impl WarpedLobe {
    /// Value in a unit direction.
    pub fn evaluate(&self, direction: [f64; 3]) -> f64 {
        let along = |k: usize| (0..3).map(|i| self.frame[k][i] * direction[i]).sum::<f64>();
        let (x, y, z) = (along(0), along(1), along(2));
        self.amplitude * z.max(0.0) * (-self.sharpness[0] * x * x - self.sharpness[1] * y * y).exp()
    }
}

/// A material: Lambertian plus any specular reflection.
pub struct Material {
    /// Diffuse albedo, red, green, blue.
    pub albedo: [f64; 3],
    /// Specular part, times [`Self::specular_scale`].
    pub specular: Option<SpecularPart>,
    /// Factor of the specular part.
    pub specular_scale: [f64; 3],
}

/// Specular reflection with its distribution of half vectors.
pub struct SpecularPart {
    /// The function itself.
    pub brdf: Box<dyn Brdf + Send>,
    /// Its distribution of half vectors as lobes.
    pub lobes: Vec<HalfLobe>,
    /// Share of each lobe's integral.
    pub(super) shares: Vec<f64>,
}

impl SpecularPart {
    /// Fits lobes to a reflection function.
    pub fn new(brdf: Box<dyn Brdf + Send>) -> Self {
        let lobes = fit_lobes(&*brdf);
        let total: f64 = lobes.iter().map(HalfLobe::integral).sum();
        let shares = lobes.iter().map(|l| l.integral() / total.max(1e-30)).collect();
        SpecularPart { brdf, lobes, shares }
    }

    /// Probability density, per solid angle, of half vectors drawn from the lobes by their shares.
    pub(super) fn density(&self, half: [f64; 3]) -> f64 {
        self.lobes.iter().zip(&self.shares).map(|(l, share)| share * l.evaluate(half) / l.integral()).sum()
    }

    /// A half vector drawn from the lobes by two uniform numbers.
    #[cfg(feature = "encode")]
    pub(super) fn sample(&self, u: [f64; 2]) -> DVec3 {
        let mut before = 0.0;
        for (lobe, &share) in self.lobes.iter().zip(&self.shares) {
            if u[0] < before + share {
                return lobe.sample([(u[0] - before) / share, u[1]]);
            }
            before += share;
        }
        self.lobes.last().map_or(DVec3::Z, |lobe| lobe.sample(u))
    }

    /// Half vectors that stand for the lobes, an equal share of the distribution each.
    pub(super) fn taps(&self, count: usize) -> Vec<DVec3> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let mut taps = Vec::with_capacity(count);
        let mut before = 0.0;
        for (lobe, share) in self.lobes.iter().zip(&self.shares) {
            // Taps whose middle on the line of all shares falls on this lobe.
            let place = |k: usize| (k as f64 + 0.5) / count as f64;
            let of_lobe: Vec<usize> = (0..count).filter(|&k| place(k) >= before && place(k) < before + share).collect();
            for (n, k) in of_lobe.iter().enumerate() {
                let u = (n as f64 + 0.5) / of_lobe.len() as f64;
                taps.push(lobe.sample([u, (*k as f64 * GOLDEN).fract()]));
            }
            before += share;
        }
        taps
    }
}

/// Lobes whose sum is the distribution of half vectors of a reflection function, up to a factor: what it does where light comes from
/// where it is seen, times the squared cosine. Non-negative least squares over a range of sharpnesses.
pub fn fit_lobes(brdf: &dyn Brdf) -> Vec<HalfLobe> {
    const PLACES: usize = 160;
    const SHARPNESSES: usize = 36;
    let value = |theta: f64, phi: f64| {
        let (s, c) = theta.sin_cos();
        let direction = [s * phi.cos(), s * phi.sin(), c];
        let f = brdf.evaluate(direction, direction);
        let mean = (f[0] + f[1] + f[2]) / 3.0 * c * c;
        if mean.is_finite() { mean.max(0.0) } else { 0.0 }
    };
    // Angles dense towards the normal.
    let angle = |k: usize| 1.45 * ((k as f64 + 0.5) / PLACES as f64).powi(3);
    let peak = (0..PLACES).map(|k| value(angle(k), 0.0)).fold(0.0, f64::max);
    if peak <= 0.0 {
        return vec![HalfLobe { sharpness: [2.0; 2], amplitude: 1.0 }];
    }
    let ratio = anisotropy(&|theta, phi| value(theta, phi) / peak);
    let sharpness: Vec<f64> = (0..SHARPNESSES).map(|j| 0.5 * 1.4f64.powi(j as i32)).collect();
    // Relative errors count far from the peak, absolute ones near it.
    let rows: Vec<(f64, f64, f64)> = (0..PLACES)
        .map(|k| {
            let theta = angle(k);
            let width = 3.0 * theta / (k as f64 + 0.5);
            let y = value(theta, 0.0) / peak;
            (1.0 - theta.cos(), y, (theta.sin() * width).sqrt() / (y + 2e-3).sqrt())
        })
        .collect();
    let columns: Vec<Vec<f64>> =
        sharpness.iter().map(|s| rows.iter().map(|&(drop, _, weight)| weight * (-s * drop).exp()).collect()).collect();
    let norms: Vec<f64> = columns.iter().map(|c| c.iter().map(|x| x * x).sum()).collect();
    let mut weights = vec![0.0; SHARPNESSES];
    let mut residual: Vec<f64> = rows.iter().map(|&(_, y, weight)| weight * y).collect();
    for _ in 0..400 {
        for j in (0..SHARPNESSES).rev() {
            let step: f64 = columns[j].iter().zip(&residual).map(|(a, r)| a * r).sum::<f64>() / norms[j].max(1e-30);
            let next = (weights[j] + step).max(0.0);
            let change = next - weights[j];
            weights[j] = next;
            residual.iter_mut().zip(&columns[j]).for_each(|(r, a)| *r -= change * a);
        }
    }
    let lobe = |j: usize| HalfLobe { sharpness: [sharpness[j], sharpness[j] * ratio], amplitude: weights[j] * peak };
    let total: f64 = (0..SHARPNESSES).map(|j| lobe(j).integral()).sum();
    let mut merged: Vec<HalfLobe> = Vec::new();
    let mut last = usize::MAX - 1;
    for j in (0..SHARPNESSES).filter(|&j| weights[j] > 0.0) {
        let next = lobe(j);
        match merged.last_mut() {
            // Two neighbours in the range of sharpnesses are one lobe between them.
            Some(before) if last + 1 == j => {
                let (a, b) = (before.integral(), next.integral());
                let mixed = (before.sharpness[0].ln() * a + next.sharpness[0].ln() * b) / (a + b);
                before.sharpness = [mixed.exp(), mixed.exp() * ratio];
                before.amplitude += next.amplitude;
                before.amplitude *= (a + b) / before.integral();
                last = usize::MAX - 1;
            }
            _ => {
                merged.push(next);
                last = j;
            }
        }
    }
    merged.retain(|l| l.integral() > 2e-3 * total);
    merged
}

/// Sharpness across over sharpness along the tangent.
fn anisotropy(value: &dyn Fn(f64, f64) -> f64) -> f64 {
    // Angle at which the value has fallen to exp(-1/2) of its peak.
    let width = |phi: f64| {
        let (mut low, mut high) = (0.0, 1.45);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if value(middle, phi) > 0.606_53 { low = middle } else { high = middle }
        }
        high
    };
    let (along, across) = (width(0.0), width(std::f64::consts::FRAC_PI_2));
    let ratio = ((1.0 - along.cos()) / (1.0 - across.cos()).max(1e-12)).clamp(1e-3, 1e3);
    if (ratio.ln()).abs() < 0.03 { 1.0 } else { ratio }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A distribution without masking: `D(h)` over the squared cosine, so that the fit sees `D`.
    struct Distribution<F: Fn(DVec3) -> f64 + Sync>(F);
    impl<F: Fn(DVec3) -> f64 + Sync> Brdf for Distribution<F> {
        fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
            let half = (DVec3::from_array(incoming) + DVec3::from_array(outgoing)).normalize();
            [self.0(half) / (half.z * half.z).max(1e-6); 3]
        }
    }

    fn error(lobes: &[HalfLobe], d: impl Fn(DVec3) -> f64) -> f64 {
        let (mut wrong, mut all) = (0.0, 0.0);
        for k in 0..4000 {
            let z = 1.0 - ((k as f64 + 0.5) / 4000.0).powi(3);
            let weight = ((k as f64 + 0.5) / 4000.0).powi(2);
            let (s, c) = (k as f64 * 2.399_963).sin_cos();
            let h = DVec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z);
            let sum: f64 = lobes.iter().map(|l| l.evaluate(h.to_array())).sum();
            wrong += weight * (sum - d(h)).powi(2);
            all += weight * d(h).powi(2);
        }
        (wrong / all).sqrt()
    }

    #[test]
    fn known_distributions_become_few_lobes() {
        let beckmann = |m: f64| move |h: DVec3| (-(1.0 / (h.z * h.z) - 1.0) / (m * m)).exp() / h.z.powi(4).max(1e-9);
        let ggx = |a: f64| move |h: DVec3| (h.z * h.z * (a * a - 1.0) + 1.0).powi(-2);
        let phong = |n: f64| move |h: DVec3| h.z.powf(n);
        for (name, found, limit) in [
            ("beckmann", error(&fit_lobes(&Distribution(beckmann(0.2))), beckmann(0.2)), 0.05),
            ("sharp beckmann", error(&fit_lobes(&Distribution(beckmann(0.05))), beckmann(0.05)), 0.05),
            ("ggx", error(&fit_lobes(&Distribution(ggx(0.2))), ggx(0.2)), 0.03),
            ("phong", error(&fit_lobes(&Distribution(phong(100.0))), phong(100.0)), 0.03),
        ] {
            assert!(found < limit, "{name}: {found}");
        }
        let ward = |h: DVec3| (-((h.x / 0.1).powi(2) + (h.y / 0.4).powi(2)) / (h.z * h.z)).exp();
        let lobes = fit_lobes(&Distribution(ward));
        assert!(error(&lobes, ward) < 0.12, "ward: {}", error(&lobes, ward));
        assert!(lobes.len() < 12);
        // As rows of isotropic lobes.
        let row: Vec<_> = lobes.iter().flat_map(|l| l.warp_isotropic([0.0, 0.0, 1.0])).collect();
        let half = |h: DVec3| (2.0 * h.z * h - DVec3::Z).to_array();
        for h in [DVec3::new(0.03, 0.1, 0.9946), DVec3::new(0.0, 0.3, 0.954), DVec3::new(0.1, 0.0, 0.995)] {
            let h = h.normalize();
            let sum: f64 = row.iter().map(|g| g.evaluate(half(h))[0]).sum();
            assert!((sum - ward(h)).abs() < 0.12, "{h}: {sum} for {}", ward(h));
        }
    }

    #[test]
    fn the_anisotropic_warp_is_nearer_than_the_isotropic_one() {
        let lobe = HalfLobe { sharpness: [100.0; 2], amplitude: 1.0 };
        for (degrees, worst_isotropic, worst) in [(60.0f64, (0.25, 0.45), 0.12), (75.0, (0.5, 0.75), 0.27)] {
            let (s, c) = degrees.to_radians().sin_cos();
            let outgoing = DVec3::new(s * 0.6, s * 0.8, c);
            let isotropic = lobe.warp_isotropic(outgoing.to_array())[0];
            let warped = lobe.warp(outgoing.to_array());
            let (mut all, mut wrong, mut wrong_isotropic) = (0.0, 0.0, 0.0);
            for k in 0..40_000 {
                let z = (k as f64 + 0.5) / 40_000.0;
                let (sine, cosine) = (k as f64 * 2.399_963_229_7).sin_cos();
                let i = DVec3::new(cosine * (1.0 - z * z).sqrt(), sine * (1.0 - z * z).sqrt(), z);
                let exact = lobe.evaluate((i + outgoing).normalize().to_array());
                all += exact * exact;
                wrong += (exact - warped.evaluate(i.to_array())).powi(2);
                wrong_isotropic += (exact - isotropic.evaluate(i.to_array())[0]).powi(2);
            }
            let (a, b) = ((wrong_isotropic / all).sqrt(), (wrong / all).sqrt());
            assert!((worst_isotropic.0..worst_isotropic.1).contains(&a) && b < worst, "{degrees}: {a} {b}");
        }
    }

    #[test]
    fn taps_follow_the_distribution() {
        let ggx = |h: DVec3| (h.z * h.z * (0.09 - 1.0) + 1.0f64).powi(-2);
        let specular = SpecularPart::new(Box::new(Distribution(ggx)));
        let taps = specular.taps(64);
        assert!((60..=64).contains(&taps.len()), "{}", taps.len());
        let above = taps.iter().filter(|h| h.z > 0.0);
        let mean: f64 = above.map(|h| ggx(*h) / specular.density(h.to_array())).sum::<f64>() / 64.0;
        // The integral of D over the hemisphere, pi / a^2 times what is normalised by the cosine; by quadrature here.
        let exact: f64 = (0..20_000)
            .map(|k| ggx(DVec3::new(0.0, 0.0, (k as f64 + 0.5) / 20_000.0)) * std::f64::consts::TAU / 20_000.0)
            .sum();
        assert!((mean / exact - 1.0).abs() < 0.08, "{mean} {exact}");
    }
}
