use super::*;
use crate::brdf::BrdfSample;
use crate::container::Tag;

/// Two lobes whose parameters change with `theta_d`.
struct TwoLobes;

impl Brdf for TwoLobes {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let angles = crate::brdf::HalfDifference::from_directions(incoming, outgoing);
        let broad = DsbrdfLobe { kappa: 0.1, gamma: 0.5, amplitude: 1.0 }.value_at(angles.theta_h.cos());
        let narrow = DsbrdfLobe { kappa: 2.0, gamma: 60.0 + 20.0 * angles.theta_d, amplitude: 1.0 }
            .value_at(angles.theta_h.cos());
        [broad + narrow, broad + 0.5 * narrow, broad]
    }
}

#[test]
fn known_lobes_are_found_and_come_back_from_bytes() {
    let samples = BrdfSample::tabulate(&TwoLobes, [45, 30, 12]);
    let options = DsbrdfFitOptions { lobes: LobeCount::Given(2), rounds: 60, ..Default::default() };
    let material = fit_dsbrdf(&samples, &options).unwrap();
    let error = samples.iter().filter(|s| s.theta_h > 0.1).map(|s| {
        let value = material.value_at(s.theta_h, s.theta_d);
        (0..3).map(|c| (value[c] / s.value[c].max(1e-3)).ln().abs()).fold(0.0, f64::max)
    });
    let mut error: Vec<f64> = error.collect();
    error.sort_by(f64::total_cmp);
    let ninety = error[error.len() * 9 / 10];
    assert!(ninety < 0.08, "nine tenths within {ninety}");
    let bytes = material.encode();
    assert!(bytes.len() < 400, "{} bytes", bytes.len());
    assert_eq!(DsbrdfMaterial::decode(&bytes, Tag::MATERIALS).unwrap(), material);
    for cut in 0..bytes.len() {
        assert!(DsbrdfMaterial::decode(&bytes[..cut], Tag::MATERIALS).is_err(), "cut at {cut}");
    }
    assert!(DsbrdfMaterial::decode(&[bytes.as_slice(), &[7]].concat(), Tag::MATERIALS).is_err());
}

#[test]
fn the_number_of_lobes_follows_the_error() {
    let samples = BrdfSample::tabulate(&TwoLobes, [45, 12, 6]);
    let options = DsbrdfFitOptions { slices: 6, lobes: LobeCount::ByError, ..Default::default() };
    assert!(fit_dsbrdf(&samples, &options).unwrap().lobe_count() >= 2);
    assert!(fit_dsbrdf(&[], &options).is_err());
}

#[test]
fn a_parameter_at_the_end_of_the_integers_is_out_of_range() {
    // The second step goes from -1 to the least integer, whose magnitude is none.
    let mut quantised = vec![0; 3 * 2 * 2];
    quantised[..2].copy_from_slice(&[-1, i32::MIN]);
    assert!(DsbrdfMaterial::new(2, 1, false, quantised.clone()).is_none());
    let bytes = DsbrdfMaterial { slices: 2, lobes: 1, amplitudes: false, quantised, curves: Vec::new() }.encode();
    assert!(DsbrdfMaterial::decode(&bytes, Tag::MATERIALS).is_err());
}
