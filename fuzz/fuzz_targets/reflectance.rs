//! Any bytes as section `RFLC` of a small atlas.

use tsuya::Component;
use tsuya::internals::{self, reflectance::ReflectionGeometry};
use tsuya::{Budget, Limits};
use tsuya_fuzz::scene;

pub fn fuzz(bytes: &[u8]) {
    let budget = Budget::new(Limits { memory_bytes: 1 << 24, ..Limits::default() });
    if let Ok(maps) = internals::reflectance::decode(bytes, &scene::mesh(), &scene::charts(), &budget) {
        assert!(maps.diffuse.data.iter().chain(&maps.specular.data).flatten().all(|x| x.is_finite() && *x >= 0.0));
        assert!(maps.sigma.data.iter().all(|x| (0.019..=0.81).contains(x)));
        // Whatever the palette is, light stays finite and not negative, and so do the maps made Gaussian.
        for alpha in [0.0f32, 0.03, 0.4, 1.5] {
            let (irradiance, cos_light, cos_view, cos_half) = ([1.0; 3], 0.5, 0.5, alpha.cos());
            let (difference, cos_difference) = (0.4f32, 0.4f32.cos());
            let cosines =
                ReflectionGeometry { irradiance, cos_light, cos_view, cos_half, alpha, difference, cos_difference };
            let light = internals::reflectance::evaluate(&maps, Component::Specular, [12.0, 9.0], Some(&cosines));
            assert!(light.iter().all(|x| x.is_finite() && *x >= 0.0));
        }
        let plain = maps.without_palette();
        assert!(plain.sigma.data.iter().all(|x| (0.0..=0.81).contains(x)));
    }
}
