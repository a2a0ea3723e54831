//! Metashape's cameras (File > Export > Export Cameras, "Agisoft XML").
//!
//! Poses are camera to chunk, camera axes x right, y down, z forward; the transform of the camera's component, else the chunk's, leads on to the
//! world. Calibrations by the Metashape Professional manual, appendix D; of PhotoScan before 1.3 (`fx`, `fy`) by its own.

use super::super::description::{CaptureDescription, capture_folder};
use super::super::lens::Lens;
use super::xml::{self, XmlElement};
use super::{ImportedView, check_views, description, left_out, pose, rows};
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder, escaped, quoted};
use crate::views::Camera;
use std::collections::BTreeMap;
use std::path::Path;

/// A coordinate this far from the origin is one on the Earth, from its centre.
const GEOCENTRIC: f64 = 1e6;

/// Turn, shift and scale.
#[derive(Clone, Copy)]
struct Similarity {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    scale: f64,
}

type Sensors<'a> = BTreeMap<&'a str, XmlElement<'a>>;

pub(super) fn describe(path: &Path, access: &FileAccess) -> Result<CaptureDescription> {
    let folder = Folder::new(capture_folder(path), path, access.allows_outside());
    let (views, warnings) = xml::read(path, access, |root| {
        let chunks: Vec<XmlElement> =
            if root.name() == "chunk" { vec![root] } else { root.children("chunk").collect() };
        let aligned = |chunk: &XmlElement| cameras(chunk).filter(|camera| camera.child("transform").is_some()).count();
        let most = chunks.iter().map(aligned).max().unwrap_or(0);
        let Some(chunk) = chunks.iter().find(|chunk| aligned(chunk) == most && most > 0) else {
            return Err(Error::input(
                path,
                "no chunk with an aligned camera: align the photographs in Metashape first",
            ));
        };
        let (views, mut warnings) = read_chunk(path, chunk, access)?;
        if chunks.len() > 1 {
            let label = escaped(chunk.attribute("label").unwrap_or_default());
            warnings.push(format!("of {} chunks the one of most aligned cameras is read: {label}", chunks.len()));
        }
        Ok((views, warnings))
    })?;
    description(path, &folder, views, warnings)
}

/// All cameras of a chunk, in groups or not.
fn cameras<'a>(chunk: &XmlElement<'a>) -> impl Iterator<Item = XmlElement<'a>> + use<'a> {
    chunk.children("cameras").flat_map(|cameras| cameras.descendants("camera"))
}

fn is_on(text: Option<&str>) -> bool {
    !matches!(text, Some("false" | "0"))
}

fn read_chunk(path: &Path, chunk: &XmlElement, access: &FileAccess) -> Result<(Vec<ImportedView>, Vec<String>)> {
    let sensors: Sensors = chunk
        .children("sensors")
        .flat_map(|sensors| sensors.children("sensor"))
        .filter_map(|sensor| Some((sensor.attribute("id")?, sensor)))
        .collect();
    let mut warnings = Vec::new();
    let transforms = Transforms::read(chunk, &mut warnings)?;
    let (mut views, mut disabled, mut unaligned) = (Vec::new(), Vec::new(), Vec::new());
    let mut calibrations: BTreeMap<&str, (Camera, Lens)> = BTreeMap::new();
    for camera in cameras(chunk) {
        let label = camera.attribute("label").unwrap_or_default().to_owned();
        check_views(path, views.len() + disabled.len() + unaligned.len() + 1, access)?;
        if !is_on(camera.attribute("enabled")) {
            disabled.push(label);
            continue;
        }
        let Some(transform) = camera.child("transform") else {
            unaligned.push(label);
            continue;
        };
        let id = camera.attribute("sensor_id").unwrap_or_default();
        let (mut pinhole, lens) = match calibrations.get(id) {
            Some(found) => *found,
            None => {
                let sensor =
                    sensors.get(id).ok_or_else(|| camera.error(format!("there is no sensor {}", quoted(id))))?;
                *calibrations.entry(id).or_insert(calibration(sensor)?)
            }
        };
        let matrix: [f64; 16] = transform.numbers("a camera's transform", transform.text())?;
        (pinhole.rotation, pinhole.translation) =
            transforms.world_pose(&camera, &matrix).map_err(|fault| transform.error(fault))?;
        views.push(ImportedView { named: label, camera: pinhole, lens });
    }
    warnings.extend(left_out(&disabled, "that are disabled in Metashape are"));
    warnings.extend(left_out(&unaligned, "that Metashape did not align are"));
    Ok((views, warnings))
}

/// From the chunk's coordinates to the world's.
struct Transforms<'a> {
    components: BTreeMap<&'a str, Similarity>,
    chunk: Option<Similarity>,
}

impl<'a> Transforms<'a> {
    fn read(chunk: &XmlElement<'a>, warnings: &mut Vec<String>) -> Result<Self> {
        let mut components = BTreeMap::new();
        for component in chunk.children("components").flat_map(|components| components.children("component")) {
            if let (Some(id), Some(transform)) = (component.attribute("id"), component.child("transform")) {
                components.insert(id, similarity(&transform)?);
            }
        }
        let own = chunk.child("transform").map(|transform| similarity(&transform)).transpose()?;
        let system = chunk.child("reference").map(|reference| reference.text()).unwrap_or_default();
        let far = |s: &Similarity| s.translation.iter().any(|t| t.abs() > GEOCENTRIC);
        // Local systems keep the chunk's transform; those of the Earth put the cameras around its centre, where no mesh is exported to.
        let local = system.is_empty() || system.starts_with("LOCAL_CS");
        if !local || components.values().chain(&own).any(far) {
            warnings.push(
                "the chunk is georeferenced; its cameras are read in the chunk's own coordinates: export the mesh in local coordinates, or \
                 register it with `capture::align`"
                    .into(),
            );
            return Ok(Transforms { components: BTreeMap::new(), chunk: None });
        }
        Ok(Transforms { components, chunk: own })
    }

