//! Agreement of a capture's mesh, cameras and masks, from small versions of some views.

use super::{Capture, CaptureFrame};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::parallel;
use crate::surface::raster::{NO_TRIANGLE, check_work, rasterise};
use crate::views::Camera;
use glam::{DMat3, DVec3};
use serde::Serialize;
use std::path::Path;

/// Views that are looked at, evenly spaced.
const MAX_VIEWS: usize = 24;
/// Views on which other readings of a capture are tried.
const TRIED_VIEWS: usize = 8;
/// Longest side of a view while it is looked at, in pixels.
const SIDE: f64 = 160.0;
/// Below this intersection over union mesh and masks have nothing to do with each other.
const REFUSED: f64 = 0.2;
/// Below this one the user is warned.
const DOUBTFUL: f64 = 0.7;
/// Another reading of the capture is named where it comes to this, and is so much better than what is there.
const CONVINCING: f64 = 0.6;
const BETTER: f64 = 0.25;
/// Share of the seen surface that faces the cameras, below which the mesh is wound inwards, and below which the user is warned.
const INWARDS: f64 = 0.2;
const MIXED: f64 = 0.9;
/// A mask of a greater share of its photograph cuts nothing out, and tells nothing.
const FULL: f64 = 0.98;

/// Figures of how well mesh, cameras and masks of a capture agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Views that were looked at.
    pub views: usize,
    /// Mean intersection over union of the mesh's silhouette and the masks; `None` without masks.
    pub silhouette_iou: Option<f64>,
    /// Share of the masks' pixels that the mesh covers; `None` without masks.
    pub mask_coverage: Option<f64>,
    /// Share of the pixels that show the mesh which show the front of a triangle; `None` where no view shows the mesh.
    pub front_facing: Option<f64>,
    /// Other reading of the capture under which mesh and masks agree, and by how much, where they do not as they are.
    pub cause: Option<Cause>,
}

/// A mistake that explains why mesh and masks disagree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// The fault and its remedy, one sentence.
    pub sentence: String,
    /// Mean intersection over union without the mistake.
    pub silhouette_iou: f64,
}

/// A view at the size at which it is looked at.
struct SmallView {
    camera: Camera,
    /// `None` where the photograph has no mask, or one that cuts nothing out.
    mask: Option<Vec<bool>>,
}

impl SmallView {
    fn new(frame: &CaptureFrame) -> Self {
        let camera = &frame.view.camera;
        let scale = (SIDE / f64::from(camera.width.max(camera.height))).min(1.0);
        let side = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
        let (width, height) = (side(camera.width), side(camera.height));
        let factor = [f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height)];
        let scaled = |values: [f64; 2]| std::array::from_fn(|k| values[k] * factor[k]);
        let small =
            Camera { width, height, focal: scaled(camera.focal), principal: scaled(camera.principal), ..*camera };
        let mask = frame.mask.as_ref().map(|mask| {
            let at = |x: u32, y: u32| {
                let [x, y] =
                    [(x, factor[0]), (y, factor[1])].map(|(at, factor)| ((f64::from(at) + 0.5) / factor) as usize);
                *mask.value_at(x.min(mask.width - 1), y.min(mask.height - 1))
            };
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect::<Vec<bool>>()
        });
        let tells = |mask: &Vec<bool>| (mask.iter().filter(|&&shown| shown).count() as f64) < FULL * mask.len() as f64;
        SmallView { camera: small, mask: mask.filter(tells) }
    }
}

/// Counts of one view's pixels.
#[derive(Default, Clone, Copy)]
struct Counts {
    covered: u64,
    front: u64,
    masked: u64,
    both: u64,
}

fn count(mesh: &Mesh, camera: &Camera, mask: Option<&[bool]>) -> Counts {
    let mut counts = Counts::default();
    // A mesh so large or so near that drawing it is no bounded work is not what the photograph shows.
    if check_work(mesh, camera).is_err() {
        counts.masked = mask.map_or(0, |mask| mask.iter().filter(|&&shown| shown).count() as u64);
        return counts;
    }
    let raster = rasterise(mesh, camera);
    let centre = DVec3::from_array(camera.centre());
    for (index, &triangle) in raster.triangle.iter().enumerate() {
        let covered = triangle != NO_TRIANGLE;
        let masked = mask.is_some_and(|mask| mask[index]);
        counts.masked += u64::from(masked);
        counts.both += u64::from(covered && masked);
        counts.covered += u64::from(covered);
        if covered {
            let [a, b, c] =
                mesh.triangles[triangle as usize].map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
            counts.front += u64::from((b - a).cross(c - a).dot(centre - a) > 0.0);
        }
    }
    counts
}

