//! Linear starts: the direct linear transform of one frame, and points triangulated from several.

use super::{Correspondence, MIN_POINTS, Similarity};
use crate::error::{Error, Result};
use crate::views::Camera;
use glam::{DMat3, DVec3};
use nalgebra::{DMatrix, Dyn, SVD};

/// Points whose spread in their narrowest direction is below this share of the widest one count as coplanar (collinear for the
/// middle direction).
const FLAT: f64 = 1e-3;
/// Bound on the iterations of a singular value decomposition: about two are taken for each value.
const MAX_SVD_ITERATIONS: usize = 10_000;
/// Frames that the direct linear transform is tried on.
const MAX_FRAMES: usize = 8;

/// Poses to refine, or the reason that there is none.
pub(super) fn candidates(cameras: &[Camera], points: &[Correspondence], with_scale: bool) -> Result<Vec<Similarity>> {
    let spread = spread(&distinct(points.iter().map(|p| p.mesh)));
    if spread[1] <= FLAT * spread[0] {
        return Err(Error::parameter("the mesh points are collinear: mark points that are spread over the object"));
    }
    let mut starts = Vec::new();
    let mut flat_frame = None;
    let mut by_frame: Vec<(usize, Vec<Correspondence>)> = Vec::new();
    for point in points {
        match by_frame.iter_mut().find(|(frame, _)| *frame == point.frame) {
            Some((_, list)) => list.push(*point),
            None => by_frame.push((point.frame, vec![*point])),
        }
    }
    for (frame, list) in by_frame.iter().filter(|(_, list)| list.len() >= MIN_POINTS).take(MAX_FRAMES) {
        let mesh_points = distinct(list.iter().map(|p| p.mesh));
        let spread = self::spread(&mesh_points);
        if mesh_points.len() < MIN_POINTS || spread[2] <= FLAT * spread[0] {
            flat_frame = Some(*frame);
            continue;
        }
        if let Some((rotation, translation)) = direct_linear(&cameras[*frame], list) {
            starts.extend(to_world(cameras, *frame, rotation, translation, points, with_scale));
        }
    }
    starts.extend(from_triangulated(cameras, points, with_scale));
    if starts.is_empty() {
        return Err(Error::parameter(match flat_frame {
            Some(_) => {
                "the points of a frame are coplanar (or fewer than six different ones), which leaves the pose open: mark points \
                 at different depths, or the same points in a second frame"
            }
            None => {
                "the points don't determine a pose: mark six points or more in one frame, not all in one plane, or three or \
                 more in two frames each"
            }
        }));
    }
    Ok(starts)
}

fn distinct(points: impl Iterator<Item = [f64; 3]>) -> Vec<DVec3> {
    let mut found: Vec<DVec3> = Vec::new();
    for point in points.map(DVec3::from_array) {
        if !found.contains(&point) {
            found.push(point);
        }
    }
    found
}

/// Standard deviations along the principal axes, widest first.
fn spread(points: &[DVec3]) -> [f64; 3] {
    let centre = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let matrix = DMatrix::from_fn(points.len().max(3), 3, |i, j| points.get(i).map_or(0.0, |p| (*p - centre)[j]));
    singular_values(matrix).map_or([0.0; 3], |svd| std::array::from_fn(|k| svd.singular_values[k]))
}

/// Returns the singular value decomposition with falling values, `None` where it does not converge.
fn singular_values(matrix: DMatrix<f64>) -> Option<SVD<f64, Dyn, Dyn>> {
    let finite = matrix.iter().all(|value| value.is_finite());
    finite.then(|| matrix.try_svd(true, true, 5.0 * f64::EPSILON, MAX_SVD_ITERATIONS)).flatten()
}

/// Rotation and translation from mesh to camera coordinates by the direct linear transform, both image and mesh points
/// normalised (Hartley); the scale of the mesh is taken as 1. `None` if the points are degenerate.
fn direct_linear(camera: &Camera, points: &[Correspondence]) -> Option<(DMat3, DVec3)> {
    let count = points.len() as f64;
    let centre = points.iter().map(|p| DVec3::from_array(p.mesh)).sum::<DVec3>() / count;
    let distance = points.iter().map(|p| (DVec3::from_array(p.mesh) - centre).length()).sum::<f64>() / count;
    let size = distance / 3f64.sqrt();
    let image: Vec<[f64; 2]> =
        points.iter().map(|p| std::array::from_fn(|i| (p.pixel[i] - camera.principal[i]) / camera.focal[i])).collect();
    let middle: [f64; 2] = std::array::from_fn(|i| image.iter().map(|p| p[i]).sum::<f64>() / count);
    let radius = image.iter().map(|p| (p[0] - middle[0]).hypot(p[1] - middle[1])).sum::<f64>() / count / 2f64.sqrt();
    if size <= 0.0 || radius <= 0.0 {
        return None;
    }
    let matrix = DMatrix::from_fn(2 * points.len(), 12, |row, column| {
        let (index, axis) = (row / 2, row % 2);
        let mesh = (DVec3::from_array(points[index].mesh) - centre) / size;
        let coordinate = (image[index][axis] - middle[axis]) / radius;
        let homogeneous = if column % 4 < 3 { mesh[column % 4] } else { 1.0 };
        match column / 4 {
            block if block == axis => homogeneous,
            2 => -coordinate * homogeneous,
            _ => 0.0,
        }
    });
    let svd = singular_values(matrix)?;
    let values = &svd.singular_values;
    if values[10] <= 1e-9 * values[0] {
        return None;
    }
    let transposed = svd.v_t?;
    let null = transposed.row(11);
    let row = |i: usize| [null[4 * i], null[4 * i + 1], null[4 * i + 2], null[4 * i + 3]];
    // Undo the normalisation: image rows are radius * (row) + middle * (third row), mesh (X - centre) / size.
    let third = row(2);
    let rows: [[f64; 4]; 3] = std::array::from_fn(|i| match i {
        2 => third,
        _ => std::array::from_fn(|j| radius * row(i)[j] + middle[i] * third[j]),
    });
    let linear = DMat3::from_cols_array_2d(&rows.map(|r| [r[0], r[1], r[2]])).transpose() * (1.0 / size);
    let constant = DVec3::new(rows[0][3], rows[1][3], rows[2][3]) - linear * centre;
    let sign = linear.determinant().signum();
    let (rotation, scale) = nearest_rotation(linear * sign)?;
    Some((rotation, constant * (sign / scale)))
}

