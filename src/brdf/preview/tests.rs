use super::*;
use crate::brdf::models::{ClassicalLobe, ClassicalModel};

fn scenes() -> SphereScenes {
    SphereScenes::new(32, &PreviewEnvironment::new(&studio_environment()))
}

#[test]
fn white_in_white_is_white() {
    let white = PreviewEnvironment::new(&Grid::filled(64, 32, [1.0; 3]));
    let scenes = SphereScenes::new(32, &white);
    let lambert = ClassicalModel { diffuse: [1.0; 3], specular: [0.0; 3], lobe: ClassicalLobe::Lambert };
    let picture = scenes.render_environment(&lambert);
    for (pixel, _) in picture.data.iter().zip(&scenes.mask().data).filter(|(_, inside)| **inside) {
        assert!((pixel[1] - 1.0).abs() < 0.02, "{pixel:?}");
    }
    // A sharp lobe is integrated, too: at normal incidence its albedo is 1.
    let lobe = ClassicalLobe::CookTorranceGgx { roughness: 0.01, reflectance: 1.0 };
    let mirror = scenes.render_environment(&ClassicalModel { diffuse: [0.0; 3], specular: [1.0; 3], lobe });
    assert!((mirror.value_at(16, 16)[0] - 1.0).abs() < 0.05, "{:?}", mirror.value_at(16, 16));
}

#[test]
fn a_lambertian_sphere_under_a_point_light() {
    let lambert = ClassicalModel { diffuse: [0.5; 3], specular: [0.0; 3], lobe: ClassicalLobe::Lambert };
    let far = [0.0, 0.0, 1000.0];
    let picture = scenes().render_point_light(&lambert, far);
    let expected = 0.5 / PI;
    assert!((f64::from(picture.value_at(16, 16)[0]) / expected - 1.0).abs() < 5e-3, "{:?}", picture.value_at(16, 16));
    // Place 24 is at 0.53 from the middle: cosine 0.848.
    assert!((f64::from(picture.value_at(24, 16)[0]) / expected - 0.847).abs() < 5e-3, "{:?}", picture.value_at(24, 16));
}

#[test]
fn psnr_tells_materials_apart() {
    let model = |roughness: f64| {
        let lobe = ClassicalLobe::CookTorranceGgx { roughness, reflectance: 0.1 };
        ClassicalModel { diffuse: [0.3, 0.1, 0.1], specular: [1.0; 3], lobe }
    };
    let scenes = scenes();
    let same = scenes.psnr(&model(0.1), &model(0.1));
    assert_eq!((same.point, same.environment), (100.0, 100.0));
    let near = scenes.psnr(&model(0.1), &model(0.102));
    let far = scenes.psnr(&model(0.1), &model(0.2));
    assert!(near.point > far.point + 10.0 && near.environment > far.environment + 10.0, "{near:?} {far:?}");
    assert!((15.0..40.0).contains(&far.point) && (15.0..40.0).contains(&far.environment), "{far:?}");
}
