//! The colour transform of a component, chosen from its pixels.

use crate::transform::colour::principal_axes;

/// Sums over pixels for the covariance of their colours.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ColourSums {
    count: f64,
    sum: [f64; 3],
    product: [[f64; 3]; 3],
}

impl ColourSums {
    /// Adds a pixel.
    pub(crate) fn add(&mut self, colour: [f32; 3]) {
        let c = colour.map(f64::from);
        self.count += 1.0;
        for i in 0..3 {
            self.sum[i] += c[i];
            for j in 0..3 {
                self.product[i][j] += c[i] * c[j];
            }
        }
    }

    /// Orthonormal rotation to the principal axes, strongest first, rows in 1/16384. Each axis points to brighter colours.
    pub(crate) fn rotation(&self) -> [[i16; 3]; 3] {
        let n = self.count.max(1.0);
        let covariance = std::array::from_fn(|i| {
            std::array::from_fn(|j| self.product[i][j] / n - self.sum[i] * self.sum[j] / (n * n))
        });
        principal_axes(covariance).map(|axis| axis.map(|v| (v * 16384.0).round() as i16))
    }
}

#[cfg(test)]
mod tests {
    use crate::predictive::colour::*;

    #[test]
    fn finds_the_grey_axis_and_is_orthonormal() {
        let mut sums = ColourSums::default();
        for i in 0..1000 {
            let (grey, red) = ((i % 37) as f32, (i % 5) as f32 * 0.3);
            sums.add([grey + red, grey, grey - 0.1 * red]);
        }
        let rows = sums.rotation().map(|r| r.map(|v| v as f64 / 16384.0));
        assert!(rows[0].iter().all(|&v| (v - 0.577).abs() < 0.02), "{rows:?}");
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| rows[i][k] * rows[j][k]).sum();
                assert!((product - (i == j) as i32 as f64).abs() < 1e-3);
            }
        }
    }
}
