//! Photographs: sections `PLAN` and `PAPR`.

use super::{Object, budget, number, positive};
use crate::scene;
use arbitrary::{Result, Unstructured};
use tsuya::Photograph;
use tsuya::internals::MaskedPhotographs;
use tsuya::internals::predictive::{
    CodedEntry, CodedTile, ComponentCoding, MAX_REFERENCES, MaskCoding, OrderEntry, PREFIX_BYTES, PlaneCoding,
    PlaneEncoder, PlaneHeader, PlaneQuality,
};
use tsuya::internals::residual::coefficients::Modelling;
use tsuya::{Camera, DecodeSpeed, View, internals};

/// Photographs of the object, changed here and there.
fn photographs(u: &mut Unstructured, object: &Object) -> Result<Vec<Photograph>> {
    let mut all = scene::photographs(&object.mesh.0, object.all_views(), object.components(), u.arbitrary()?);
    for photograph in &mut all {
        let pixels = photograph.mask.data.len();
        for _ in 0..u.int_in_range(0..=4)? {
            let (at, value) = (u.int_in_range(0..=pixels - 1)?, number(u)?);
            let value = if value.is_finite() { value.clamp(-1e4, 1e4) } else { 0.5 };
            photograph.images.iter_mut().for_each(|image| image.data[at] = [value, 0.0, value * 0.5]);
        }
        if u.ratio(1, 8)? {
            let inside = u.arbitrary()?;
            photograph.mask.data.fill(inside);
        }
        for (at, inside) in photograph.mask.data.iter().enumerate() {
            if !inside {
                photograph.images.iter_mut().for_each(|image| image.data[at] = [0.0; 3]);
            }
        }
    }
    Ok(all)
}

/// Section `PLAN`: what the encoder says is what decodes.
pub fn planes(u: &mut Unstructured, object: &Object) -> Result<Vec<u8>> {
    let (mesh, views) = (&object.mesh.0, object.all_views());
    let photographs = photographs(u, object)?;
    let quality = PlaneQuality {
        step: positive(u)?.clamp(0.002, 0.5),
        lambda: positive(u)?.min(0.5),
        decode_speed: *u.choose(&[DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest])?,
        tile_side_log2: u.int_in_range(4..=12)?,
        ..PlaneQuality::default()
    };
    let covered = internals::surface::coverage_runs(mesh, views);
    let (components, white) = (object.components(), object.views.0.white);
    let source = MaskedPhotographs { mesh, views, components, white, covered: &covered, photographs: &photographs };
    let encoder = PlaneEncoder::new(&source, u.arbitrary()?).expect("photographs in memory");
    let encoded = encoder.encode(&quality).expect("every picture set can be coded");
    let decoded = decode_planes(&encoded.bytes, object).expect("our own planes");
    for (decoded, expected) in decoded.iter().zip(&encoded.photographs) {
        crate::compare::same(decoded, &Some(expected.clone()));
    }
    Ok(encoded.bytes)
}

fn decode_planes(bytes: &[u8], object: &Object) -> tsuya::Result<Vec<Option<Photograph>>> {
    let budget = budget();
    let header = PlaneHeader::parse(bytes, object.all_views(), object.components().len(), &budget)?;
    let body = &bytes[PREFIX_BYTES + PlaneHeader::head_bytes(bytes)? as usize..];
    let read = |range: std::ops::Range<u64>| Ok(body.get(range.start as usize..range.end as usize).map(<[u8]>::to_vec));
    internals::predictive::decode(
        &header,
        &object.mesh.0,
        (object.all_views(), object.views.0.white),
        |_| true,
        read,
        &budget,
    )
}

/// Reads a section `PLAN` that may be damaged, its checksums put right.
pub fn read_planes(bytes: &[u8], object: &Object) {
    let mut bytes = bytes.to_vec();
    crate::repair::repair_planes(&mut bytes, object.all_views());
    let _ = decode_planes(&bytes, object);
}

