//! Rate control: the coarsest encoding that reaches a target.

use crate::container::Tag;
use crate::error::{Error, Result};
use crate::image::RgbImage;
use crate::metrics::Distortion;
use crate::options::EncodeTarget;

/// Photographs as a profile has coded them.
#[derive(Debug)]
pub(crate) struct CodedPhotographs {
    /// The profile's sections, in file order.
    pub sections: Vec<(Tag, Vec<u8>)>,
    /// The photographs that a decoder returns, by view.
    pub views: Vec<CodedView>,
    /// Their error.
    pub distortion: Distortion,
}

/// What is kept of a photograph as a decoder returns it.
#[derive(Debug, Clone)]
pub(crate) struct CodedView {
    /// Its error.
    pub distortion: Distortion,
    /// [`crate::views::Photograph::digest`] of it.
    pub digest: u64,
    /// Its sum, reduced, of the first view that shows the object.
    pub thumbnail: Option<RgbImage>,
}

/// The error of all views together.
pub(crate) fn total(views: &[CodedView]) -> Distortion {
    let mut total = Distortion::default();
    views.iter().for_each(|view| total.merge(&view.distortion));
    total
}

/// One encoding among those that a search tries.
#[derive(Debug)]
pub(crate) struct Candidate<T> {
    /// Its error.
    pub distortion: Distortion,
    /// Bytes of the file.
    pub bytes: u64,
    /// The encoding.
    pub content: T,
}

/// Most trials of a search.
const MAX_TRIALS: usize = 10;
/// Coarsest and finest quantiser step in the sqrt domain.
const STEP_RANGE: [f64; 2] = [1.0, 0.0008];
/// Smallest and largest share of kept coefficients, per cent.
const KEEP_PERCENT_RANGE: [f64; 2] = [0.01, 100.0];

/// Quantiser step of a quality 0 to 100.
fn step_of_quality(quality: f64) -> f64 {
    0.4 * (-quality / 25.0).exp2()
}

/// Quantiser step of profile `predictive` that a target leads to, about; `samples` are the pixels of all photographs' components.
pub(crate) fn expected_step(target: Option<EncodeTarget>, samples: u64) -> f64 {
    // Decibels at a step of 1, and bytes a sample at quality 75, of objects that fill a good third of their photographs.
    const PSNR: f64 = 13.4;
    const BYTES: f64 = 0.03;
    let default = step_of_quality(75.0);
    let step = match target {
        None | Some(EncodeTarget::KeepPercent(_)) => default,
        Some(EncodeTarget::Quality(quality)) => step_of_quality(quality),
        Some(EncodeTarget::PsnrDb(db)) => 10f64.powf((PSNR - db) / 20.0),
        Some(EncodeTarget::MaxError(error)) => error / 3.0,
        Some(EncodeTarget::MaxBytes(bytes)) => default * BYTES * samples as f64 / bytes as f64,
    };
    if step.is_nan() { default } else { step.clamp(STEP_RANGE[1], STEP_RANGE[0]) }
}

/// Searches the quantiser step of profile `predictive`.
pub(crate) fn search_step<T>(
    target: EncodeTarget,
    mut encode: impl FnMut(f32) -> Result<Candidate<T>>,
) -> Result<Candidate<T>> {
    match target {
        EncodeTarget::Quality(quality) if (0.0..=100.0).contains(&quality) => encode(step_of_quality(quality) as f32),
        EncodeTarget::Quality(_) => Err(Error::parameter("quality goes from 0 to 100")),
        EncodeTarget::KeepPercent(_) => Err(Error::parameter("option `keep_percent` is for profile wavelet-texture")),
        _ => search(target, STEP_RANGE, 0.05, |step| encode(step as f32)),
    }
}

