//! Operations on a file.

use crate::facts;
use crate::output::{Output, to_halves};
use serde_json::{Value, json};
use tsuya::Component;
use tsuya::RenderMesh;
use tsuya::brdf::{Brdf, HalfDifference};
use tsuya::container::{Poll, Tag};
use tsuya::decoder::{IncrementalDecoder, ViewPhotograph, ViewStatus};
use tsuya::image::Grid;
use tsuya::{Error, Result};

/// Result of an operation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The outputs hold the result.
    Ready = 0,
    /// The first output lists ranges that must arrive first.
    NeedRanges = 1,
    /// The first output describes the error.
    Error = 2,
    /// A part is done; call again.
    InProgress = 3,
}

pub type Answer = (Status, Vec<Output>);

/// Triangles of the finest surface that is handed out: beyond, a page has the mesh only.
const MOST_TRIANGLES: usize = 2_000_000;
/// Half angles, difference angles and azimuths of a material's table.
const MATERIAL: [usize; 3] = [90, 30, 36];

/// Runs an operation by its number.
pub fn run_operation(file: &mut IncrementalDecoder, operation: u32, argument: u32, flags: u32) -> Result<Answer> {
    match operation {
        0 => Ok(found(file.header()?, |opened| {
            let mut description = facts::opened(&opened);
            merge(&mut description["facts"], facts::sections(file.sections()));
            (description, Vec::new())
        })),
        1 => mesh(file),
        2 => reflectance(file),
        3 => Ok(found(file.visibility()?, |visibility| match visibility {
            None => (Value::Null, Vec::new()),
            Some(v) => (
                json!({
                    "size": v.size(), "terms": v.terms(), "groups": v.groups(), "ground": v.has_ground(),
                    "rmsErrorRad": v.error().rms_radians, "wrongSigns": v.error().wrong_signs,
                    "arrays": [["bases", "f32"], ["weights", "i8"]],
                }),
                vec![
                    Output::Floats(v.bases().to_vec()),
                    Output::Weights(v.all_weights()[..v.places().vertices() * v.terms()].to_vec()),
                ],
            ),
        })),
        4 => Ok(found(file.light()?, |light| match light {
            None => (Value::Null, Vec::new()),
            Some(light) => {
                let lobe = |lobe: &tsuya::lighting::SphericalGaussian| {
                    let numbers = lobe.axis.into_iter().chain([lobe.sharpness]).chain(lobe.amplitude);
                    numbers.map(|x| x as f32).collect::<Vec<f32>>()
                };
                let mut outputs = vec![Output::Floats(light.diffuse.iter().flat_map(lobe).collect())];
                let levels = light.prefiltered.iter().map(|level| {
                    outputs.push(Output::Colours(level.cells().to_vec()));
                    json!({"sharpness": level.sharpness(), "size": level.size()})
                });
                let levels: Vec<Value> = levels.collect();
                let arrays = (0..levels.len()).map(|k| json!([["levels", k, "cells"], "f32"]));
                let arrays: Vec<Value> = std::iter::once(json!(["lobes", "f32"])).chain(arrays).collect();
                (json!({"levels": levels, "arrays": arrays}), outputs)
            }
        })),
        5 => Ok(found(file.materials()?, |materials| {
            let mut outputs = Vec::new();
            let list = materials.iter().map(|named| {
                outputs.push(Output::Floats(table(&named.material)));
                json!({"name": named.name, "form": named.material.form(), "size": MATERIAL})
            });
            let list: Vec<Value> = list.collect();
            let arrays: Vec<Value> = (0..list.len()).map(|k| json!([["materials", k, "values"], "f32"])).collect();
            (json!({"materials": list, "arrays": arrays}), outputs)
        })),
        6 => view(file, argument as usize, flags),
        7 => Ok(found(file.verify()?, |()| (Value::Null, Vec::new()))),
        8 => Ok(match file.ranges_for(argument as usize)? {
            ranges if ranges.is_empty() => (Status::Ready, vec![Output::Text("null".into())]),
            ranges => need_ranges(ranges),
        }),
        9 => Ok((Status::Ready, vec![Output::Text(facts::sections(file.sections()).to_string())])),
        10 => surface(file),
        other => Err(Error::parameter(format!("operation {other} does not exist"))),
    }
}

