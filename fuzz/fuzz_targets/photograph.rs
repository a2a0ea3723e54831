//! Any bytes as a photograph, and as a picture of an environment.
#![no_main]
use libfuzzer_sys::fuzz_target;
use tsuya::image::read_radiance;
use tsuya::lighting::{EnvironmentReadOptions, read_environment};
use tsuya_fuzz::folder;

fuzz_target!(|bytes: &[u8]| {
    let path = folder::file("photograph", bytes);
    if let Ok(picture) = read_radiance(&path, &folder::access()) {
        assert_eq!(picture.data.len(), picture.width * picture.height);
        let missing = |pixel: &[f32; 3]| pixel.iter().all(|x| x.is_nan()) || pixel.iter().all(|x| x.is_finite());
        assert!(picture.data.iter().all(missing));
        if picture.data.len() <= 4096
            && let Ok((environment, _)) = read_environment(
                &[&path],
                &EnvironmentReadOptions { width: Some(16), limits: folder::limits(), ..Default::default() },
            )
        {
            assert!(environment.image().data.as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0));
        }
    }
});
