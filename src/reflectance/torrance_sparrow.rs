//! Specular reflection, simplified Torrance-Sparrow: `I_s = K_s E / cos(theta_r) exp(-alpha^2 / (2 sigma^2))` with the
//! light's irradiance `E = L / r^2` (Miyazaki 2007, equation 8).

use super::ReflectionGeometry;
use super::geometry::MIN_COS_VIEW;
use crate::elementary;

#[cfg(feature = "encode")]
use crate::optimise::levenberg_marquardt::minimise;

/// Parameters of the highlight at one surface point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TorranceSparrowLobe {
    /// `K_s`, red, green, blue, not negative.
    pub specular: [f32; 3],
    /// `sigma`, radians.
    pub sigma: f32,
}

/// Range of `sigma` that fits are kept in, radians.
pub(crate) const SIGMA_RANGE: (f32, f32) = (0.02, 0.8);

/// Specular radiance; zero where the light or the camera is behind the surface.
pub(crate) fn evaluate(lobe: &TorranceSparrowLobe, geometry: &ReflectionGeometry) -> [f32; 3] {
    if geometry.cos_light <= 0.0 || geometry.cos_view <= 0.0 || lobe.sigma <= 0.0 {
        return [0.0; 3];
    }
    let x = geometry.alpha / lobe.sigma;
    let scale = (-0.5 * x * x).exp() / geometry.cos_view.max(MIN_COS_VIEW);
    std::array::from_fn(|c| lobe.specular[c] * geometry.irradiance[c] * scale)
}

/// Specular radiance seen in one view, and how the point lay there.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct SpecularSighting {
    /// Specular radiance, red, green, blue; signed.
    pub radiance: [f32; 3],
    /// Light and view at the point.
    pub geometry: ReflectionGeometry,
}

/// Fits a lobe to the sightings of one point (or of several that share their parameters) by weighted least squares,
/// weight `cos(normal, view)`. `None` where no highlight was seen: no sighting within two `sigma` of the mirror
/// direction, or nothing bright there. Such points are filled by [`fill_from_neighbours`].
#[cfg(feature = "encode")]
pub(crate) fn fit(sightings: &[SpecularSighting]) -> Option<TorranceSparrowLobe> {
    let usable = |s: &&SpecularSighting| {
        s.geometry.cos_light > 0.0 && s.geometry.cos_view > 0.0 && s.radiance.iter().all(|x| x.is_finite())
    };
    // Where the highlight may start: K_s is linear given sigma, so the best of a few widths costs little.
    let mut start: Option<([f64; 4], f64)> = None;
    for sigma in [0.04, 0.09, 0.18, 0.35, 0.7f64] {
        let (mut product, mut square, mut energy) = ([0.0f64; 3], [0.0f64; 3], 0.0f64);
        for s in sightings.iter().filter(usable) {
            let (weight, shape) = weight_and_shape(&s.geometry, sigma);
            for c in 0..3 {
                let shape = shape * s.geometry.irradiance[c] as f64;
                product[c] += weight * shape * s.radiance[c] as f64;
                square[c] += weight * shape * shape;
                energy += weight * (s.radiance[c] as f64).powi(2);
            }
        }
        let specular: [f64; 3] =
            std::array::from_fn(|c| if square[c] > 1e-30 { (product[c] / square[c]).max(0.0) } else { 0.0 });
        let cost = energy + (0..3).map(|c| specular[c] * (specular[c] * square[c] - 2.0 * product[c])).sum::<f64>();
        if start.is_none_or(|(_, best)| cost < best) {
            start = Some(([specular[0], specular[1], specular[2], sigma.ln()], cost));
        }
    }
    let (start, _) = start?;
    // Scaled by the mean so that the damping treats colours and sigma alike.
    let scale = (start[0] + start[1] + start[2]) / 3.0;
    if scale.is_nan() || scale <= 0.0 {
        return None;
    }
    let bounds = {
        let colour = (0.0, 20.0);
        [colour, colour, colour, ((SIGMA_RANGE.0 as f64).ln(), (SIGMA_RANGE.1 as f64).ln())]
    };
    let scaled = [start[0] / scale, start[1] / scale, start[2] / scale, start[3]];
    let found = minimise(scaled, &bounds, 24, |p, equations| {
        let sigma = p[3].exp();
        for s in sightings.iter().filter(usable) {
            let (weight, shape) = weight_and_shape(&s.geometry, sigma);
            let ratio = s.geometry.alpha as f64 / sigma;
            for c in 0..3 {
                let unit = shape * s.geometry.irradiance[c] as f64 * scale;
                let mut derivatives = [0.0; 4];
                derivatives[c] = unit;
                // d exp(-alpha^2 / 2 sigma^2) / d ln sigma = (alpha / sigma)^2 exp(..)
                derivatives[3] = p[c] * unit * ratio * ratio;
                equations.add(p[c] * unit - s.radiance[c] as f64, &derivatives, weight);
            }
        }
    });
    let p = found.parameters;
    let sigma = p[3].exp();
    let near: f64 = sightings
        .iter()
        .filter(usable)
        .filter(|s| (s.geometry.alpha as f64) < 2.0 * sigma)
        .map(|s| s.geometry.cos_view as f64)
        .sum();
    let lobe = TorranceSparrowLobe { specular: std::array::from_fn(|c| (p[c] * scale) as f32), sigma: sigma as f32 };
    (near > 0.3 && lobe.specular.iter().any(|&k| k > 0.0)).then_some(lobe)
}