/// The rotation nearest to a matrix, and the mean of its singular values.
pub(crate) fn nearest_rotation(matrix: DMat3) -> Option<(DMat3, f64)> {
    let svd = singular_values(DMatrix::from_fn(3, 3, |i, j| matrix.col(j)[i]))?;
    let values = svd.singular_values;
    let take =
        |m: DMatrix<f64>| DMat3::from_cols_array_2d(&std::array::from_fn(|j| std::array::from_fn(|i| m[(i, j)])));
    let (u, v_transposed) = (take(svd.u?), take(svd.v_t?));
    let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, (u * v_transposed).determinant().signum()));
    let scale = (values[0] + values[1] + values[2]) / 3.0;
    (scale > 0.0).then(|| (u * flip * v_transposed, scale))
}

fn camera_pose(camera: &Camera) -> (DMat3, DVec3) {
    (DMat3::from_cols_array_2d(&camera.rotation).transpose(), DVec3::from_array(camera.translation))
}

/// A pose in one camera's coordinates as a pose in the world. The other frames' points tell the scale where it is wanted: with
/// scale `s` a point is at `s a + b` in their coordinates, which is linear in `s` after multiplying by the depth.
fn to_world(
    cameras: &[Camera],
    frame: usize,
    rotation: DMat3,
    translation: DVec3,
    points: &[Correspondence],
    with_scale: bool,
) -> Option<Similarity> {
    let (to_camera, offset) = camera_pose(&cameras[frame]);
    let mut scale = 1.0;
    if with_scale {
        let (mut above, mut below) = (0.0, 0.0);
        for point in points.iter().filter(|p| p.frame != frame) {
            let camera = &cameras[point.frame];
            let (to_other, other_offset) = camera_pose(camera);
            let between = to_other * to_camera.transpose();
            let a = between * (rotation * DVec3::from_array(point.mesh) + translation);
            let b = other_offset - between * offset;
            for axis in 0..2 {
                let x = (point.pixel[axis] - camera.principal[axis]) / camera.focal[axis];
                let (left, right) = (a[axis] - x * a.z, x * b.z - b[axis]);
                above += left * right;
                below += left * left;
            }
        }
        scale = above / below;
        if !scale.is_finite() || scale <= 0.0 {
            return None;
        }
    }
    Some(Similarity {
        rotation: to_camera.transpose() * rotation,
        translation: to_camera.transpose() * (translation * scale - offset),
        scale,
    })
}

/// The pose from mesh points marked in two frames or more: each is triangulated (linear least squares over its rays), then
/// absolute orientation (Umeyama 1991). Needs three that are not collinear.
fn from_triangulated(cameras: &[Camera], points: &[Correspondence], with_scale: bool) -> Option<Similarity> {
    let mut pairs: Vec<(DVec3, DVec3)> = Vec::new();
    for mesh in distinct(points.iter().map(|p| p.mesh)) {
        let seen = points.iter().filter(|p| DVec3::from_array(p.mesh) == mesh);
        let (mut matrix, mut right, mut count) = (DMat3::ZERO, DVec3::ZERO, 0);
        for point in seen {
            let camera = &cameras[point.frame];
            let direction = DVec3::from_array(camera.ray(point.pixel)).normalize();
            let centre = DVec3::from_array(camera.centre());
            // Squared distance from the ray.
            let across = DMat3::IDENTITY
                - DMat3::from_cols(direction * direction.x, direction * direction.y, direction * direction.z);
            matrix += across;
            right += across * centre;
            count += 1;
        }
        // Parallel rays leave the depth open.
        if count >= 2 && matrix.determinant() > 1e-8 {
            pairs.push((mesh, matrix.inverse() * right));
        }
    }
    let spread = spread(&pairs.iter().map(|p| p.0).collect::<Vec<_>>());
    if pairs.len() < 3 || spread[1] <= FLAT * spread[0] {
        return None;
    }
    let count = pairs.len() as f64;
    let from = pairs.iter().map(|p| p.0).sum::<DVec3>() / count;
    let to = pairs.iter().map(|p| p.1).sum::<DVec3>() / count;
    let mut covariance = DMat3::ZERO;
    let mut variance = 0.0;
    for (mesh, world) in &pairs {
        let (a, b) = (*mesh - from, *world - to);
        covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
        variance += a.length_squared();
    }
    let (rotation, _) = nearest_rotation(covariance)?;
    let turned = rotation.transpose() * covariance;
    let trace = turned.x_axis.x + turned.y_axis.y + turned.z_axis.z;
    let scale = if with_scale { trace / variance } else { 1.0 };
    (scale > 0.0).then(|| Similarity { rotation, translation: to - rotation * from * scale, scale })
}
