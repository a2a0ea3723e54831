use super::published::parse;
use super::*;
use crate::brdf::test_data::shared;
use crate::brdf::{HalfDifference, errors, merl::MerlTable};
use std::path::Path;

fn lobes() -> Vec<ClassicalLobe> {
    vec![
        ClassicalLobe::Lambert,
        ClassicalLobe::BlinnPhong { exponent: 80.0 },
        ClassicalLobe::CookTorranceBeckmann { roughness: 0.2, reflectance: 0.1 },
        ClassicalLobe::CookTorranceGgx { roughness: 0.2, reflectance: 0.1 },
        ClassicalLobe::Ward { roughness: 0.2 },
        ClassicalLobe::WardAnisotropic { roughness: [0.2, 0.3] },
        ClassicalLobe::AshikhminShirley { exponents: [80.0, 40.0], reflectance: 0.1 },
        ClassicalLobe::Lafortune { xy: -1.0, z: 0.95, exponent: 20.0 },
    ]
}

#[test]
fn models_are_reciprocal_and_read_as_written() {
    let (a, b) = (HalfDifference { theta_h: 0.2, theta_d: 0.7, phi_d: 0.8 }).directions();
    for lobe in lobes() {
        let model = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.5; 3], lobe };
        let (there, back) = (model.evaluate(a, b), model.evaluate(b, a));
        assert!((0..3).all(|c| (there[c] - back[c]).abs() < 1e-12 * there[c]), "{model:?}");
        assert_eq!(model.evaluate(a, [b[0], b[1], -b[2]]), [0.0; 3]);
        model.check().unwrap();
        let text = serde_json::to_string(&model).unwrap();
        assert!(text.contains(model.lobe.name()), "{text}");
        assert_eq!(serde_json::from_str::<ClassicalModel>(&text).unwrap(), model);
    }
    let bad =
        ClassicalModel { diffuse: [0.1; 3], specular: [1.0; 3], lobe: ClassicalLobe::Ward { roughness: f64::NAN } };
    assert!(bad.check().is_err());
}

#[test]
fn distributions_have_their_norm() {
    // Without shadowing and Fresnel, the projected distribution integrates to 1: at normal incidence, the albedo of a narrow lobe is
    // its reflectance.
    for lobe in [
        ClassicalLobe::CookTorranceBeckmann { roughness: 0.05, reflectance: 1.0 },
        ClassicalLobe::CookTorranceGgx { roughness: 0.01, reflectance: 1.0 },
        ClassicalLobe::Ward { roughness: 0.05 },
        ClassicalLobe::WardAnisotropic { roughness: [0.03, 0.06] },
        ClassicalLobe::AshikhminShirley { exponents: [2000.0; 2], reflectance: 1.0 },
    ] {
        let model = ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe };
        let albedo = errors::albedo(&model, 0.0)[0];
        assert!((albedo - 1.0).abs() < 0.03, "{} {albedo}", model.lobe.name());
    }
}

#[test]
fn rows_and_single_pairs_agree() {
    let (theta_h, theta_d) = (0.3, 0.8);
    let pairs: Vec<[[f64; 3]; 2]> = [0.4, 1.3, 2.9]
        .map(|phi_d| HalfDifference { theta_h, theta_d, phi_d }.directions())
        .map(|(incoming, outgoing)| [incoming, outgoing])
        .to_vec();
    for lobe in lobes() {
        let model = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.5; 3], lobe };
        let mut row = Vec::new();
        model.evaluate_row(theta_h, theta_d, &pairs, &mut row);
        for (&[incoming, outgoing], value) in pairs.iter().zip(&row) {
            let single = model.evaluate(incoming, outgoing);
            assert!((0..3).all(|c| (value[c] / single[c] - 1.0).abs() < 1e-9), "{model:?}: {value:?} {single:?}");
        }
        assert_eq!(row.len(), 3);
    }
}

#[test]
fn fits_find_what_made_the_table() {
    for form in [
        ClassicalForm::Lambert,
        ClassicalForm::BlinnPhong,
        ClassicalForm::CookTorranceGgx,
        ClassicalForm::Ward,
        ClassicalForm::AshikhminShirley,
        ClassicalForm::Lafortune,
    ] {
        let lobe = lobes().into_iter().find(|lobe| lobe.name() == form.name()).unwrap();
        let lobe = match lobe {
            ClassicalLobe::AshikhminShirley { reflectance, .. } => {
                ClassicalLobe::AshikhminShirley { exponents: [80.0; 2], reflectance }
            }
            other => other,
        };
        let specular = if form == ClassicalForm::Lambert { [0.0; 3] } else { [0.5, 0.4, 0.3] };
        let made = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular, lobe };
        let table = MerlTable::tabulate(&made);
        for objective in [FitObjective::Logarithm, FitObjective::Picture, FitObjective::Both] {
            let found = fit_classical(&table, form, objective).unwrap();
            let error = errors::log_rmse(&table, &found);
            assert!(error < 2e-4, "{form:?} {objective:?}: {error} {found:?}");
        }
    }
}

