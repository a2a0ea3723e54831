//! Diffuse reflection, `I_d = K_d E cos(theta_i)` with the light's irradiance `E = L / r^2` (Miyazaki 2007, equation 7).

use super::{ReflectionGeometry, lobes};

/// Sums of the weighted linear least squares problem of one surface point; add its observations in any number of calls.
///
/// Minimises `sum_n w_n (I_n - K_d s_n)^2` per colour, `s_n = E_n cos(theta_i,n)`, `w_n = cos(normal, view)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct LambertSums {
    numerator: [f64; 3],
    denominator: [f64; 3],
    /// Sum of the weights.
    weight: f64,
}

impl LambertSums {
    /// Adds the diffuse radiance seen in one view under a known light. Unlit or unseen points, and values that are not
    /// finite, are left out.
    pub(crate) fn add(&mut self, radiance: [f32; 3], geometry: &ReflectionGeometry) {
        if geometry.cos_light > 0.0 {
            let shading = geometry.irradiance.map(|e| e * geometry.cos_light);
            self.add_shaded(radiance, shading, geometry.cos_view);
        }
    }
    /// Adds the radiance seen in one view of a diffuse layer under a dielectric surface, under a known light.
    pub(crate) fn add_layer(&mut self, radiance: [f32; 3], geometry: &ReflectionGeometry) {
        if geometry.cos_light > 0.0 {
            let factor = geometry.cos_light * lobes::layer_factor(geometry);
            self.add_shaded(radiance, geometry.irradiance.map(|e| e * factor), geometry.cos_view);
        }
    }
    /// Adds the radiance seen in one view where the lights are unknown: [`LambertSums::solve`] is then the weighted mean.
    pub(crate) fn add_unlit(&mut self, radiance: [f32; 3], cos_view: f32) {
        self.add_shaded(radiance, [1.0; 3], cos_view);
    }
    fn add_shaded(&mut self, radiance: [f32; 3], shading: [f32; 3], weight: f32) {
        if weight.is_nan() || weight <= 0.0 || !radiance.iter().chain(&shading).all(|x| x.is_finite()) {
            return;
        }
        let weight = weight as f64;
        for c in 0..3 {
            let s = shading[c] as f64;
            self.numerator[c] += weight * s * radiance[c] as f64;
            self.denominator[c] += weight * s * s;
        }
        self.weight += weight;
    }
    /// Sum of the weights (cosines) added so far: how well the point was seen.
    pub(crate) fn weight(&self) -> f64 {
        self.weight
    }
    /// `K_d` (the mean radiance where lights are unknown), not negative; `None` where nothing was seen.
    pub(crate) fn solve(&self) -> Option<[f32; 3]> {
        let solved = |c: usize| {
            if self.denominator[c] > 0.0 { (self.numerator[c] / self.denominator[c]).max(0.0) as f32 } else { 0.0 }
        };
        (self.weight > 0.0).then(|| std::array::from_fn(solved))
    }
}

/// Diffuse radiance `K_d E cos(theta_i)`; zero where the light is behind the surface.
pub(crate) fn evaluate(diffuse: [f32; 3], geometry: &ReflectionGeometry) -> [f32; 3] {
    let cos = geometry.cos_light.max(0.0);
    std::array::from_fn(|c| diffuse[c] * geometry.irradiance[c] * cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_recovers_the_albedo_and_ignores_the_unlit() {
        let diffuse = [0.2, 0.15, 0.01];
        let mut sums = LambertSums::default();
        for i in 0..12 {
            let geometry = ReflectionGeometry {
                irradiance: [3.0 + i as f32, 2.0, 1.0],
                cos_light: 1.0 - 0.15 * i as f32,
                cos_view: 0.9 - 0.05 * i as f32,
                ..Default::default()
            };
            sums.add(evaluate(diffuse, &geometry), &geometry);
        }
        sums.add(
            [f32::NAN; 3],
            &ReflectionGeometry { irradiance: [1.0; 3], cos_light: 1.0, cos_view: 1.0, ..Default::default() },
        );
        let solved = sums.solve().unwrap();
        assert!((0..3).all(|c| (solved[c] - diffuse[c]).abs() < 1e-6), "{solved:?}");
        assert_eq!(LambertSums::default().solve(), None);
    }

    #[test]
    fn without_lights_it_is_the_weighted_mean() {
        let mut sums = LambertSums::default();
        sums.add_unlit([1.0, 2.0, 3.0], 1.0);
        sums.add_unlit([4.0, 2.0, 0.0], 0.5);
        assert_eq!(sums.solve(), Some([2.0, 2.0, 2.0]));
    }
}