    /// World to camera, from camera to chunk.
    fn world_pose(
        &self,
        camera: &XmlElement,
        matrix: &[f64; 16],
    ) -> std::result::Result<([[f64; 3]; 3], [f64; 3]), String> {
        let columns: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| matrix[4 * j + i]));
        let centre = [matrix[3], matrix[7], matrix[11]];
        let component = camera.attribute("component_id").and_then(|id| self.components.get(id));
        let Some(Similarity { rotation, translation, scale }) = component.or(self.chunk.as_ref()) else {
            return pose(columns, centre);
        };
        let turned = |v: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| rotation[i][0] * v[0] + rotation[i][1] * v[1] + rotation[i][2] * v[2])
        };
        let moved = turned(centre);
        pose(columns.map(turned), std::array::from_fn(|i| scale * moved[i] + translation[i]))
    }
}

fn similarity(transform: &XmlElement) -> Result<Similarity> {
    let mut found =
        Similarity { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3], scale: 1.0 };
    // Older files have all of it in one matrix.
    if transform.child("rotation").is_none() && !transform.text().is_empty() {
        let m: [f64; 16] = transform.numbers("a transform", transform.text())?;
        let turn: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
        found.scale = turn[0].iter().map(|v| v * v).sum::<f64>().sqrt();
        found.rotation = super::nearest_rotation(turn).map_err(|fault| transform.error(fault))?;
        found.translation = [m[3], m[7], m[11]];
        return Ok(found);
    }
    if let Some(rotation) = transform.property("rotation") {
        let rotation = rows(transform.numbers("a rotation", rotation)?);
        found.rotation = super::nearest_rotation(rotation).map_err(|fault| transform.error(fault))?;
    }
    if let Some(translation) = transform.property("translation") {
        found.translation = transform.numbers("a translation", translation)?;
    }
    if let Some(scale) = transform.number("scale")? {
        if scale <= 0.0 {
            return Err(transform.error(format!("a scale of {scale}")));
        }
        found.scale = scale;
    }
    Ok(found)
}

fn calibration(sensor: &XmlElement) -> Result<(Camera, Lens)> {
    let all: Vec<XmlElement> = sensor.children("calibration").collect();
    let adjusted = all.iter().find(|calibration| calibration.attribute("class") == Some("adjusted"));
    let Some(calibration) = adjusted.or(all.first()) else {
        return Err(sensor.error("the sensor has no calibration: align the photographs in Metashape first"));
    };
    let kind = calibration.attribute("type").or(sensor.attribute("type")).unwrap_or("frame");
    if !["frame", "fisheye"].contains(&kind) {
        return Err(sensor.error(format!(
            "a camera of type {} is not supported, those of type frame and fisheye are; undistort the photographs in Metashape first",
            quoted(kind)
        )));
    }
    let Some(size) = calibration.child("resolution").or(sensor.child("resolution")) else {
        return Err(sensor.error("<resolution> is missing"));
    };
    let (width, height) = (size.count("width")?, size.count("height")?);
    let number = |name: &'static str| Ok::<f64, Error>(calibration.number(name)?.unwrap_or(0.0));
    let half = [0.5 * f64::from(width), 0.5 * f64::from(height)];
    let (k1, k2, k3, k4) = (number("k1")?, number("k2")?, number("k3")?, number("k4")?);
    let (p1, p2) = (number("p1")?, number("p2")?);
    let (focal, principal, tangential, skew) = match (calibration.number("f")?, calibration.number("fx")?) {
        (Some(f), _) => {
            let principal = [half[0] + number("cx")?, half[1] + number("cy")?];
            // Metashape's p1 is OpenCV's p2.
            ([f + number("b1")?, f], principal, [p2, p1], number("b2")?)
        }
        (None, Some(fx)) => {
            let centre = [calibration.number("cx")?.unwrap_or(half[0]), calibration.number("cy")?.unwrap_or(half[1])];
            ([fx, calibration.number("fy")?.unwrap_or(fx)], centre, [p1, p2], number("skew")?)
        }
        (None, None) => return Err(calibration.error("<f> is missing")),
    };
    if number("p3")? != 0.0 || number("p4")? != 0.0 {
        return Err(calibration
            .error("the coefficients p3 and p4 are not supported: undistort the photographs in Metashape first"));
    }
    let lens = if kind == "fisheye" {
        if tangential != [0.0; 2] || skew != 0.0 {
            return Err(calibration.error(
                "a fisheye with the coefficients p1, p2 or b2 is not supported: optimise the cameras without them, or undistort the photographs",
            ));
        }
        Lens::Fisheye { coefficients: [k1, k2, k3, k4] }
    } else {
        Lens::Radial { numerator: [k1, k2, k3, k4], denominator: [0.0; 3], tangential, shear: skew / focal[0] }
    };
    Ok((Camera { width, height, focal, principal, ..Camera::default() }, lens))
}
