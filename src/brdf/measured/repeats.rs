//! Means of repeated measurements, and the noise that they show.

use super::{MeasuredSamples, NoiseSource};
use crate::brdf::MeasuredSample;
use std::collections::BTreeMap;

/// Degrees of freedom that the assumed noise counts for beside that of repeats.
const ASSUMED_FREEDOM: f64 = 3.0;
/// Directions are the same where their vectors agree to this part.
const SAME_DIRECTION: f64 = 1e-5;

/// A row with a value.
pub(super) struct RawSample {
    pub incoming: [f64; 3],
    pub outgoing: [f64; 3],
    pub value: [f64; 3],
    /// Relative and per steradian.
    pub noise: Option<[f64; 2]>,
}

/// Samples with their deviations.
pub(super) struct MergedSamples {
    pub samples: Vec<MeasuredSample>,
    pub relative_noise: f64,
    pub source: NoiseSource,
    pub remark: Option<String>,
}

/// Averages rows of the same directions. `last_digit` is what the last digit of the most exact value counts, whose rounding adds to the noise.
pub(super) fn merge(raw: Vec<RawSample>, last_digit: f64) -> MergedSamples {
    let mut places: BTreeMap<[i64; 6], usize> = BTreeMap::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, sample) in raw.iter().enumerate() {
        let of = |k: usize| if k < 3 { sample.incoming[k] } else { sample.outgoing[k - 3] };
        let key = std::array::from_fn(|k| (of(k) / SAME_DIRECTION).round() as i64);
        let group = *places.entry(key).or_insert_with(|| {
            groups.push(Vec::new());
            groups.len() - 1
        });
        groups[group].push(index);
    }
    let mean = |group: &[usize], of: &dyn Fn(&RawSample) -> f64| {
        group.iter().map(|&index| of(&raw[index])).sum::<f64>() / group.len() as f64
    };
    // Squared relative differences to the means of repeats, and their degrees of freedom.
    let (mut squares, mut freedom) = (0.0, 0.0);
    for group in groups.iter().filter(|group| group.len() > 1) {
        let means = [0, 1, 2].map(|c| mean(group, &|sample| sample.value[c]));
        // One value for all colours is one measurement.
        let channels = if group.iter().all(|&i| raw[i].value == [raw[i].value[0]; 3]) { 1 } else { 3 };
        for c in (0..channels).filter(|&c| means[c] > 2.0 * last_digit) {
            squares += group.iter().map(|&i| (raw[i].value[c] / means[c] - 1.0).powi(2)).sum::<f64>();
            freedom += (group.len() - 1) as f64;
        }
    }
    let assumed = MeasuredSamples::ASSUMED_NOISE;
    let pooled = ((squares + ASSUMED_FREEDOM * assumed * assumed) / (freedom + ASSUMED_FREEDOM)).sqrt();
    let stated = raw.iter().filter(|sample| sample.noise.is_some()).count();
    let source = match (stated > 0, freedom > 0.0) {
        (true, _) => NoiseSource::Stated,
        (_, true) => NoiseSource::Repeats,
        _ => NoiseSource::Assumed,
    };
    let rounding = last_digit / 12f64.sqrt();
    let mut relative = Vec::with_capacity(groups.len());
    let samples = (groups.iter())
        .map(|group| {
            let value = [0, 1, 2].map(|c| mean(group, &|sample| sample.value[c]));
            let deviation = [0, 1, 2].map(|c| {
                let square = |sample: &RawSample| {
                    let [part, plain] = sample.noise.unwrap_or([pooled, 0.0]);
                    (part * value[c]).powi(2) + plain * plain
                };
                (mean(group, &square) / group.len() as f64 + rounding * rounding).sqrt()
            });
            let brightest = (0..3).max_by(|&a, &b| value[a].total_cmp(&value[b])).unwrap_or(0);
            if value[brightest] > 0.0 {
                relative.push(deviation[brightest] * (group.len() as f64).sqrt() / value[brightest]);
            }
            let RawSample { incoming, outgoing, .. } = raw[group[0]];
            MeasuredSample { incoming, outgoing, value, deviation }
        })
        .collect();
    relative.sort_by(f64::total_cmp);
    let relative_noise = relative.get(relative.len() / 2).copied().unwrap_or(assumed);
    let shown = (squares / freedom.max(1.0)).sqrt();
    let doubtful = source == NoiseSource::Stated && freedom >= 3.0 && shown > 2.0 * relative_noise;
    let remark = doubtful.then(|| {
        format!(
            "repeats differ by {:.1} %, more than twice the stated noise of {:.1} %",
            100.0 * shown,
            100.0 * relative_noise
        )
    });
    MergedSamples { samples, relative_noise, source, remark }
}
