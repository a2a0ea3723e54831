//! Rigs: markers whose poses relative to each other are known.

use super::{MarkerFamily, MarkerPattern, Pose};
use crate::capture::json::{JsonDocument, JsonNode};
use crate::error::{Error, Result};
use crate::input::{FileAccess, Folder, quoted};
use std::path::Path;

/// Markers of a rig, at most, and those among them that are found by patterns.
const MAX_MARKERS: usize = 4096;
const MAX_PATTERNS: usize = 64;

/// A marker of a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigMarker {
    /// Its family.
    pub family: MarkerFamily,
    /// Its number; `None`: any, taken to be the same marker. Of [`MarkerFamily::ArToolKit`] that of its pattern in the rig.
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
    /// Patterns of the markers of [`MarkerFamily::ArToolKit`].
    pub patterns: Vec<MarkerPattern>,
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
        Ok(Rig { markers: vec![RigMarker { family, id, size, pose: Pose::IDENTITY }], patterns: Vec::new() })
    }

    /// Parses a marker as `FAMILY:ID:SIZE`, as in `tag36h11:76:0.065`; `*` for the number takes any. ARToolKit's have the path of their
    /// pattern file in place of the number, as in `artoolkit:patt.hiro:80`, which is read.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for any other text, and those of [`MarkerPattern::read`].
    pub fn parse(text: &str, access: &FileAccess) -> Result<Self> {
        let wrong = || {
            Error::parameter(format!(
                "{} is no marker: FAMILY:ID:SIZE is, as in tag36h11:76:0.065 (the size in any unit, * for any number), \
                 artoolkit:PATTERN:SIZE with the path of a pattern file, or the path of a JSON file with a rig",
                quoted(text)
            ))
        };
        // A path may have colons in it.
        let (family, (id, size)) =
            text.split_once(':').and_then(|(family, rest)| Some((family, rest.rsplit_once(':')?))).ok_or_else(wrong)?;
        let family = MarkerFamily::from_name(family)?;
        let size = size.parse().map_err(|_| wrong())?;
        if family == MarkerFamily::ArToolKit {
            if id.is_empty() || id == "*" {
                return Err(Error::parameter(
                    "a marker of ARToolKit is found by its pattern file: artoolkit:PATTERN:SIZE",
                ));
            }
            let rig = Rig::single(family, Some(0), size)?;
            return Ok(Rig { patterns: vec![MarkerPattern::read(id, access)?], ..rig });
        }
        let id = if id == "*" { None } else { Some(id.parse().map_err(|_| wrong())?) };
        Rig::single(family, id, size)
    }

    /// Reads a rig: `{"markers": [{"family": "tag36h11", "id": 3, "size": 0.08, "pose": [[...] * 4]}]}`, `pose` the marker's frame in
    /// the rig's by rows (a rotation and a translation), the identity if it is left out. Markers of family `artoolkit` have the path of their
    /// `pattern` file in place of `id`, and may have `border` and `confidence` ([`MarkerPattern`]).
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let document = JsonDocument::read(path.as_ref(), access)?;
        let folder = Folder::containing(path.as_ref(), access.allows_outside());
        let mut patterns = Vec::new();
        let mut markers: Vec<RigMarker> = Vec::new();
        for node in document.root().required("markers")?.items(MAX_MARKERS)? {
            let marker = read_marker(&node, &folder, access, &mut patterns)?;
            if markers.iter().any(|m| (m.family, m.id) == (marker.family, marker.id)) {
                return Err(node.error("this marker is there twice"));
            }
            markers.push(marker);
        }
        if markers.is_empty() {
            return Err(document.root().error("a rig has at least one marker"));
        }
        Ok(Rig { markers, patterns })
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
            Some(id) if m.family == MarkerFamily::ArToolKit => {
                format!("{}:{}", m.family.name(), self.patterns.get(id as usize).map_or("", MarkerPattern::name))
            }
            Some(id) => format!("{}:{id}", m.family.name()),
            None => m.family.name().to_owned(),
        };
        self.markers.iter().map(name).collect::<Vec<_>>().join(", ")
    }
}

fn read_marker(
    node: &JsonNode,
    folder: &Folder,
    access: &FileAccess,
    patterns: &mut Vec<MarkerPattern>,
) -> Result<RigMarker> {
    let family_node = node.required("family")?;
    let family = MarkerFamily::from_name(family_node.text()?).map_err(|e| family_node.error(e))?;
    let size_node = node.required("size")?;
    let size = size_node.number()?;
    if size <= 0.0 {
        return Err(size_node.error("a marker's size is a length above 0"));
    }
    let id = if family == MarkerFamily::ArToolKit {
        if patterns.len() == MAX_PATTERNS {
            return Err(node.error(format!("more than {MAX_PATTERNS} patterns")));
        }
        let pattern_node = node.required("pattern")?;
        let path = folder.resolve(pattern_node.text()?).map_err(|e| pattern_node.error(e))?;
        let mut pattern = MarkerPattern::read(path, access)?;
        if let Some(border) = node.get("border") {
            pattern.set_border(border.number()?).map_err(|e| border.error(e))?;
        }
        if let Some(confidence) = node.get("confidence") {
            pattern.set_min_confidence(confidence.number()?).map_err(|e| confidence.error(e))?;
        }
        patterns.push(pattern);
        Some(patterns.len() as u32 - 1)
    } else {
        Some(node.required("id")?.count()?)
    };
    let Some(pose_node) = node.get("pose") else { return Ok(RigMarker { family, id, size, pose: Pose::IDENTITY }) };
    let matrix = pose_node.matrix()?;
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| matrix[i][j]));
    let rotation = crate::capture::nearest_rotation(rotation).map_err(|fault| pose_node.error(fault))?;
    let translation = std::array::from_fn(|i| matrix[i][3]);
    Ok(RigMarker { family, id, size, pose: Pose { rotation, translation } })
}