/// Weight of a sighting and its `exp(..) / cos(theta_r)`.
#[cfg(feature = "encode")]
#[inline]
fn weight_and_shape(geometry: &ReflectionGeometry, sigma: f64) -> (f64, f64) {
    let ratio = geometry.alpha as f64 / sigma;
    let cos_view = geometry.cos_view as f64;
    (cos_view, (-0.5 * ratio * ratio).exp() / cos_view.max(MIN_COS_VIEW as f64))
}

/// Gives every point without a lobe the mean of its neighbours' (`ln sigma` averaged), ring by ring outwards from the
/// points that have one. `neighbours(i)` lists the points next to `i`. Points that no lobe reaches take the mean of all,
/// or a black lobe where there is none.
#[cfg(feature = "encode")]
pub(crate) fn fill_from_neighbours<I: IntoIterator<Item = usize>>(
    lobes: &[Option<TorranceSparrowLobe>],
    neighbours: impl Fn(usize) -> I,
) -> Vec<TorranceSparrowLobe> {
    let mut filled = lobes.to_vec();
    let mut open: Vec<usize> = (0..filled.len()).filter(|&i| filled[i].is_none()).collect();
    while !open.is_empty() {
        let found: Vec<(usize, Option<TorranceSparrowLobe>)> = open
            .iter()
            .map(|&i| (i, mean(neighbours(i).into_iter().filter_map(|n| filled.get(n).copied().flatten()))))
            .collect();
        let before = open.len();
        open = found.iter().filter(|(_, lobe)| lobe.is_none()).map(|(i, _)| *i).collect();
        for (i, lobe) in found {
            filled[i] = lobe;
        }
        if open.len() == before {
            break;
        }
    }
    let black = TorranceSparrowLobe { specular: [0.0; 3], sigma: 0.2 };
    let rest = mean(filled.iter().copied().flatten()).unwrap_or(black);
    filled.into_iter().map(|lobe| lobe.unwrap_or(rest)).collect()
}

