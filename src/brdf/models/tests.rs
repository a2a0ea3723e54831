use super::published::parse;
use super::*;
use crate::brdf::test_data::shared;
use crate::brdf::{HalfDifference, errors, merl::MerlTable};
use std::path::Path;

fn lobes() -> Vec<Lobe> {
    vec![
        Lobe::Lambert,
        Lobe::BlinnPhong { exponent: 80.0 },
        Lobe::CookTorranceBeckmann { roughness: 0.2, reflectance: 0.1 },
        Lobe::CookTorranceGgx { roughness: 0.2, reflectance: 0.1 },
        Lobe::Ward { roughness: 0.2 },
        Lobe::WardAnisotropic { roughness: [0.2, 0.3] },
        Lobe::AshikhminShirley { exponents: [80.0, 40.0], reflectance: 0.1 },
        Lobe::Lafortune { xy: -1.0, z: 0.95, exponent: 20.0 },
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
    let bad = ClassicalModel { diffuse: [0.1; 3], specular: [1.0; 3], lobe: Lobe::Ward { roughness: f64::NAN } };
    assert!(bad.check().is_err());
}

#[test]
fn distributions_have_their_norm() {
    // Without shadowing and Fresnel, the projected distribution integrates to 1: at normal incidence, the albedo of a narrow lobe is
    // its reflectance.
    for lobe in [
        Lobe::CookTorranceBeckmann { roughness: 0.05, reflectance: 1.0 },
        Lobe::CookTorranceGgx { roughness: 0.01, reflectance: 1.0 },
        Lobe::Ward { roughness: 0.05 },
        Lobe::WardAnisotropic { roughness: [0.03, 0.06] },
        Lobe::AshikhminShirley { exponents: [2000.0; 2], reflectance: 1.0 },
    ] {
        let model = ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe };
        let albedo = errors::albedo(&model, 0.0)[0];
        assert!((albedo - 1.0).abs() < 0.03, "{} {albedo}", model.lobe.name());
    }
}

#[test]
fn fits_find_what_made_the_table() {
    for form in
        [Form::Lambert, Form::BlinnPhong, Form::CookTorranceGgx, Form::Ward, Form::AshikhminShirley, Form::Lafortune]
    {
        let lobe = lobes().into_iter().find(|lobe| lobe.name() == form.name()).unwrap();
        let lobe = match lobe {
            Lobe::AshikhminShirley { reflectance, .. } => Lobe::AshikhminShirley { exponents: [80.0; 2], reflectance },
            other => other,
        };
        let specular = if form == Form::Lambert { [0.0; 3] } else { [0.5, 0.4, 0.3] };
        let made = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular, lobe };
        let table = MerlTable::of(&made);
        for objective in [Objective::Logarithm, Objective::Picture, Objective::Both] {
            let found = fit(&table, form, objective).unwrap();
            let error = errors::log_rmse(&table, &found);
            assert!(error < 2e-4, "{form:?} {objective:?}: {error} {found:?}");
        }
    }
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
        let fits = read_published(folder.join(format!("{name}.fit"))).unwrap();
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