/// Returns the answer of a result; `None` stands for a file that is not open.
pub fn answer<T>(result: Option<Result<T>>, right: impl FnOnce(T) -> Answer) -> Answer {
    let error = match result {
        Some(Ok(value)) => return right(value),
        Some(Err(error)) => error,
        None => Error::parameter("the file is closed"),
    };
    let kind = match &error {
        Error::Io { .. } => "io",
        Error::Format { .. } | Error::Input { .. } => "format",
        Error::Unsupported(_) => "unsupported",
        Error::Limits { .. } => "limits",
        Error::Parameter(_) => "parameter",
        _ => "internal",
    };
    let (section, offset) = match &error {
        Error::Format { section, offset, .. } => (Some(section.to_string()), Some(*offset)),
        _ => (None, None),
    };
    let text = json!({"kind": kind, "message": error.to_string(), "section": section, "offset": offset});
    (Status::Error, vec![Output::Text(text.to_string())])
}

fn need_ranges(ranges: Vec<std::ops::Range<u64>>) -> Answer {
    let ranges: Vec<[u64; 2]> = ranges.into_iter().map(|range| [range.start, range.end]).collect();
    (Status::NeedRanges, vec![Output::Text(json!(ranges).to_string())])
}

fn found<T>(arrival: Poll<T>, describe: impl FnOnce(T) -> (Value, Vec<Output>)) -> Answer {
    match arrival {
        Poll::NeedRanges(ranges) => need_ranges(ranges),
        Poll::Ready(value) => {
            let (description, arrays) = describe(value);
            let text = Output::Text(description.to_string());
            (Status::Ready, std::iter::once(text).chain(arrays).collect())
        }
    }
}

fn merge(into: &mut Value, more: Value) {
    if let (Value::Object(into), Value::Object(more)) = (into, more) {
        into.extend(more);
    }
}

fn mesh(file: &mut IncrementalDecoder) -> Result<Answer> {
    let mesh = match file.mesh()? {
        Poll::Ready(Some(mesh)) => mesh,
        Poll::Ready(None) => return Ok((Status::Ready, vec![Output::Text("null".into())])),
        Poll::NeedRanges(ranges) => return Ok(need_ranges(ranges)),
    };
    Ok(found(file.charts()?, |charts| {
        let vertices = match charts {
            Some(charts) if charts.width > 0 && charts.height > 0 => RenderMesh::with_atlas(&mesh, &charts),
            _ => RenderMesh::without_atlas(&mesh),
        };
        let description = json!({
            "sourceVertexCount": mesh.positions.len(),
            "arrays": [["positions", "f32"], ["normals", "f32"], ["tangents", "f32"], ["uvs", "f32"], ["indices", "u32"],
                ["sourceVertices", "u32"]],
        });
        let arrays = vec![
            Output::Colours(vertices.positions),
            Output::Colours(vertices.normals),
            Output::Pixels(vertices.tangents),
            Output::Coordinates(vertices.coordinates),
            Output::Triangles(vertices.triangles),
            Output::Integers(vertices.sources),
        ];
        (description, arrays)
    }))
}

