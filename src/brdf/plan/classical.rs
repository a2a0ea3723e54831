//! A population of classical models, for want of measured materials.

use super::Population;
use crate::brdf::{Brdf, ClassicalLobe, ClassicalModel};

/// Squared errors of measured materials over those that the models' own statistics lead to expect: such materials are not models.
const DISCREPANCY: f64 = 9.0;
/// Number of models.
const MODELS: usize = 60;

impl Population {
    /// A population of classical models, for want of measured materials: Lambertian parts and GGX lobes whose colours and widths are spread as
    /// evenly as can be (Roberts 2018, additive sequence).
    pub fn of_classical_models() -> Self {
        let mut population = Population::new().with_discrepancy(DISCREPANCY);
        for n in 0..MODELS {
            let model = model(n);
            // Cells are above the horizon at their middles, so that a model has a value at each.
            let _ = population.add_values(|_, angles| {
                let (incoming, outgoing) = angles.directions();
                Some(model.evaluate(incoming, outgoing))
            });
        }
        population
    }
}

fn model(n: usize) -> ClassicalModel {
    /// The positive root of `x^7 = x + 1`.
    const ROOT: f64 = 1.112_775_684_278_706;
    let part = |k: i32| (0.5 + (n + 1) as f64 * ROOT.powi(-k)).fract();
    let between = |part: f64, low: f64, high: f64| low * (high / low).powf(part);
    // Every third is a metal: hardly a diffuse part, a coloured highlight.
    let metal = n.is_multiple_of(3);
    let colour = |k: i32, low: f64, high: f64| [0, 1, 2].map(|c| between(part((k + c) % 6 + 1), low, high));
    let diffuse = if metal { colour(1, 0.001, 0.1) } else { colour(1, 0.02, 0.8) };
    let specular = if metal { colour(4, 0.3, 1.0) } else { [between(part(4), 0.1, 1.0); 3] };
    let reflectance = if metal { between(part(5), 0.3, 0.9) } else { between(part(5), 0.02, 0.15) };
    let lobe = ClassicalLobe::CookTorranceGgx { roughness: between(part(6), 0.02, 0.7), reflectance };
    ClassicalModel { diffuse, specular, lobe }
}
