//! The prediction of a picture's coefficients, of one part or two, each scaled by gains.
//!
//! Other views predict a picture, and the reflectance corrects that prediction. How far either is to be trusted differs from band to
//! band and from object to object, so each part has gains of its own (normative, `spec/planes.md` section 7).

use super::gains::{self, BAND_CLASSES, BUCKETS, GainModels, GainSums, PredictionGains, UNITY};
use crate::entropy::BitCoder;
use crate::quantise::bands::{Quantiser, RateDistortion};
use crate::transform::shape_adaptive::{ColourLanes, Subband};
use std::borrow::Cow;

/// Coefficients of a picture's predictions, of the first bands of its plan. A picture coded alone has none.
#[derive(Debug, Clone, Copy, Default)]
pub struct Prediction<'a> {
    /// By other views.
    pub views: Option<&'a [Vec<ColourLanes>]>,
    /// What the model of the reflectance has beyond that.
    pub correction: Option<&'a [Vec<ColourLanes>]>,
}

/// A prediction as positions take it: coefficients and the gains that they still are to be scaled by.
pub(super) struct ScaledPrediction<'a> {
    pub(super) bands: Cow<'a, [Vec<ColourLanes>]>,
    pub(super) gains: PredictionGains,
}

/// Gains of a prediction that is scaled already.
const SCALED: PredictionGains = [[[UNITY; BUCKETS]; 3]; BAND_CLASSES];

impl<'a> Prediction<'a> {
    /// Number of bands that are predicted.
    pub(super) fn band_count(&self) -> usize {
        self.views.or(self.correction).map_or(0, <[_]>::len)
    }

    /// Codes the gains of both parts; in encoding, `target` is the picture and they are those of least error. Returns `None` without a prediction.
    pub(super) fn scaled<C: BitCoder>(
        &self,
        coder: &mut C,
        [views, correction]: [&mut GainModels; 2],
        bands: &[Subband],
        quantiser: &Quantiser,
        target: Option<(&[Vec<ColourLanes>], RateDistortion)>,
    ) -> Option<ScaledPrediction<'a>> {
        let bands = &bands[..self.band_count()];
        let mut used = [false; BAND_CLASSES];
        bands.iter().for_each(|band| used[gains::band_class(band)] = true);
        let mut both = [*views.last(), *correction.last()];
        if let Some((target, choice)) = target {
            choose_gains(&mut both, [self.views, self.correction], bands, quantiser, target, choice);
        }
        let [mut of_views, mut of_correction] = both;
        if self.views.is_some() {
            views.code(coder, &mut of_views, &used);
        }
        let Some(corrected) = self.correction else {
            return self.views.map(|views| ScaledPrediction { bands: Cow::Borrowed(views), gains: of_views });
        };
        correction.code(coder, &mut of_correction, &used);
        let sum = |(index, band): (usize, &Subband)| {
            let (class, inverse) = (gains::band_class(band), 1.0 / quantiser.band_step(band));
            let scaled = |part: &ColourLanes, gains: &PredictionGains| -> ColourLanes {
                let mut scaled = [0.0; 4];
                for colour in 0..3 {
                    scaled[colour] = gains::scale(part[colour], &gains[class][colour], inverse);
                }
                scaled
            };
            let mut sum: Vec<ColourLanes> = corrected[index].iter().map(|part| scaled(part, &of_correction)).collect();
            for (sum, part) in sum.iter_mut().zip(self.views.into_iter().flat_map(|views| &views[index])) {
                let part = scaled(part, &of_views);
                *sum = std::array::from_fn(|k| part[k] + sum[k]);
            }
            sum
        };
        let bands = bands.iter().enumerate().map(sum).collect();
        Some(ScaledPrediction { bands: Cow::Owned(bands), gains: SCALED })
    }
}

/// Passes over the gains of a class, each of which depends on those of the other part.
const PASSES: usize = 30;
/// A part's buckets, then the other's.
const UNKNOWNS: usize = 2 * BUCKETS;

/// Sums over the coefficients of a class and colour: products of the target with each part's buckets, and of these with each other.
#[derive(Debug, Clone, Copy, Default)]
struct PairSums {
    target: [f64; UNKNOWNS],
    products: [[f64; UNKNOWNS]; UNKNOWNS],
}

impl PairSums {
    /// The least-squares problem of one gain, given the others.
    fn of(&self, k: usize, gains: &[f64; UNKNOWNS]) -> GainSums {
        let others = (0..UNKNOWNS).filter(|&other| other != k);
        let explained: f64 = others.map(|other| gains[other] * self.products[k][other]).sum();
        GainSums { cross: self.target[k] - explained, square: self.products[k][k] }
    }
}

/// Sets the gains of both parts to those of least error, one after the other. Where a part is missing its gains stay.
fn choose_gains(
    gains: &mut [PredictionGains; 2],
    parts: [Option<&[Vec<ColourLanes>]>; 2],
    bands: &[Subband],
    quantiser: &Quantiser,
    target: &[Vec<ColourLanes>],
    choice: RateDistortion,
) {
    let mut sums = [[PairSums::default(); 3]; BAND_CLASSES];
    for (index, band) in bands.iter().enumerate() {
        let (class, step) = (gains::band_class(band), quantiser.band_step(band));
        for (at, target) in target[index].iter().enumerate().filter(|(at, _)| band.mask.data[*at]) {
            let parts = parts.map(|part| part.map_or([0.0; 4], |part| part[index][at]));
            for colour in 0..3 {
                let sums = &mut sums[class][colour];
                let [a, b] = parts.map(|part| part[colour] as f64);
                let [i, j] = parts.map(|part| gains::bucket(part[colour].abs() / step));
                let j = BUCKETS + j;
                sums.target[i] += a * target[colour] as f64;
                sums.target[j] += b * target[colour] as f64;
                sums.products[i][i] += a * a;
                sums.products[j][j] += b * b;
                sums.products[i][j] += a * b;
                sums.products[j][i] += a * b;
            }
        }
    }
    let lambda = choice.lambda as f64 * (quantiser.step as f64).powi(2);
    for class in 0..BAND_CLASSES {
        for colour in 0..3 {
            let sums = &sums[class][colour];
            let mut found: [f64; UNKNOWNS] =
                std::array::from_fn(|k| gains[k / BUCKETS][class][colour][k % BUCKETS] as f64 / UNITY as f64);
            for _ in 0..PASSES {
                (0..UNKNOWNS).for_each(|k| found[k] = sums.of(k, &found).best().unwrap_or(found[k]));
            }
            for k in 0..UNKNOWNS {
                let gain = &mut gains[k / BUCKETS][class][colour][k % BUCKETS];
                *gain = sums.of(k, &found).choose(*gain, lambda);
                found[k] = *gain as f64 / UNITY as f64;
            }
        }
    }
}