/// The finer surface; null in files without, without an atlas, and where it is too large.
fn surface(file: &mut IncrementalDecoder) -> Result<Answer> {
    let none = (Status::Ready, vec![Output::Text("null".into())]);
    let (mesh, charts) = match (file.mesh()?, file.charts()?) {
        (Poll::NeedRanges(ranges), _) | (_, Poll::NeedRanges(ranges)) => return Ok(need_ranges(ranges)),
        (Poll::Ready(Some(mesh)), Poll::Ready(Some(charts))) if charts.width > 0 && charts.height > 0 => (mesh, charts),
        _ => return Ok(none),
    };
    // Of files that are read from front to back it stands before what is known to follow it, or is not there.
    let (sections, is_complete) = file.sections();
    let has = |tag: Tag| sections.iter().any(|section| section.tag == tag);
    if !is_complete && has(Tag::REFLECTANCE) && !has(Tag::DISPLACEMENT) {
        return Ok(none);
    }
    let surface = match file.surface() {
        Ok(Poll::NeedRanges(ranges)) => return Ok(need_ranges(ranges)),
        Ok(Poll::Ready(Some(surface))) if surface.mesh().triangles.len() <= MOST_TRIANGLES => surface,
        Ok(Poll::Ready(_)) | Err(Error::Limits { .. }) => return Ok(none),
        Err(error) => return Err(error),
    };
    let Some(vertices) = RenderMesh::of_surface(&mesh, &charts, &surface) else { return Ok(none) };
    let description = json!({
        "between": {},
        "arrays": [["positions", "f32"], ["normals", "f32"], ["uvs", "f32"], ["indices", "u32"], [["between", "vertices"], "u32"],
            [["between", "weights"], "f32"]],
    });
    let (ends, weights) = vertices.between.into_iter().unzip();
    let outputs = vec![
        Output::Text(description.to_string()),
        Output::Colours(vertices.positions),
        Output::Colours(vertices.normals),
        Output::Coordinates(vertices.coordinates),
        Output::Triangles(vertices.triangles),
        Output::Triangles(ends),
        Output::Colours(weights),
    ];
    Ok((Status::Ready, outputs))
}

fn reflectance(file: &mut IncrementalDecoder) -> Result<Answer> {
    let (mesh, charts) = match (file.mesh()?, file.charts()?) {
        (Poll::NeedRanges(ranges), _) | (_, Poll::NeedRanges(ranges)) => return Ok(need_ranges(ranges)),
        (Poll::Ready(mesh), Poll::Ready(charts)) => (mesh, charts),
    };
    let (maps, mesh, charts) = match (file.reflectance()?, mesh, charts) {
        (Poll::NeedRanges(ranges), _, _) => return Ok(need_ranges(ranges)),
        (Poll::Ready(Some(maps)), Some(mesh), Some(charts)) => (maps, mesh, charts),
        _ => return Ok((Status::Ready, vec![Output::Text("null".into())])),
    };
    // Shaders know lobes and one other shape of highlights, not those of palettes. Photographs stay as they are: the residual is what this model misses.
    let maps = maps.without_palette();
    let mask = charts.atlas_mask(&mesh)?;
    let texels = mask.data.len();
    let filled = |map: &Grid<[f32; 3]>| {
        let mut whole = map.clone();
        whole.fill_outside(&mask);
        // What is black on a chart is black.
        let texel = |((&filled, &own), &used): ((&[f32; 3], &[f32; 3]), &bool)| if used { own } else { filled };
        whole.data.iter().zip(&map.data).zip(&mask.data).map(texel).collect::<Vec<_>>()
    };
    if maps.diffuse.data.len() != texels {
        return Err(Error::format(Tag::REFLECTANCE, 0u8, "the map is not of the atlas' size"));
    }
    let diffuse = filled(&maps.diffuse);
    let diffuse = diffuse.iter().zip(&mask.data).map(|([r, g, b], used)| [*r, *g, *b, *used as u8 as f32]).collect();
    let mut arrays = vec![Output::Pixels(diffuse)];
    let mut names = vec![json!(["diffuse", "f32"])];
    if maps.specular.data.len() == texels && maps.sigma.data.len() == texels {
        let specular = filled(&maps.specular);
        let sigma = filled(&maps.sigma.map(|&sigma| [sigma; 3]));
        let both = specular.iter().zip(&sigma).map(|([r, g, b], [sigma, ..])| [*r, *g, *b, *sigma]);
        arrays.push(Output::Pixels(both.collect()));
        names.push(json!(["specular", "f32"]));
    }
    for (k, weights) in maps.lobes.iter().enumerate().filter(|(_, weights)| weights.data.len() == texels) {
        names.push(json!([["lobes", k, "weights"], "f32"]));
        arrays.push(Output::Colours(filled(weights)));
    }
    let lobes = maps.lobe_roughness().iter().map(|roughness| json!({"roughness": roughness}));
    let description = json!({
        "width": mask.width, "height": mask.height, "relightable": maps.relightable, "specular": null,
        "lobes": lobes.collect::<Vec<_>>(), "arrays": names,
    });
    Ok((Status::Ready, std::iter::once(Output::Text(description.to_string())).chain(arrays).collect()))
}

