//! A monotone cubic through equally spaced values.

/// Cubic Hermite pieces between values at 0, 1, 2, ...; constant beyond both ends.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MonotoneCubic {
    values: Vec<f64>,
    slopes: Vec<f64>,
}

impl MonotoneCubic {
    /// Slopes by the harmonic mean of the neighbouring differences, 0 at extrema and ends: the curve stays between neighbours.
    pub(super) fn new(values: Vec<f64>) -> Self {
        let slope = |k: usize| match (k.checked_sub(1).and_then(|b| values.get(b)), values.get(k), values.get(k + 1)) {
            (Some(before), Some(here), Some(after)) => {
                let (left, right) = (here - before, after - here);
                if left * right > 0.0 { 2.0 * left * right / (left + right) } else { 0.0 }
            }
            _ => 0.0,
        };
        let slopes = (0..values.len()).map(slope).collect();
        MonotoneCubic { values, slopes }
    }

    pub(super) fn value_at(&self, x: f64) -> f64 {
        let last = self.values.len().saturating_sub(1);
        let x = x.clamp(0.0, last as f64);
        let k = (x as usize).min(last.saturating_sub(1));
        let t = x - k as f64;
        let piece = |of: &[f64], k: usize| of.get(k).copied().unwrap_or(0.0);
        let (a, b) = (piece(&self.values, k), piece(&self.values, (k + 1).min(last)));
        let (p, q) = (piece(&self.slopes, k), piece(&self.slopes, (k + 1).min(last)));
        let u = 1.0 - t;
        a * u * u * (1.0 + 2.0 * t) + b * t * t * (1.0 + 2.0 * u) + p * t * u * u - q * u * t * t
    }
}
