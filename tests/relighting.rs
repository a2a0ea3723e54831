//! Files that carry visibility and light: figures on real data, and files without photographs.

use std::path::PathBuf;
use tsuya::decoder::{DecodeOptions, decode};
use tsuya::lighting::{
    EnvironmentLobes, EnvironmentMap, EnvironmentProjection, EnvironmentReadOptions, FisheyeAxis, FisheyeModel,
    LobeFitOptions,
};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{Limits, mesh};
use tsuya::{
    container::{self, ContainerWriter, SectionCodec, Tag},
    lighting,
};

/// A file of the test data, or none where they are not there.
fn data(name: &str) -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let path = std::env::var_os("TSUYA_DATA").map_or_else(beside, PathBuf::from).join(name);
    if !path.is_file() {
        println!("{} is not there: skipped", path.display());
        return None;
    }
    Some(path)
}

fn file(sections: &[(Tag, &[u8])]) -> Vec<u8> {
    let mut writer = ContainerWriter::new(Vec::new()).unwrap();
    for (tag, bytes) in sections {
        writer.write_section(*tag, SectionCodec::Own, bytes).unwrap();
    }
    writer.finish().unwrap()
}

#[test]
fn visibility_of_a_small_bunny() {
    let Some(path) = data("meshes/bunny_lowres.ply") else { return };
    let (given, _) = mesh::clean(mesh::read(&path, &Default::default()).unwrap());
    let coded = mesh::encode(&given, &mesh::MeshOptions { position_bits: 14 }).unwrap();
    let baked = bake(&coded.mesh, &BakeOptions::default()).unwrap();
    assert_eq!(baked.bytes, bake(&coded.mesh, &BakeOptions::default()).unwrap().bytes, "the same bytes each time");
    let error = baked.visibility.error();
    assert!(error.rms_radians < 0.04 && error.wrong_signs < 0.02, "{error:?}");
    assert!(baked.bytes.len() <= 48 * coded.mesh.positions.len(), "{} bytes", baked.bytes.len());
    // A file of the mesh and its visibility alone.
    let bytes = file(&[(Tag::MESH, &coded.bytes), (Tag::VISIBILITY, &baked.bytes)]);
    let asset = decode(&bytes, &DecodeOptions::default()).unwrap();
    assert_eq!((asset.visibility.as_ref(), asset.views.len()), (Some(&baked.visibility), 0));
    // With a ground below nothing comes from there.
    let ground = BakeOptions { ground_up: Some([0.0, 1.0, 0.0]), ..Default::default() };
    let above = bake(&coded.mesh, &ground).unwrap().visibility;
    assert!((0..above.places().count()).all(|v| above.signed_distance(v, [0.0, -1.0, 0.0]) < -0.3));
    // Steps that no section may hold are refused before the work.
    for weight_step in [8.6e21, 1e5, 1e-7, 0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(bake(&coded.mesh, &BakeOptions { weight_step, ..Default::default() }).is_err(), "{weight_step}");
    }
    // Visibility without its mesh, and without any section that stands for itself.
    assert!(decode(&file(&[(Tag::VISIBILITY, &baked.bytes)]), &DecodeOptions::default()).is_err());
    assert!(decode(&file(&[(Tag::MESH, &coded.bytes)]), &DecodeOptions::default()).is_err());
}

#[test]
fn light_of_a_museum() {
    let Some(path) = data("envmaps/museum.exr") else { return };
    let (environment, _) = lighting::read_environment(&[&path], &EnvironmentReadOptions::default()).unwrap();
    let environment = environment.resized(256, 128);
    let diffuse = lighting::fit(&environment, &LobeFitOptions::default(), None);
    assert!(lighting::irradiance_error(&environment, &diffuse) < 0.02);
    let levels = lighting::prefiltered_maps(&environment, 256);
    let (bytes, light) =
        lighting::encode(&EnvironmentLobes { diffuse, prefiltered: levels }, &Default::default()).unwrap();
    let errors = lighting::prefiltered_errors(&environment, &light.prefiltered[1..], 16);
    assert!(errors.iter().all(|&error| error < 0.05), "{errors:?}");
    let alone = file(&[(Tag::LIGHT, &bytes)]);
    assert_eq!(decode(&alone, &DecodeOptions::default()).unwrap().light, Some(light.clone()));
    // Put in place of another light.
    let dark = lighting::encode(&EnvironmentLobes::default(), &Default::default()).unwrap().0;
    let changed =
        container::with_sections(&alone, &[(Tag::LIGHT, SectionCodec::Own, dark)], Limits::default()).unwrap();
    assert_eq!(decode(&changed, &DecodeOptions::default()).unwrap().light, Some(EnvironmentLobes::default()));
    for length in (0..alone.len()).step_by(997) {
        assert!(decode(&alone[..length], &DecodeOptions::default()).is_err());
    }
}

#[test]
fn negative_pixels_of_a_compressed_environment_are_counted() {
    let Some(path) = data("envmaps/studio.exr") else { return };
    let (environment, cleaned) = lighting::read_environment(&[&path], &EnvironmentReadOptions::default()).unwrap();
    assert!(environment.image().data.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
    println!("{cleaned:?}");
}

/// The fisheye picture is the upper half of the panorama: the same scene, turned about the vertical.
#[test]
fn a_fisheye_picture_agrees_with_its_panorama() {
    let (Some(fisheye), Some(panorama)) = (data("fisheye/equidistant-180.jpg"), data("fisheye/panorama.jpg")) else {
        return;
    };
    let projection = EnvironmentProjection::Fisheye {
        model: FisheyeModel::Equidistant,
        field_degrees: 180.0,
        looks: FisheyeAxis::Up,
    };
    let options = EnvironmentReadOptions { projection: Some(projection), width: Some(256), ..Default::default() };
    let half = lighting::read_environment(&[&fisheye], &options).unwrap().0;
    let options = EnvironmentReadOptions {
        projection: Some(EnvironmentProjection::LatLong),
        width: Some(256),
        ..Default::default()
    };
    let whole = lighting::read_environment(&[&panorama], &options).unwrap().0;
    let difference = |turned: &EnvironmentMap| {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 0..128 {
            for x in 0..256 {
                let direction = half.direction(x as f64 + 0.5, y as f64 + 0.5);
                if direction[1] > 0.2 {
                    let (a, b) = (half.radiance(direction), turned.radiance(direction));
                    sum += (0..3).map(|c| (a[c] - b[c]).abs() as f64).sum::<f64>() / 3.0;
                    count += 1.0;
                }
            }
        }
        sum / count
    };
    let differences: Vec<f64> = (0..72).map(|k| difference(&whole.rotated_y(5.0 * k as f64))).collect();
    let best = differences.iter().copied().fold(f64::MAX, f64::min);
    let mean = differences.iter().sum::<f64>() / 72.0;
    println!("{best} {mean}");
    assert!(best < 0.5 * mean, "{differences:?}");
}