/// Searches the share of kept coefficients of profile `wavelet-texture`, in per cent.
pub(crate) fn search_keep_percent<T>(
    target: EncodeTarget,
    mut encode: impl FnMut(f64) -> Result<Candidate<T>>,
) -> Result<Candidate<T>> {
    match target {
        EncodeTarget::KeepPercent(percent) if (0.0..=100.0).contains(&percent) => encode(percent),
        EncodeTarget::KeepPercent(_) => {
            Err(Error::parameter("the share of kept coefficients goes from 0 to 100 per cent"))
        }
        EncodeTarget::Quality(quality) if (0.0..=100.0).contains(&quality) => {
            encode((quality / 10.0 - 7.5).exp2() * 5.0)
        }
        EncodeTarget::Quality(_) => Err(Error::parameter("quality goes from 0 to 100")),
        _ => search(target, KEEP_PERCENT_RANGE, 2.0, encode),
    }
}

/// Distance of a trial from the target in a unit where halving the step adds about 1, negative where it misses; and whether
/// it is near enough to stop.
fn surplus<T>(target: EncodeTarget, trial: &Candidate<T>) -> (f64, bool) {
    match target {
        EncodeTarget::PsnrDb(db) => {
            let over = trial.distortion.psnr_db() - db;
            (over / 5.0, (0.0..0.04).contains(&over))
        }
        EncodeTarget::MaxError(error) => {
            let over = (error / trial.distortion.max_error.max(1e-9)).log2();
            (over, (0.0..0.08).contains(&over))
        }
        EncodeTarget::MaxBytes(bytes) => {
            let under = (bytes as f64 / trial.bytes as f64).ln();
            // Finer files are larger: the search goes the other way.
            (-under, (0.0..0.01).contains(&under))
        }
        EncodeTarget::Quality(_) | EncodeTarget::KeepPercent(_) => (0.0, true),
    }
}

/// Finds by secants on a logarithmic scale between `ends` (coarse, fine) the coarsest trial that holds a lower bound of
/// quality, or the finest that holds an upper bound of bytes.
fn search<T>(
    target: EncodeTarget,
    ends: [f64; 2],
    start: f64,
    mut encode: impl FnMut(f64) -> Result<Candidate<T>>,
) -> Result<Candidate<T>> {
    check_target(target)?;
    let for_bytes = matches!(target, EncodeTarget::MaxBytes(_));
    let [coarse, fine] = ends.map(f64::ln);
    let direction = (fine - coarse).signum();
    // Position on the scale: 0 is coarse, larger is finer, by factors of e.
    let (mut low, mut high) = ((0.0, f64::NAN), ((fine - coarse).abs(), f64::NAN));
    let mut at = (start.ln() - coarse).abs();
    let mut best: Option<(f64, Candidate<T>)> = None;
    for trial_number in 0..MAX_TRIALS {
        let trial = encode((coarse + direction * at).exp())?;
        let (value, near) = surplus(target, &trial);
        tracing::debug!(trial_number, at, value, bytes = trial.bytes, psnr = trial.distortion.psnr_db(), "trial");
        let holds = if for_bytes { value <= 0.0 } else { value >= 0.0 };
        let better = best.as_ref().is_none_or(|(best, _)| if for_bytes { at > *best } else { at < *best });
        if holds && better {
            best = Some((at, trial));
        }
        if holds && near {
            break;
        }
        if value >= 0.0 {
            high = (at, value);
        } else {
            low = (at, value);
        }
        let span = high.0 - low.0;
        if span < 1e-3 {
            break;
        }
        at = if low.1.is_nan() && high.1.is_nan() {
            at
        } else if low.1.is_nan() {
            // Never missed so far: go by the expected slope, at least to reach the end in the end.
            (high.0 - 0.7 * high.1.max(0.05) * 1.1).max(low.0)
        } else if high.1.is_nan() {
            (low.0 - 0.7 * low.1.min(-0.05) * 1.1).min(high.0)
        } else {
            let share = -low.1 / (high.1 - low.1);
            // A little to the safe side, and never too near an end.
            let share = if for_bytes { share - 0.01 } else { share + 0.01 };
            low.0 + span * share.clamp(0.05, 0.95)
        };
        let at_end = |end: f64| (at - end).abs() < 1e-9;
        if at_end(low.0) && !low.1.is_nan() || at_end(high.0) && !high.1.is_nan() {
            break;
        }
    }
    best.map(|(_, best)| best).ok_or_else(|| unreachable_target(target))
}