/// Section `PAPR`: what is written decodes to photographs of numbers.
pub fn paper(u: &mut Unstructured, object: &Object) -> Result<Option<Vec<u8>>> {
    let (mesh, views, components) = (&object.mesh.0, object.all_views(), object.components());
    let photographs = photographs(u, object)?;
    let density = *u.choose(&[0.1, 1.0, 3.0])?;
    let samples = internals::wavelet_texture::WaveletSamples::gather(mesh, views, &photographs, density)
        .expect("photographs in memory");
    let model = if u.arbitrary()? { Some(internals::wavelet_texture::fit_model(&samples, components)) } else { None };
    let options = internals::wavelet_texture::WaveletOptions {
        keep_percent: u.int_in_range(0..=100)? as f64,
        view_levels: u.int_in_range(0..=7)?,
        relative_step: positive(u)?.clamp(0.05, 2.0),
        ..Default::default()
    };
    let Ok(encoded) = internals::wavelet_texture::encode(&samples, components, model.as_ref(), &options) else {
        return Ok(None);
    };
    let decoded = internals::wavelet_texture::decode(&encoded.bytes, mesh, components, views.len(), &budget())
        .expect("our own section of paper");
    let hit = |x: usize, y: usize| Some(((x + y) as u32 % mesh.triangles.len() as u32, [0.25, 0.25, 0.5]));
    for (index, view) in views.iter().enumerate() {
        let photograph = decoded.photograph(index, view, hit);
        assert!(photograph.images.iter().flat_map(|image| image.data.as_flattened()).all(|x| !x.is_nan()));
    }
    Ok(Some(encoded.bytes))
}

/// A head whose references point backwards, as the writer needs it; it comes back.
pub fn header(u: &mut Unstructured) -> Result<PlaneHeader> {
    let count: usize = u.int_in_range(1..=2)?;
    let mut components = Vec::new();
    for _ in 0..count {
        let step = positive(u)?.clamp(1e-6, 1e3);
        let rotation = u.arbitrary()?;
        let [signed, shaded] = u.arbitrary()?;
        components.push(ComponentCoding { step, shrink: u.arbitrary()?, rotation, signed, shaded });
    }
    let masks = if u.arbitrary()? { MaskCoding::Coded } else { MaskCoding::Coverage };
    let modelling = if u.arbitrary()? { Modelling::Direct } else { Modelling::Mixed };
    let prediction_level = u.int_in_range(0..=3)?;
    let is_modelled = u.arbitrary()?;
    // Without tiles their side is not stored.
    let tile_side_log2 = if prediction_level > 0 { u.int_in_range(4..=12)? } else { 8 };
    let coding = PlaneCoding { components, masks, prediction_level, modelling, is_modelled, tile_side_log2 };
    let views: usize = u.int_in_range(1..=5)?;
    let first = u.int_in_range(0..=views - 1)?;
    let camera = Camera { width: u.int_in_range(1..=300)?, height: u.int_in_range(1..=300)?, ..Camera::default() };
    let all: Vec<View> = (0..views).map(|k| View { name: k.to_string(), camera, light: None }).collect();
    let grid = coding.tile_grid(&camera);
    let mut offset = 0;
    let mut steps: Vec<CodedEntry> = Vec::new();
    for index in 0..views {
        let earlier = |u: &mut Unstructured| u.int_in_range(0..=index - 1).map(|step| (step + first) % views);
        let mut references = Vec::new();
        let mut parent = None;
        if index > 0 {
            for _ in 0..u.int_in_range(0..=MAX_REFERENCES)? {
                references.push((earlier(u)?, u.arbitrary()?));
            }
            parent = if u.arbitrary()? { Some(earlier(u)?) } else { None };
        }
        let most = if u.ratio(1, 16)? { u32::MAX } else { 200 };
        let lengths = (0..=count).map(|_| u.int_in_range(0..=most)).collect::<Result<Vec<u32>>>()?;
        let step = OrderEntry { view: (index + first) % views, references, parent };
        let scale = u.int_in_range(1..=255)?;
        let mut tiles = Vec::new();
        for level in grid.tile_levels() {
            let lengths = (0..count).map(|_| u.int_in_range(0..=200)).collect::<Result<Vec<u32>>>()?;
            let is_empty = lengths.iter().all(|&length| length == 0);
            let checksum = if is_empty { 0 } else { u.arbitrary()? };
            tiles.push(CodedTile { level: level as u8, lengths, checksum });
        }
        let coded = CodedEntry { entry: step, scale, lengths, checksum: u.arbitrary()?, tiles, offset };
        offset += coded.stream_bytes();
        steps.push(coded);
    }
    let header = PlaneHeader { coding, entries: steps };
    let bytes = header.to_bytes();
    let again = PlaneHeader::parse(&bytes, &all, count, &budget()).expect("our own head");
    assert!(again == header, "the head comes back another");
    Ok(header)
}
