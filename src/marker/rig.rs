//! Rigs: markers whose poses relative to each other are known.

use super::{MarkerFamily, Pose};
use crate::capture::json::{JsonDocument, JsonNode};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use std::path::Path;

/// Markers of a rig, at most.
const MAX_MARKERS: usize = 4096;

/// A marker of a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigMarker {
    /// Its family.
    pub family: MarkerFamily,
    /// Its number; `None`: any, taken to be the same marker.
    pub id: Option<u32>,
    /// Length of its sides.
    pub size: f64,
    /// Its own frame in the rig's.
    pub pose: Pose,
}

impl RigMarker {
    /// Corners in the rig's frame: upper left, upper right, lower right, lower left.
    pub fn corners(&self) -> [[f64; 3]; 4] {
        let half = 0.5 * self.size;
        [[-half, half], [half, half], [half, -half], [-half, -half]]
            .map(|[x, y]| self.pose.transform_point([x, y, 0.0]))
    }
}

/// Markers that stand still to each other. See [the chain of frames](super).
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The markers, at least one.
    pub markers: Vec<RigMarker>,
}

impl Rig {
    /// Makes a rig of one marker, whose frame is the rig's.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a size that is not above 0.
    pub fn single(family: MarkerFamily, id: Option<u32>, size: f64) -> Result<Self> {
        if !(size.is_finite() && size > 0.0) {
            return Err(Error::parameter(format!("a marker's size is a length above 0, not {size}")));
        }
        Ok(Rig { markers: vec![RigMarker { family, id, size, pose: Pose::IDENTITY }] })
    }

    /// Parses a marker as `FAMILY:ID:SIZE`, as in `tag36h11:76:0.065`; `*` for the number takes any.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for any other text.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = || {
            Error::parameter(format!(
                "\"{text}\" is no marker: FAMILY:ID:SIZE is, as in tag36h11:76:0.065 (the size in any unit, * for any number), \
                 or the path of a JSON file with a rig"
            ))
        };
        let parts: Vec<&str> = text.split(':').collect();
        let [family, id, size] = parts[..] else { return Err(wrong()) };
        let id = if id == "*" { None } else { Some(id.parse().map_err(|_| wrong())?) };
        Rig::single(MarkerFamily::from_name(family)?, id, size.parse().map_err(|_| wrong())?)
    }

    /// Reads a rig: `{"markers": [{"family": "tag36h11", "id": 3, "size": 0.08, "pose": [[...] * 4]}]}`, `pose` the marker's frame in
    /// the rig's by rows (a rotation and a translation), the identity if it is left out.
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let document = JsonDocument::read(path.as_ref(), access)?;
        let mut markers: Vec<RigMarker> = Vec::new();
        for node in document.root().required("markers")?.items(MAX_MARKERS)? {
            let marker = read_marker(&node)?;
            if markers.iter().any(|m| (m.family, m.id) == (marker.family, marker.id)) {
                return Err(node.error("this marker is there twice"));
            }
            markers.push(marker);
        }
        if markers.is_empty() {
            return Err(document.root().error("a rig has at least one marker"));
        }
        Ok(Rig { markers })
    }

    /// The families in it.
    pub fn families(&self) -> Vec<MarkerFamily> {
        let mut families: Vec<MarkerFamily> = Vec::new();
        for marker in &self.markers {
            if !families.contains(&marker.family) {
                families.push(marker.family);
            }
        }
        families
    }

    /// Returns a name for messages, as in `tag36h11:76`.
    pub fn describe(&self) -> String {
        let name = |m: &RigMarker| match m.id {
            Some(id) => format!("{}:{id}", m.family.name()),
            None => m.family.name().to_owned(),
        };
        self.markers.iter().map(name).collect::<Vec<_>>().join(", ")
    }
}

fn read_marker(node: &JsonNode) -> Result<RigMarker> {
    let family_node = node.required("family")?;
    let family = MarkerFamily::from_name(family_node.text()?).map_err(|e| family_node.error(e))?;
    let size_node = node.required("size")?;
    let size = size_node.number()?;
    if size <= 0.0 {
        return Err(size_node.error("a marker's size is a length above 0"));
    }
    let id = Some(node.required("id")?.count()?);
    let Some(pose_node) = node.get("pose") else { return Ok(RigMarker { family, id, size, pose: Pose::IDENTITY }) };
    let matrix = pose_node.matrix()?;
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| matrix[i][j]));
    let rotation = crate::capture::nearest_rotation(rotation).map_err(|fault| pose_node.error(fault))?;
    let translation = std::array::from_fn(|i| matrix[i][3]);
    Ok(RigMarker { family, id, size, pose: Pose { rotation, translation } })
}
