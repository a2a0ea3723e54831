//! Round trips of views that are predicted from a surface and its lobes, too.

use super::decode::PlaneDecoder;
use super::encode::PlaneQuality;
use super::header::{PREFIX_BYTES, PlaneHeader};
use super::model::PredictionModel;
use super::tests::{COMPONENTS, WHITE, encode_with_model, octahedron, turned_view};
use super::workspace::PlaneSignal;
use super::{ComponentCoding, MaskCoding, PlaneCoding, PredictionScene, low_camera};
use crate::image::{Grid, Mask, Region, RgbImage};
use crate::limits::{Budget, Limits};
use crate::mesh::Mesh;
use crate::options::DecodeSpeed;
use crate::reflectance::lobes::LOBES;
use crate::reflectance::maps::ReflectanceMaps;
use crate::residual::coefficients::Modelling;
use crate::surface::atlas::layout;
use crate::surface::charts::Charts;
use crate::surface::displacement::DisplacedMesh;
use crate::surface::raster::rasterise;
use crate::surface::view_geometry::{ViewGeometry, ViewedMesh};
use crate::transform::shape_adaptive::PixelRun;
use crate::transform::window::Window;
use crate::views::{Photograph, View};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// A glossy octahedron's dents between its vertices.
fn parts(mesh: &Mesh) -> (DisplacedMesh, Charts, ReflectanceMaps) {
    let dent = |_, _, place: [f64; 3]| 0.05 * (place[0] * 11.0).sin() * (place[1] * 9.0).cos();
    let surface = DisplacedMesh::new(mesh, 4, dent).unwrap();
    let charts = layout(mesh, 20.0).unwrap();
    let (width, height) = (charts.width as usize, charts.height as usize);
    let map = |scale: f32, step: usize| {
        let colour = |k: usize| [1.0, 0.8, 0.6].map(|c| c * scale * (0.6 + 0.4 * ((k / step) as f32).sin()));
        Grid { width, height, data: (0..width * height).map(colour).collect() }
    };
    let mut maps = ReflectanceMaps { relightable: true, diffuse: map(0.3, 7), ..ReflectanceMaps::default() };
    maps.lobes = (0..LOBES).map(|k| map(0.02 * k as f32, 31 + k)).collect();
    (surface, charts, maps)
}

/// The octahedron, and views around it of which the last but one has no light.
fn scene() -> (Mesh, Vec<View>, PredictionModel) {
    let mesh = octahedron();
    let (surface, charts, maps) = parts(&mesh);
    let view = |i: usize| {
        let view = turned_view(i, i as f64 * 0.35);
        View { light: view.light.filter(|_| i != 5), ..view }
    };
    let views = (0..7).map(view).collect();
    let parts = (Some(&surface), Some(&charts), Some(&maps));
    let model = PredictionModel::new(&mesh, parts, &COMPONENTS, WHITE, &Budget::new(Limits::default())).unwrap();
    (mesh, views, model)
}

/// The model's signals in a view, not rotated, and the mask of what the mesh covers.
fn signals(mesh: &Mesh, view: &View, model: &PredictionModel, level: usize) -> (Mask, Vec<PlaneSignal>) {
    let plain = ComponentCoding {
        step: 1.0,
        shrink: [0, 0],
        rotation: [[16384, 0, 0], [0, 16384, 0], [0, 0, 16384]],
        signed: false,
        shaded: true,
    };
    let coding = PlaneCoding {
        components: vec![plain; 2],
        masks: MaskCoding::Coverage,
        prediction_level: 0,
        modelling: Modelling::Mixed,
        is_modelled: true,
        tile_side_log2: 8,
    };
    let mask = rasterise(mesh, &view.camera).coverage();
    let (width, height) = (mask.width, mask.height);
    let rows: Vec<PixelRun> = (0..width * height)
        .filter(|&at| mask.data[at])
        .map(|at| PixelRun { line: (at / width) as u32, start: (at % width) as u32, length: 1 })
        .collect();
    let window = Window { left: 0, top: 0, width, height };
    let geometry = ViewGeometry::new(&ViewedMesh::new(Cow::Borrowed(mesh)), view.clone());
    let signals = model.signals(&geometry, &coding, (&window, &rows, level)).unwrap();
    (mask, signals)
}

/// Photographs that show the model, a little brighter to the right.
fn photographs(mesh: &Mesh, views: &[View], model: &PredictionModel) -> Vec<Photograph> {
    let photograph = |view: &View| {
        let lit = View { light: view.light.or(views[0].light), ..view.clone() };
        let (mask, signals) = signals(mesh, &lit, model, 0);
        let (width, height) = (mask.width, mask.height);
        let image = |signal: PlaneSignal| {
            let brightness = |at: usize| 1.0 + 0.1 * (at % width) as f32 / width as f32;
            let colour =
                |(at, s): (usize, &[f32; 4])| std::array::from_fn(|k| s[k] * s[k] * WHITE[k] as f32 * brightness(at));
            RgbImage { width, height, data: signal.iter().enumerate().map(colour).collect() }
        };
        Photograph { mask, images: signals.into_iter().map(image).collect() }
    };
    views.iter().map(photograph).collect()
}