fn iou(counts: &Counts) -> f64 {
    counts.both as f64 / (counts.covered + counts.masked - counts.both).max(1) as f64
}

/// Mean over the views with a mask; `None` without such.
fn mean_iou(mesh: &Mesh, views: &[(Camera, Vec<bool>)]) -> f64 {
    let all = parallel::map(views.len(), |k| iou(&count(mesh, &views[k].0, Some(&views[k].1))));
    all.iter().sum::<f64>() / all.len().max(1) as f64
}

/// Compares the mesh's silhouette with the masks and looks at which side of its triangles the cameras see. Takes time for some dozens of views of
/// 160 pixels a side, however many and large the capture's are.
pub fn agreement(capture: &Capture) -> Agreement {
    let step = capture.frames.len().div_ceil(MAX_VIEWS).max(1);
    let views: Vec<SmallView> = capture.frames.iter().step_by(step).map(SmallView::new).collect();
    let counts = parallel::map(views.len(), |k| count(&capture.mesh, &views[k].camera, views[k].mask.as_deref()));
    let masked: Vec<&Counts> =
        counts.iter().zip(&views).filter(|(_, view)| view.mask.is_some()).map(|(c, _)| c).collect();
    let sum = |of: fn(&Counts) -> u64| counts.iter().map(of).sum::<u64>();
    let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
    let mean = masked.iter().map(|counts| iou(counts)).sum::<f64>() / masked.len().max(1) as f64;
    let silhouette_iou = (!masked.is_empty()).then_some(mean);
    let both = masked.iter().map(|counts| counts.both).sum::<u64>();
    let mut found = Agreement {
        views: views.len(),
        silhouette_iou,
        mask_coverage: share(both, masked.iter().map(|counts| counts.masked).sum()),
        front_facing: share(sum(|counts| counts.front), sum(|counts| counts.covered)),
        cause: None,
    };
    if silhouette_iou.is_some_and(|iou| iou < DOUBTFUL) {
        let tried: Vec<(Camera, Vec<bool>)> =
            views.into_iter().filter_map(|view| Some((view.camera, view.mask?))).collect();
        let step = tried.len().div_ceil(TRIED_VIEWS).max(1);
        let tried: Vec<_> = tried.into_iter().step_by(step).collect();
        found.cause = explain(&capture.mesh, &tried);
    }
    found
}

/// The mistake without which mesh and masks agree best, if they then do.
fn explain(mesh: &Mesh, views: &[(Camera, Vec<bool>)]) -> Option<Cause> {
    let there = mean_iou(mesh, views);
    let mut best: Option<Cause> = None;
    let mut take = |silhouette_iou: f64, sentence: String| {
        let least = best.as_ref().map_or(CONVINCING.max(there + BETTER), |best| best.silhouette_iou + 0.02);
        if silhouette_iou >= least {
            best = Some(Cause { sentence, silhouette_iou });
        }
    };
    let inverted: Vec<_> =
        views.iter().map(|(camera, mask)| (*camera, mask.iter().map(|shown| !shown).collect())).collect();
    take(mean_iou(mesh, &inverted), "the masks are inverted: they show the background; set invert_masks".into());
    for factor in [1000.0, 100.0, 10.0, 0.1, 0.01, 0.001, 39.370_078_74, 0.0254, 3.280_839_9, 0.3048] {
        let scaled = moved(mesh, |p| p * factor);
        take(
            mean_iou(&scaled, views),
            format!("the mesh is in another unit than the cameras; set mesh_scale to {factor}"),
        );
    }
    for (name, change) in conventions() {
        let changed: Vec<_> = views.iter().map(|(camera, mask)| (change(camera), mask.clone())).collect();
        take(mean_iou(mesh, &changed), format!("the cameras' poses are {name}; write them as the format asks for"));
    }
    for turn in turns() {
        let turned = moved(mesh, |p| turn * p);
        // Without zeros below zero.
        let [x, y, z] = turn.transpose().to_cols_array_2d().map(|row| row.map(|value| value + 0.0));
        let rows = [x, y, z].map(|row| format!("[{}, {}, {}, 0]", row[0], row[1], row[2])).join(", ");
        take(
            mean_iou(&turned, views),
            format!("the mesh's axes are not the cameras' (is up y or z?); set its pose to [{rows}, [0, 0, 0, 1]]"),
        );
    }
    best
}

fn moved(mesh: &Mesh, change: impl Fn(DVec3) -> DVec3) -> Mesh {
    let positions = mesh.positions.iter().map(|p| change(DVec3::from_array(p.map(f64::from))).as_vec3().to_array());
    Mesh { positions: positions.collect(), triangles: mesh.triangles.clone() }
}