#[test]
fn anisotropic_fits_find_both_widths() {
    for (form, lobe) in [
        (ClassicalForm::WardAnisotropic, ClassicalLobe::WardAnisotropic { roughness: [0.12, 0.35] }),
        (
            ClassicalForm::AshikhminShirleyAnisotropic,
            ClassicalLobe::AshikhminShirley { exponents: [300.0, 20.0], reflectance: 0.1 },
        ),
    ] {
        let made = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.5, 0.4, 0.3], lobe };
        let direction = |k: usize, angle: f64, turn: f64| {
            let (sine, cosine) = (angle * ((k as f64 * 0.754_877_666) % 1.0).sqrt()).sin_cos();
            let (sin_p, cos_p) = (2.0 * PI * (k as f64 * turn)).sin_cos();
            [sine * cos_p, sine * sin_p, cosine]
        };
        let pair = |k: usize| {
            let half = direction(k, 1.2, 0.569_840_291);
            let outgoing = direction(k / 40, 1.3, 0.618_033_989);
            let twice = 2.0 * (0..3).map(|c| half[c] * outgoing[c]).sum::<f64>();
            let incoming: [f64; 3] = std::array::from_fn(|c| twice * half[c] - outgoing[c]);
            MeasuredPair { incoming, outgoing, value: made.evaluate(incoming, outgoing) }
        };
        let pairs: Vec<MeasuredPair> = (0..4000).map(pair).collect();
        for objective in [FitObjective::Logarithm, FitObjective::Both] {
            let found = fit_classical_pairs(&pairs, form, objective).unwrap();
            for pair in &pairs {
                let value = found.evaluate(pair.incoming, pair.outgoing);
                let close = |c: usize| (value[c] - pair.value[c]).abs() < 2e-3 * (pair.value[c] + 0.01);
                assert!((0..3).all(close), "{form:?} {objective:?}: {found:?}");
            }
        }
        assert!(fit_classical_pairs(&pairs[..15], form, FitObjective::Both).is_err());
    }
    // An isotropic table has two equal widths.
    let lobe = ClassicalLobe::Ward { roughness: 0.2 };
    let table = MerlTable::tabulate(&ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.5; 3], lobe });
    let found = fit_classical(&table, ClassicalForm::WardAnisotropic, FitObjective::Both).unwrap();
    let ClassicalLobe::WardAnisotropic { roughness } = found.lobe else { panic!("{found:?}") };
    assert!(roughness.iter().all(|r| (r / 0.2 - 1.0).abs() < 1e-3), "{found:?}");
    let as_form = fit_classical(&table, ClassicalForm::AshikhminShirleyAnisotropic, FitObjective::Both).unwrap();
    let ClassicalLobe::AshikhminShirley { exponents: [n, m], .. } = as_form.lobe else { panic!("{as_form:?}") };
    assert!((n / m).ln().abs() < 0.03, "{as_form:?}");
}

#[test]
fn published_lists_are_read() {
    let Some(folder) = shared("brdf/fits") else { return };
    for (name, count) in [
        ("ngan_blinnphong", 86),
        ("ngan_ward", 86),
        ("ngan_cooktorrance", 86),
        ("ngan_ashikhminshirley", 86),
        ("ngan_lafortune", 86),
        ("bagher_sgd", 100),
    ] {
        let fits = read_published(folder.join(format!("{name}.fit")), &Default::default()).unwrap();
        assert_eq!(fits.len(), count, "{name}");
    }
    let path = Path::new("x.fit");
    for (line, word) in [
        ("pvc", "line 2: no '='"),
        ("pvc = Lambertian(albedo = [1, 2])", "no second part"),
        ("pvc = Aggregate(Lambertian(albedo = [1, 2]), NganWard(albedo = [1, 2, 3], roughness = 0.1))", "2 numbers"),
        ("pvc = Aggregate(Lambertian(albedo = [1, 2, x]), NganWard(albedo = [1, 2, 3], roughness = 0.1))", "'x'"),
        ("pvc = Aggregate(Lambertian(albedo = [1, 2, 3]), NganWard(albedo = [1, 2, 3]))", "roughness is missing"),
        ("pvc = Aggregate(Lambertian(albedo = [1, 2, 3]), Wax(albedo = [1, 2, 3]))", "not known: Wax"),
        ("pvc = Aggregate(Lambertian(albedo = [1, 2, 3]), NganWard(albedo = [1, 2, 3], roughness = -1))", "not within"),
    ] {
        let said = parse(&format!("# list\n{line}\n"), path).unwrap_err().to_string();
        assert!(said.starts_with("x.fit: ") && said.contains(word), "{said}");
    }
}
