//! Any bytes as a rendering job, and as a list of published fits.

use tsuya::brdf::{Brdf, ClassicalModel, read_published};
use tsuya::relight::Job;
use tsuya_fuzz::folder;

/// Two directions of the upper half.
const DIRECTIONS: [[f64; 3]; 2] = [[0.6, 0.0, 0.8], [-0.28, 0.0, 0.96]];

pub fn fuzz(bytes: &[u8]) {
    if let Ok(job) = serde_json::from_slice::<Job>(bytes) {
        if let Ok(camera) = job.camera() {
            assert!(camera.rotation.iter().flatten().chain(&camera.focal).all(|x| x.is_finite()));
        }
        if let Some(material) = &job.material
            && let Ok(Some(part)) = material.specular_part(None)
        {
            let value = part.evaluate(DIRECTIONS[0], DIRECTIONS[1]);
            assert!(value.iter().all(|x| !x.is_nan()));
        }
        let again: Job = serde_json::from_slice(&serde_json::to_vec(&job).expect("a job")).expect("our own job");
        assert!(again == job);
    }
    if let Ok(model) = serde_json::from_slice::<ClassicalModel>(bytes) {
        check(&model);
    }
    if let Ok(fits) = read_published(folder::file("fits.txt", bytes), &folder::access()) {
        fits.iter().for_each(|fit| check(&fit.model));
    }
}

fn check(model: &ClassicalModel) {
    if model.check().is_ok() {
        let value = model.evaluate(DIRECTIONS[0], DIRECTIONS[1]);
        assert!(value.iter().all(|x| !x.is_nan()), "{model:?}: {value:?}");
    }
}