#[test]
fn views_that_the_model_explains_take_few_bytes_and_come_back_in_all_ways() {
    let (mesh, views, model) = scene();
    let photographs = photographs(&mesh, &views, &model);
    for decode_speed in [DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest] {
        let quality = PlaneQuality { step: 0.02, decode_speed, tile_side_log2: 4, ..PlaneQuality::default() };
        let alone = encode_with_model((&mesh, &views, &photographs), false, &quality, None);
        let coded = encode_with_model((&mesh, &views, &photographs), false, &quality, Some(self::scene().2));
        let share = coded.bytes.len() as f64 / alone.bytes.len() as f64;
        let most = if decode_speed == DecodeSpeed::Normal { 0.6 } else { 1.0 };
        assert!(share < most, "{decode_speed:?}: {share:.3} of the bytes without the model");
        let budget = Budget::new(Limits::default());
        let header = PlaneHeader::parse(&coded.bytes, &views, 2, &budget).unwrap();
        let body = &coded.bytes[PREFIX_BYTES + PlaneHeader::head_bytes(&coded.bytes).unwrap() as usize..];
        let read = |range: Range<u64>| Ok(Some(body[range.start as usize..range.end as usize].to_vec()));
        let decoded = |model: Option<PredictionModel>, wanted: &[usize], region: Option<Region>| {
            let decoder =
                PlaneDecoder::new(&header, &mesh, &views, WHITE).with_model(model.map(Arc::new)).within(region);
            let mut photographs = Vec::new();
            let take = |given: Vec<(usize, Photograph)>| {
                photographs.extend(given);
                Ok(())
            };
            decoder.for_each_view(|view| wanted.contains(&view), read, &budget, take).map(|()| photographs)
        };
        let all: Vec<usize> = (0..views.len()).collect();
        for (view, photograph) in decoded(Some(self::scene().2), &all, None).unwrap() {
            assert!(photograph == coded.photographs[view], "{decode_speed:?}: view {view}");
        }
        for view in [6, 5, 0] {
            let one = decoded(Some(self::scene().2), &[view], None).unwrap();
            assert!(one.len() == 1 && one[0].1 == coded.photographs[view], "{decode_speed:?}: view {view} alone");
        }
        let region = Region { left: 20, top: 15, width: 30, height: 22 };
        let part = decoded(Some(self::scene().2), &[4], Some(region)).unwrap();
        assert!(part[0].1 == coded.photographs[4].cropped(&region), "{decode_speed:?}: a region");
        let error = decoded(None, &all, None).unwrap_err();
        assert!(error.to_string().contains("a reflectance that is not there"), "{error}");
    }
}

/// The model of a low band is that of its camera, larger by the gain of the low pass.
#[test]
fn the_model_of_a_low_band_is_that_of_its_pixels() {
    let (mesh, views, model) = scene();
    let (whole, at_size) = signals(&mesh, &views[0], &model, 0);
    let low = View { camera: low_camera(&views[0].camera, 1), ..views[0].clone() };
    let (half, at_half) = signals(&mesh, &low, &model, 1);
    let (mut alike, mut compared) = (0, 0);
    for at in (0..half.data.len()).filter(|&at| half.data[at]) {
        // Pixel k of the low band stands where pixel 2 k does.
        let other = at / half.width * 2 * whole.width + at % half.width * 2;
        let [a, b] = [at_half[0][at][1], 2.0 * at_size[0][other][1]];
        compared += (whole.data[other] && b > 0.1) as usize;
        alike += (whole.data[other] && b > 0.1 && (a / b - 1.0).abs() < 1e-3) as usize;
    }
    assert!(compared > 100 && alike * 100 > compared * 95, "{alike} of {compared}");
}

#[test]
fn a_file_without_what_its_views_are_predicted_from_is_refused_by_name() {
    let mesh = octahedron();
    let (surface, charts, maps) = parts(&mesh);
    let new = |has_surface: bool, lobes: usize| {
        let mut given = maps.clone();
        given.lobes.truncate(lobes);
        let parts = (has_surface.then_some(&surface), Some(&charts), Some(&given));
        PredictionModel::new(&mesh, parts, &COMPONENTS, WHITE, &Budget::new(Limits::default())).map(|_| ())
    };
    assert!(new(true, LOBES).is_ok());
    assert!(new(false, LOBES).unwrap_err().to_string().contains("DISP"));
    assert!(new(true, 0).unwrap_err().to_string().contains("lobes"));
    assert_eq!(PredictionScene::new(Cow::Owned(Mesh::default()), Cow::Owned(Vec::new())).drawing_bytes(), 0);
}