/// The 23 turns by right angles.
fn turns() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let signed: Vec<DVec3> = axes.iter().flat_map(|&axis| [axis, -axis]).collect();
    let pairs = signed.iter().flat_map(|&x| signed.iter().map(move |&y| (x, y))).filter(|(x, y)| x.dot(*y) == 0.0);
    pairs.map(|(x, y)| DMat3::from_cols(x, y, x.cross(y))).filter(|turn| *turn != DMat3::IDENTITY).collect()
}

/// Poses as the numbers of the file would give them under other conventions than the one they were read by.
fn conventions() -> [(&'static str, fn(&Camera) -> Camera); 5] {
    // What the file has, if it was read as camera to world in OpenGL's axes: columns of the rotation, and the centre.
    fn written(camera: &Camera) -> (DMat3, DVec3) {
        let rows = camera.rotation.map(DVec3::from_array);
        (DMat3::from_cols(rows[0], -rows[1], -rows[2]), DVec3::from_array(camera.centre()))
    }
    fn posed(camera: &Camera, to_camera: DMat3, translation: DVec3) -> Camera {
        let rows = to_camera.transpose();
        let rotation = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.to_array());
        Camera { rotation, translation: translation.to_array(), ..*camera }
    }
    const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    [
        ("camera to world in OpenCV's axes (y down, z forward), not in OpenGL's", |camera| {
            let (matrix, centre) = written(camera);
            let to_camera = matrix.transpose();
            posed(camera, to_camera, -(to_camera * centre))
        }),
        ("world to camera, not camera to world", |camera| {
            let (matrix, translation) = written(camera);
            posed(camera, FLIP * matrix, FLIP * translation)
        }),
        ("world to camera in OpenCV's axes (y down, z forward), not camera to world", |camera| {
            let (matrix, translation) = written(camera);
            posed(camera, matrix, translation)
        }),
        ("camera to world, not world to camera", |camera| {
            let rows = camera.rotation.map(DVec3::from_array);
            // The rows that were read are those of the rotation to the world.
            let to_camera = DMat3::from_cols(rows[0], rows[1], rows[2]);
            posed(camera, to_camera, -(to_camera * DVec3::from_array(camera.translation)))
        }),
        ("world to camera in OpenGL's axes (y up, z back), not in OpenCV's", |camera| {
            let rows = camera.rotation.map(DVec3::from_array);
            let to_camera = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            posed(camera, FLIP * to_camera, FLIP * DVec3::from_array(camera.translation))
        }),
    ]
}

impl Agreement {
    /// Returns `true` if mesh and masks have nothing to do with each other.
    pub fn is_refused(&self) -> bool {
        self.silhouette_iou.is_some_and(|iou| iou < REFUSED)
    }

    fn is_inwards(&self) -> bool {
        self.front_facing.is_some_and(|share| share < INWARDS)
    }

    /// Faults and doubts, one sentence each; none if everything agrees.
    pub fn sentences(&self) -> Vec<String> {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let mut all = Vec::new();
        if let Some(share) = self.front_facing.filter(|share| *share < MIXED) {
            let (back, why) = (
                percent(1.0 - share),
                if self.is_inwards() { "it is wound inwards" } else { "mixed winding, holes, or cameras within it?" },
            );
            all.push(format!("{back} of what the cameras see of the mesh are backs of triangles: {why}"));
        }
        if let Some(iou) = self.silhouette_iou.filter(|iou| *iou < DOUBTFUL) {
            let covered = percent(self.mask_coverage.unwrap_or(0.0));
            let cause = match &self.cause {
                Some(cause) => format!("{} (then they agree to {:.2})", cause.sentence, cause.silhouette_iou),
                None => "is this the capture's mesh, and is it where the cameras see it?".into(),
            };
            all.push(format!(
                "the mesh's silhouette and the masks agree to {iou:.2} (intersection over union), and the mesh covers {covered} of the masks: \
                 {cause}"
            ));
        }
        all
    }
}

/// Turns a mesh that is wound inwards, warns of what is doubtful, and refuses what can't be right.
pub(super) fn settle(path: &Path, capture: &mut Capture) -> Result<()> {
    let found = agreement(capture);
    let mut sentences = found.sentences();
    if found.is_refused() {
        let last = sentences.pop().unwrap_or_default();
        return Err(Error::input(path, format!("{last}; set unchecked to take the capture as it is")));
    }
    if found.is_inwards() {
        capture.mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        sentences[0] += "; its triangles were turned";
    }
    capture.warnings.extend(sentences);
    Ok(())
}