#[cfg(feature = "encode")]
fn mean(lobes: impl Iterator<Item = TorranceSparrowLobe>) -> Option<TorranceSparrowLobe> {
    let (mut specular, mut log_sigma, mut count) = ([0.0f64; 3], 0.0, 0.0);
    for lobe in lobes {
        for c in 0..3 {
            specular[c] += lobe.specular[c] as f64;
        }
        log_sigma += (lobe.sigma as f64).ln();
        count += 1.0;
    }
    (count > 0.0).then(|| TorranceSparrowLobe {
        specular: specular.map(|k| (k / count) as f32),
        sigma: (log_sigma / count).exp() as f32,
    })
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn sightings(lobe: &TorranceSparrowLobe, noise: f32) -> Vec<SpecularSighting> {
        (0..15)
            .map(|i| {
                let geometry = ReflectionGeometry {
                    irradiance: [2.0, 3.0, 2.5],
                    cos_light: 0.8,
                    cos_view: 1.0 - 0.05 * i as f32,
                    alpha: (i as f32 - 4.3).abs() * 0.07,
                    difference: 0.3,
                    ..Default::default()
                };
                let mut radiance = evaluate(lobe, &geometry);
                for (c, x) in radiance.iter_mut().enumerate() {
                    *x += noise * ((i * 7 + c * 3) % 5) as f32 - 2.0 * noise;
                }
                SpecularSighting { radiance, geometry }
            })
            .collect()
    }

    #[test]
    fn the_fit_recovers_known_lobes() {
        for sigma in [0.05, 0.12, 0.25, 0.5] {
            let lobe = TorranceSparrowLobe { specular: [0.3, 0.1, 0.02], sigma };
            let found = fit(&sightings(&lobe, 0.0)).unwrap();
            assert!((found.sigma / sigma - 1.0).abs() < 1e-3, "{found:?}");
            assert!((0..3).all(|c| (found.specular[c] / lobe.specular[c] - 1.0).abs() < 1e-3), "{found:?}");
        }
    }

    #[test]
    fn no_grid_point_beats_the_fit() {
        let data = sightings(&TorranceSparrowLobe { specular: [0.3, 0.2, 0.1], sigma: 0.15 }, 0.02);
        let cost = |lobe: &TorranceSparrowLobe| -> f64 {
            let error = |s: &SpecularSighting, c: usize| (evaluate(lobe, &s.geometry)[c] - s.radiance[c]) as f64;
            data.iter().map(|s| s.geometry.cos_view as f64 * (0..3).map(|c| error(s, c).powi(2)).sum::<f64>()).sum()
        };
        let found = fit(&data).unwrap();
        let mut best = f64::MAX;
        for k in 0..60 {
            let sigma = 0.05 + 0.005 * k as f32;
            // Colours separate given sigma.
            let specular = std::array::from_fn(|c| {
                let unit = TorranceSparrowLobe { specular: [1.0; 3], sigma };
                let (mut product, mut square) = (0.0, 0.0);
                for s in &data {
                    let shape = evaluate(&unit, &s.geometry)[c];
                    product += s.geometry.cos_view * shape * s.radiance[c];
                    square += s.geometry.cos_view * shape * shape;
                }
                product / square
            });
            best = best.min(cost(&TorranceSparrowLobe { specular, sigma }));
        }
        assert!(cost(&found) <= best * 1.00001, "{} against {best}", cost(&found));
    }

    #[test]
    fn unseen_highlights_come_from_their_neighbours() {
        let lobe = TorranceSparrowLobe { specular: [0.3, 0.3, 0.3], sigma: 0.05 };
        let mut far = sightings(&lobe, 0.0);
        for s in &mut far {
            s.geometry.alpha += 0.6;
            s.radiance = [0.0; 3];
        }
        assert_eq!(fit(&far), None);
        assert_eq!(fit(&[]), None);
        let other = TorranceSparrowLobe { specular: [0.1; 3], sigma: 0.2 };
        let chain = [Some(lobe), None, None, Some(other), None];
        let filled = fill_from_neighbours(&chain, |i| [i.wrapping_sub(1), i + 1].into_iter().filter(|&n| n < 5));
        assert_eq!(filled[1], lobe);
        assert_eq!(filled[4], other);
        assert!((filled[2].specular[0] - 0.1).abs() < 1e-6);
        assert_eq!(fill_from_neighbours(&[None, None], |_| [])[0].specular, [0.0; 3]);
    }
}

/// Largest value of the plane of `sigma`: `round(ln(sigma / least) / ln(most / least) * SIGMA_LEVELS)`, with
/// [`SIGMA_RANGE`]. Part of the format.
pub(crate) const SIGMA_LEVELS: i32 = 255;

/// `ln 40`, of the largest `sigma` over the smallest: 0x406C169A. Part of the format.
const LOG_RANGE: f32 = 3.688_879_5;

/// `sigma` of a level, radians.
pub(crate) fn sigma_of_level(level: i32) -> f32 {
    let share = level.clamp(0, SIGMA_LEVELS) as f32 / SIGMA_LEVELS as f32;
    SIGMA_RANGE.0 * elementary::exp((share * LOG_RANGE) as f64) as f32
}

/// Level of a `sigma`, not rounded.
pub(crate) fn level_of_sigma(sigma: f32) -> f64 {
    let (least, most) = SIGMA_RANGE;
    ((sigma / least) as f64).ln() / ((most / least) as f64).ln() * SIGMA_LEVELS as f64
}
