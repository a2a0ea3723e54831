//! Which material of glTF's metallic-roughness model looks like a fitted reflectance.

use crate::brdf::{Microfacets, models::DIELECTRIC, models::MIN_ALPHA};
use std::f64::consts::FRAC_PI_2;

/// The `alpha` of glTF's distribution that looks most like a Torrance-Sparrow lobe of width `sigma`, and its peak as a share of that lobe's.
///
/// The lobe is `exp(-a^2 / (2 sigma^2))` of the angle `a` between normal and half vector, glTF's `g(a) = (cos^2 a + sin^2 a / alpha^2)^-2`: a
/// sharper peak with longer tails. The result minimises `integral (exp(-a^2 / (2 sigma^2)) - peak g(a))^2 sin a da`, the squared error of
/// radiance over the solid angle. For small `sigma`, `alpha = 1.50 sigma` and `peak = 1.14`.
pub fn equivalent_lobe(sigma: f64) -> (f64, f64) {
    let lobe = |angle: f64| (-0.5 * (angle / sigma).powi(2)).exp();
    let range = [(0.4 * sigma).max(MIN_ALPHA), (4.0 * sigma).clamp(2.0 * MIN_ALPHA, 1.0)];
    equivalent_distribution(&lobe, FRAC_PI_2.min(12.0 * sigma), range)
}

/// As [`equivalent_lobe`] of any function of the angle between normal and half vector up to `end`: `alpha` within a range, and the peak.
pub(super) fn equivalent_distribution(lobe: &dyn Fn(f64) -> f64, end: f64, [least, most]: [f64; 2]) -> (f64, f64) {
    const STEPS: usize = 200;
    let cost = |alpha: f64| {
        let (mut product, mut square, mut energy) = (0.0, 0.0, 0.0);
        for k in 0..STEPS {
            let angle = (k as f64 + 0.5) / STEPS as f64 * end;
            let (sin, cos) = angle.sin_cos();
            let lobe = lobe(angle);
            let facets = (cos * cos + sin * sin / (alpha * alpha)).powi(-2);
            product += lobe * facets * sin;
            square += facets * facets * sin;
            energy += lobe * lobe * sin;
        }
        (energy - product * product / square, product / square)
    };
    // Golden section over ln(alpha).
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = (least.ln(), most.ln());
    for _ in 0..40 {
        let (one, two) = (high - ratio * (high - low), low + ratio * (high - low));
        if cost(one.exp()).0 < cost(two.exp()).0 { high = two } else { low = one }
    }
    let alpha = (0.5 * (low + high)).exp();
    (alpha, cost(alpha).1)
}

/// The material whose diffuse albedo is `diffuse`, and whose reflectance at normal incidence is `specular`, as far as there is one.
///
/// How metallic it is follows from both brightnesses, as Khronos' conversion from specular-glossiness does it: a dark diffuse
/// reflection below a specular one much brighter than 4 % is a metal's; below 0.7 it is none. What that leaves open of a dielectric's reflection goes into its
/// specular colour, so that viewers which know `KHR_materials_specular` show both as they were measured, and others come near.
pub(crate) fn material(diffuse: [f64; 3], specular: [f64; 3], roughness: f64) -> Microfacets {
    let (diffuse, specular) = (diffuse.map(|x| x.clamp(0.0, 1.0)), specular.map(|x| x.clamp(0.0, 1.0)));
    let most = specular.iter().fold(0.0f64, |a, &b| a.max(b));
    let brightness = |c: [f64; 3]| (0.299 * c[0] * c[0] + 0.587 * c[1] * c[1] + 0.114 * c[2] * c[2]).sqrt();
    // Fits are noisy, and half a metal is neither: only what is clearly one is made of metal.
    let share = ((metalness(brightness(diffuse), brightness(specular), 1.0 - most) - 0.7) / 0.3).clamp(0.0, 1.0);
    let metallic = share * share * (3.0 - 2.0 * share);
    let plastic = 1.0 - metallic;
    let base_colour = std::array::from_fn(|c| {
        // Light that the surface reflects doesn't reach its colour.
        let from_diffuse = diffuse[c] / (plastic * (1.0 - most).max(0.05)).max(1e-3);
        let from_specular = (specular[c] - DIELECTRIC * plastic) / metallic.max(1e-3);
        (from_diffuse + metallic.powi(4) * (from_specular - from_diffuse)).clamp(0.0, 1.0)
    });
    let specular_colour = std::array::from_fn(|c| {
        if plastic < 0.02 {
            1.0
        } else {
            ((specular[c] - metallic * base_colour[c]) / (DIELECTRIC * plastic)).clamp(0.0, 25.0)
        }
    });
    Microfacets { base_colour, metallic, roughness, specular_colour }
}

/// The metalness with which one base colour serves both reflections: `base = diffuse (1 - max specular) / ((1 - 0.04) (1 - m))` and
/// `base = (specular - 0.04 (1 - m)) / m` agree.
fn metalness(diffuse: f64, specular: f64, left: f64) -> f64 {
    if specular <= DIELECTRIC {
        return 0.0;
    }
    let linear = diffuse * left / (1.0 - DIELECTRIC) + specular - 2.0 * DIELECTRIC;
    let constant = DIELECTRIC - specular;
    let root = (linear * linear - 4.0 * DIELECTRIC * constant).max(0.0).sqrt();
    ((root - linear) / (2.0 * DIELECTRIC)).clamp(0.0, 1.0)
}
