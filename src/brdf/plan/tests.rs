use super::*;
use crate::brdf::{Brdf, HalfDifference};

/// Diffuse and a highlight of any height and width.
struct Made(f64, f64, f64);

impl Brdf for Made {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let angles = HalfDifference::from_directions(incoming, outgoing);
        let highlight =
            self.1 * (-(angles.theta_h / self.2).powi(2)).exp() * (1.0 + 3.0 * angles.theta_d.sin().powi(5));
        [self.0 + highlight, 0.6 * self.0 + highlight, 0.3 * self.0 + highlight]
    }
}

fn made(n: usize) -> Made {
    let part = |k: usize| ((n * k) % 17) as f64 / 17.0;
    Made(0.02 + 0.3 * part(5), 0.1 * 100f64.powf(part(7)), 0.08 + 0.5 * part(3))
}

fn add(population: &mut Population, n: usize) {
    let value = |_: usize, angles: HalfDifference| {
        let (incoming, outgoing) = angles.directions();
        Some(made(n).evaluate(incoming, outgoing))
    };
    population.add_values(value).unwrap();
}

fn log_rmse(truth: &Made, samples: &[BrdfSample]) -> f64 {
    let square = |s: &BrdfSample| {
        let angles = HalfDifference { theta_h: s.theta_h, theta_d: s.theta_d, phi_d: 1.0 };
        let value = truth.evaluate(angles.directions().0, angles.directions().1);
        ((s.value[1] * s.cos_incoming).ln_1p() - (value[1] * s.cos_incoming).ln_1p()).powi(2)
    };
    (samples.iter().map(square).sum::<f64>() / samples.len() as f64).sqrt()
}

#[test]
fn a_few_chosen_samples_are_worth_many_uniform_ones() {
    let mut population = Population::new();
    for n in 0..12 {
        add(&mut population, n);
    }
    assert_eq!(population.len(), 12);
    let error = |count: usize, method: PlanMethod| {
        let plan = population.plan(count, method).unwrap();
        assert_eq!(plan.angles.len(), count);
        assert!(plan.expected_log_rmse > 0.0 && plan.expected_log_rmse < 1.0, "{}", plan.expected_log_rmse);
        let plan = MeasurementPlan::from_json(plan.to_json().unwrap().as_bytes()).unwrap();
        (12..17)
            .map(|n| {
                let material = made(n);
                let at = |a: &PlannedAngles| {
                    let (incoming, outgoing) = a.half_difference().directions();
                    (incoming[2] > 0.0 && outgoing[2] > 0.0).then(|| material.evaluate(incoming, outgoing))
                };
                log_rmse(&material, &plan.reconstruct(&plan.measure(at), [20, 15, 4]).unwrap())
            })
            .sum::<f64>()
    };
    let (optimal, uniform) = (error(16, PlanMethod::Optimal), error(100, PlanMethod::Uniform));
    assert!(optimal < uniform, "optimal {optimal}, uniform {uniform}");
    assert!(population.plan(0, PlanMethod::Optimal).is_err());
}

#[test]
fn steps_shrink_where_materials_differ() {
    let mut variance = vec![0.1; 90];
    variance[..10].fill(2.0);
    let near = |plan: &[HalfDifference]| plan.iter().filter(|a| a.theta_h.to_degrees() < 10.0).count();
    let steps = |variance, least: f64| {
        choose::ThetaHSteps { min_theta_h: least.to_radians(), variance, floor: 0.01 }.along_theta_h(90, 4)
    };
    let (uniform, published) = (steps(None, 0.0), steps(Some(&variance[..]), 0.0));
    assert_eq!((uniform.len(), published.len()), (90, 90));
    assert!(2 * near(&published) > 3 * near(&uniform), "{} and {}", near(&published), near(&uniform));
    // From 5 degrees on the same, in what is left.
    let (uniform, published) = (steps(None, 5.0), steps(Some(&variance[..]), 5.0));
    for plan in [&uniform, &published] {
        assert!(plan.iter().all(|a| (5.0..90.0).contains(&a.theta_h.to_degrees())));
    }
    assert!(2 * near(&published) > 3 * near(&uniform), "{} and {}", near(&published), near(&uniform));
}

#[test]
fn damaged_plans_are_refused() {
    let mut population = Population::new();
    assert!(population.plan(8, PlanMethod::Uniform).is_err());
    for n in 0..3 {
        add(&mut population, n);
    }
    let plan = population.plan(8, PlanMethod::Variance).unwrap();
    let text = plan.to_json().unwrap();
    assert!(MeasurementPlan::from_json(text.replace("plan-1", "plan-9").as_bytes()).is_err());
    assert!(MeasurementPlan::from_json(&text.as_bytes()[..text.len() / 2]).is_err());
    let mut wrong = plan.clone();
    wrong.components.mean.pop();
    assert!(MeasurementPlan::from_json(wrong.to_json().unwrap().as_bytes()).is_err());
    assert!(plan.reconstruct(&[None; 8], [4, 4, 2]).is_err());
    assert!(plan.reconstruct(&[None; 7], [4, 4, 2]).is_err());
}