fn check_target(target: EncodeTarget) -> Result<()> {
    let valid = match target {
        EncodeTarget::PsnrDb(db) => db.is_finite() && db > 0.0,
        EncodeTarget::MaxError(error) => error.is_finite() && error > 0.0,
        EncodeTarget::MaxBytes(bytes) => bytes > 0,
        _ => true,
    };
    if valid { Ok(()) } else { Err(Error::parameter("the target must be a positive number")) }
}

fn unreachable_target(target: EncodeTarget) -> Error {
    Error::parameter(match target {
        EncodeTarget::PsnrDb(db) => format!("{db} dB can't be reached with this profile"),
        EncodeTarget::MaxError(error) => format!("a largest error of {error} can't be reached with this profile"),
        EncodeTarget::MaxBytes(bytes) => format!("{bytes} bytes are too few for mesh, views and the coarsest pictures"),
        _ => "the target can't be reached".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::{PhotographError, SquaredError};

    #[test]
    fn expected_steps_follow_their_targets() {
        let step = |target| expected_step(Some(target), 10_600_000);
        assert_eq!(step(EncodeTarget::Quality(75.0)), expected_step(None, 1));
        assert_eq!(step(EncodeTarget::Quality(100.0)), 0.5 * expected_step(None, 1));
        for near in [EncodeTarget::PsnrDb(39.4), EncodeTarget::MaxBytes(320_000), EncodeTarget::MaxError(0.15)] {
            assert!((step(near) / 0.05).ln().abs() < 0.05, "{near:?}: {}", step(near));
        }
        for odd in [EncodeTarget::PsnrDb(f64::NAN), EncodeTarget::MaxBytes(0), EncodeTarget::MaxError(-1.0)] {
            assert!((STEP_RANGE[1]..=STEP_RANGE[0]).contains(&step(odd)), "{odd:?}: {}", step(odd));
        }
    }

    /// An encoder whose PSNR and bytes follow the step as real ones do.
    fn trial(step: f32) -> Result<Candidate<f32>> {
        let step = step as f64;
        let psnr_db = -20.0 * (step * 0.3).log10() + 0.3 * (40.0 * step).sin();
        let error = PhotographError {
            sum: SquaredError { sum: 10f64.powf(-psnr_db / 10.0), count: 1 },
            ..PhotographError::default()
        };
        let bytes = (9000.0 + 4000.0 / step.powf(1.3)) as u64;
        Ok(Candidate { distortion: Distortion { error, max_error: step * 3.0 }, bytes, content: step as f32 })
    }

    #[test]
    fn targets_are_met_and_not_overdone() {
        for db in [20.0, 33.0, 38.0, 45.0, 60.0] {
            let got = search_step(EncodeTarget::PsnrDb(db), trial).unwrap().distortion.psnr_db();
            assert!((db..db + 0.3).contains(&got), "{db}: {got}");
        }
        for bytes in [20_000, 100_000, 3_000_000] {
            let got = search_step(EncodeTarget::MaxBytes(bytes), trial).unwrap().bytes;
            assert!(got <= bytes && got > bytes * 97 / 100, "{bytes}: {got}");
        }
        for error in [0.5, 0.05] {
            let got = search_step(EncodeTarget::MaxError(error), trial).unwrap().distortion.max_error;
            assert!(got <= error && got > error * 0.9, "{error}: {got}");
        }
    }

    #[test]
    fn impossible_targets_are_errors() {
        assert!(search_step(EncodeTarget::MaxBytes(9000), trial).is_err());
        assert!(search_step(EncodeTarget::PsnrDb(500.0), trial).is_err());
        assert!(search_step(EncodeTarget::PsnrDb(f64::NAN), trial).is_err());
        assert!(search_step(EncodeTarget::KeepPercent(5.0), trial).is_err());
        assert!(search_step(EncodeTarget::Quality(101.0), trial).is_err());
    }
}
