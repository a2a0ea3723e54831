//! Any bytes as a sampling plan; a material is made of values at its angles.

use tsuya::brdf::MeasurementPlan;

pub fn fuzz(bytes: &[u8]) {
    let Ok(plan) = MeasurementPlan::from_json(bytes) else { return };
    let again = MeasurementPlan::from_json(plan.to_json().expect("a plan").as_bytes()).expect("our own plan");
    assert!(again == plan);
    if plan.angles.len() <= 64 {
        let values = plan.measure(|angles| Some([0.1, 0.2, angles.theta_h_deg / 90.0]));
        if let Ok(samples) = plan.reconstruct(&values, [4, 3, 2]) {
            assert!(samples.iter().flat_map(|sample| sample.value).all(|x| x >= 0.0));
        }
    }
}
