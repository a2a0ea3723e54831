use super::super::test_capture::sample;
use super::*;
use crate::capture::{CaptureReadOptions, read};
use std::path::PathBuf;

#[test]
fn mistakes_between_mesh_cameras_and_masks_are_named() {
    let plain = read(sample(), &CaptureReadOptions::default()).unwrap();
    let found = agreement(&plain);
    assert!(found.silhouette_iou.unwrap() > 0.9 && found.front_facing.unwrap() > 0.99, "{found:?}");
    assert!(found.sentences().is_empty() && !found.is_refused());
    // Each mistake, made on the sample, and what is said of it.
    let change_mesh = |change: &dyn Fn([f32; 3]) -> [f32; 3]| {
        let mut wrong = plain.clone();
        wrong.mesh.positions.iter_mut().for_each(|p| *p = change(*p));
        agreement(&wrong)
    };
    let change_cameras = |change: &dyn Fn(&mut crate::views::Camera)| {
        let mut wrong = plain.clone();
        wrong.frames.iter_mut().for_each(|frame| change(&mut frame.view.camera));
        agreement(&wrong)
    };
    let transposed = |r: [[f64; 3]; 3]| std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
    let mut masks = plain.clone();
    masks
        .frames
        .iter_mut()
        .flat_map(|frame| frame.mask.as_mut())
        .flat_map(|m| &mut m.data)
        .for_each(|shown| *shown = !*shown);
    let cases = [
        (agreement(&masks), "the masks are inverted"),
        (change_mesh(&|p| p.map(|x| 0.001 * x)), "set mesh_scale to 1000"),
        (change_mesh(&|p| p.map(|x| x / 0.0254)), "set mesh_scale to 0.0254"),
        (
            change_mesh(&|[x, y, z]| [x, -z, y]),
            "set its pose to [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]",
        ),
        (
            change_cameras(&|camera| {
                camera.rotation = [camera.rotation[0], camera.rotation[1].map(|x| -x), camera.rotation[2].map(|x| -x)];
                camera.translation = [camera.translation[0], -camera.translation[1], -camera.translation[2]];
            }),
            "in OpenCV's axes (y down, z forward), not in OpenGL's",
        ),
        (
            change_cameras(&|camera| {
                let centre = camera.centre();
                (camera.rotation, camera.translation) = (transposed(camera.rotation), centre);
            }),
            "camera to world, not world to camera",
        ),
    ];
    for (found, said) in cases {
        assert!(found.is_refused() || found.silhouette_iou.unwrap() < 0.7, "{said}: {found:?}");
        let sentences = found.sentences().join("; ");
        assert!(sentences.contains(said), "{sentences}\nexpected: {said}");
        assert!(found.cause.unwrap().silhouette_iou.unwrap() > 0.9, "{said}");
    }
    let mut inwards = plain.clone();
    inwards.mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    let path = PathBuf::from("sample");
    let settle =
        |capture: &mut Capture| super::settle(&path, agreement(capture), &mut capture.mesh, &mut capture.warnings);
    settle(&mut inwards).unwrap();
    assert!(agreement(&inwards).front_facing.unwrap() > 0.99);
    assert!(inwards.warnings.iter().any(|warning| warning.contains("wound inwards; its triangles were turned")));
    let error = settle(&mut masks).unwrap_err().to_string();
    assert!(
        error.contains("sample: the mesh's silhouette and the masks agree to 0.0") && error.contains("unchecked"),
        "{error}"
    );
}