/// Bit 0 of `flags` asks for half floats, bits 1 to 3 for the components.
fn view(file: &mut IncrementalDecoder, index: usize, flags: u32) -> Result<Answer> {
    let components = match file.header()? {
        Poll::Ready(opened) => opened.capture.components.clone(),
        Poll::NeedRanges(ranges) => return Ok(need_ranges(ranges)),
    };
    let is_wanted = |component: Component| flags >> (1 + component as u32) & 1 != 0;
    let progress = file.view_as(index, |picture| {
        let (width, height) = (picture.mask().width, picture.mask().height);
        let mut names = vec![json!(["mask", "u8"])];
        let mut arrays = vec![Output::Bytes(picture.mask().data.iter().map(|&inside| inside as u8).collect())];
        for (k, component) in components.iter().enumerate().filter(|(_, component)| is_wanted(**component)) {
            let (kind, pixels) = match flags & 1 {
                0 => ("f32", Output::Pixels(pixels(&picture, k, |row, into| into.copy_from_slice(row)))),
                _ => ("f16", Output::Halves(pixels(&picture, k, to_halves).into_flattened())),
            };
            names.push(json!([["images", component], kind]));
            arrays.push(pixels);
        }
        (json!({"index": index, "width": width, "height": height, "images": {}, "arrays": names}), arrays)
    })?;
    match progress {
        Poll::NeedRanges(ranges) => Ok(need_ranges(ranges)),
        Poll::Ready(ViewStatus::InProgress) => Ok((Status::InProgress, Vec::new())),
        Poll::Ready(ViewStatus::Absent) => Err(Error::parameter("the file has no photographs")),
        Poll::Ready(ViewStatus::Decoded((description, arrays))) => {
            Ok((Status::Ready, std::iter::once(Output::Text(description.to_string())).chain(arrays).collect()))
        }
    }
}

/// A component's colours with the mask as fourth channel.
fn pixels<T: Copy + Default>(
    picture: &ViewPhotograph,
    component: usize,
    convert: impl Fn(&[[f32; 4]], &mut [[T; 4]]),
) -> Vec<[T; 4]> {
    let count = picture.mask().data.len();
    let mut pixels = Vec::with_capacity(count);
    picture.for_each_row(component, |first, row| {
        // What lies between rows is outside the mask.
        pixels.resize(first + row.len(), [T::default(); 4]);
        convert(row, &mut pixels[first..]);
    });
    pixels.resize(count, [T::default(); 4]);
    pixels
}

/// BRDF values over half angles, difference angles and azimuths, red, green, blue.
fn table(material: &impl Brdf) -> Vec<f32> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let [half_angles, difference_angles, azimuths] = MATERIAL;
    let mut values = Vec::with_capacity(half_angles * difference_angles * azimuths * 3);
    for h in 0..half_angles {
        for d in 0..difference_angles {
            for p in 0..azimuths {
                let angles = HalfDifference {
                    theta_h: (h as f64 / half_angles as f64).powi(2) * FRAC_PI_2,
                    theta_d: d as f64 / difference_angles as f64 * FRAC_PI_2,
                    phi_d: p as f64 / azimuths as f64 * PI,
                };
                let (incoming, outgoing) = angles.directions();
                let above = incoming[2] > 0.0 && outgoing[2] > 0.0;
                let value = if above { material.evaluate(incoming, outgoing) } else { [0.0; 3] };
                values.extend(value.map(|x| x as f32));
            }
        }
    }
    values
}
