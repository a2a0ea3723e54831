//! Spectra as linear red, green and blue.
//!
//! The CIE 1931 standard observer by the piecewise Gaussians of Wyman, Sloan and Shirley 2013 ("Simple analytic approximations to the CIE
//! XYZ color matching functions", JCGT 2(2), equation 4), under illuminant D65 (CIE 15, 10 nm), with the primaries of sRGB (IEC
//! 61966-2-1). Each channel is a weighted mean of the spectrum: one that is 1 everywhere becomes (1, 1, 1).

/// Wavelengths that a column may have, nanometres.
pub(super) const MIN_WAVELENGTH: f64 = 200.0;
/// See [`MIN_WAVELENGTH`].
pub(super) const MAX_WAVELENGTH: f64 = 3000.0;
/// Wavelengths between which a spectrum must be known: beyond them eyes see a hundredth.
const MIN_NEEDED: f64 = 470.0;
const MAX_NEEDED: f64 = 620.0;

/// Illuminant D65 from 380 to 780 nm in steps of 10.
const D65: [f64; 41] = [
    49.9755, 54.6482, 82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.349, 61.604, 69.8856, 75.087, 63.5927, 46.4182,
    66.8054, 63.3828,
];
/// Linear sRGB of XYZ.
const SRGB_OF_XYZ: [[f64; 3]; 3] =
    [[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556], [0.0556434, -0.2040259, 1.0572252]];

/// Colour matching functions at a wavelength in nanometres.
fn observer(wavelength: f64) -> [f64; 3] {
    let lobe = |height: f64, centre: f64, below: f64, above: f64| {
        let t = (wavelength - centre) * if wavelength < centre { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    [
        lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.049, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    ]
}

/// Weights of the values at ascending wavelengths (nanometres) in red, green and blue. Between wavelengths spectra are straight, beyond
/// the first and last constant.
/// # Errors
/// A sentence where there are fewer than 3, or they leave out what eyes see.
pub(super) fn colour_weights(wavelengths: &[f64]) -> Result<Vec<[f64; 3]>, String> {
    let (first, last) = match wavelengths {
        [first, _, .., last] => (*first, *last),
        _ => return Err(format!("{} wavelengths, 3 or more are needed", wavelengths.len())),
    };
    if first > MIN_NEEDED || last < MAX_NEEDED {
        return Err(format!(
            "wavelengths from {first} to {last} nm: from {MIN_NEEDED} nm or below to {MAX_NEEDED} nm or above are needed"
        ));
    }
    let mut weights = vec![[0.0; 3]; wavelengths.len()];
    for step in 0..=400 {
        let wavelength = 380.0 + step as f64;
        let (k, t) = (step / 10, (step % 10) as f64 / 10.0);
        let light = D65[k] + t * (D65[(k + 1).min(40)] - D65[k]);
        let xyz = observer(wavelength).map(|bar| bar * light);
        let rgb = SRGB_OF_XYZ.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]);
        let above = wavelengths.partition_point(|&w| w < wavelength).clamp(1, wavelengths.len() - 1);
        let (a, b) = (wavelengths[above - 1], wavelengths[above]);
        let part = ((wavelength - a) / (b - a)).clamp(0.0, 1.0);
        for c in 0..3 {
            weights[above - 1][c] += (1.0 - part) * rgb[c];
            weights[above][c] += part * rgb[c];
        }
    }
    let sums = weights.iter().fold([0.0; 3], |sums, w| [0, 1, 2].map(|c| sums[c] + w[c]));
    Ok(weights.into_iter().map(|w| [0, 1, 2].map(|c| w[c] / sums[c])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_observer_is_the_published_one_and_white_is_white() {
        // CIE 1931, 2 degrees: the fit is within 0.02 everywhere.
        for (wavelength, expected) in
            [(450.0, [0.3362, 0.038, 1.7721]), (555.0, [0.5121, 1.0, 0.0057]), (600.0, [1.0622, 0.631, 0.0008])]
        {
            let found = observer(wavelength);
            assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 0.05), "{wavelength}: {found:?}");
        }
        for steps in [3, 31] {
            let wavelengths: Vec<f64> = (0..steps).map(|k| 400.0 + 300.0 * k as f64 / (steps - 1) as f64).collect();
            let weights = colour_weights(&wavelengths).unwrap();
            let white = weights.iter().fold([0.0; 3], |sum, w| [0, 1, 2].map(|c| sum[c] + w[c]));
            assert!(white.iter().all(|x| (x - 1.0).abs() < 1e-12), "{white:?}");
            // What reflects long waves is red.
            let red = wavelengths.iter().zip(&weights).filter(|(w, _)| **w > 600.0);
            let red = red.fold([0.0; 3], |sum, (_, w)| [0, 1, 2].map(|c| sum[c] + w[c]));
            assert!(steps == 3 || red[0] > 0.7 && red[1] < 0.1 && red[2].abs() < 0.05, "{red:?}");
        }
        assert!(colour_weights(&[450.0, 650.0]).unwrap_err().contains("3 or more"));
        assert!(colour_weights(&[500.0, 550.0, 700.0]).unwrap_err().contains("470"));
    }
}
