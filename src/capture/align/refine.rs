//! Levenberg-Marquardt on the reprojection error, seven unknowns at most.

use super::{Correspondence, Similarity};
use crate::views::Camera;
use glam::{DMat3, DQuat, DVec3};

/// Rotation vector, translation of the points' centroid, logarithm of the scale.
const UNKNOWNS: usize = 7;
const MAX_STEPS: usize = 200;

fn camera_rotation(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation).transpose()
}

/// Distance in pixels of each correspondence; `None` if a point lies behind its camera.
pub(crate) fn reprojection_errors(
    cameras: &[Camera],
    points: &[Correspondence],
    pose: &Similarity,
) -> Option<Vec<f64>> {
    let one = |point: &Correspondence| {
        let world = pose.transform(DVec3::from_array(point.mesh));
        let (pixel, _) = cameras[point.frame].project(world.to_array())?;
        Some((pixel[0] - point.pixel[0]).hypot(pixel[1] - point.pixel[1]))
    };
    points.iter().map(one).collect()
}

fn cost(cameras: &[Camera], points: &[Correspondence], pose: &Similarity) -> Option<f64> {
    let sum: f64 = reprojection_errors(cameras, points, pose)?.iter().map(|e| e * e).sum();
    sum.is_finite().then_some(sum)
}

/// The pose of least summed squared distance near `start`, and that sum; `None` if the start puts points behind cameras.
pub(crate) fn refine(
    cameras: &[Camera],
    points: &[Correspondence],
    start: Similarity,
    with_scale: bool,
) -> Option<(f64, Similarity)> {
    // Turning and scaling about the centroid keeps the unknowns apart.
    let centroid = points.iter().map(|p| DVec3::from_array(p.mesh)).sum::<DVec3>() / points.len() as f64;
    let unknowns = if with_scale { UNKNOWNS } else { UNKNOWNS - 1 };
    let (mut pose, mut lowest) = (start, cost(cameras, points, &start)?);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let (matrix, gradient) = normal_equations(cameras, points, &pose, centroid);
        let mut improved = false;
        while damping < 1e12 {
            let mut damped = matrix;
            for i in 0..unknowns {
                damped[i][i] += damping * matrix[i][i].max(1e-300);
            }
            let step = solve(damped, gradient, unknowns);
            let next = step.map(|step| moved(&pose, step, centroid));
            if let Some((next, next_cost)) = next.and_then(|next| Some((next, cost(cameras, points, &next)?)))
                && next_cost < lowest
            {
                let gain = (lowest - next_cost) / lowest;
                (pose, lowest) = (next, next_cost);
                damping = (damping * 0.1).max(1e-15);
                improved = gain > 1e-14;
                break;
            }
            damping *= 10.0;
        }
        if !improved {
            break;
        }
    }
    Some((lowest, pose))
}

fn moved(pose: &Similarity, step: [f64; UNKNOWNS], centroid: DVec3) -> Similarity {
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2])));
    let rotation = turn * pose.rotation;
    let scale = pose.scale * step[6].exp();
    let centre = pose.transform(centroid) + DVec3::new(step[3], step[4], step[5]);
    Similarity { rotation, scale, translation: centre - rotation * centroid * scale }
}

type Matrix = [[f64; UNKNOWNS]; UNKNOWNS];

fn normal_equations(
    cameras: &[Camera],
    points: &[Correspondence],
    pose: &Similarity,
    centroid: DVec3,
) -> (Matrix, [f64; UNKNOWNS]) {
    let (mut matrix, mut gradient) = ([[0.0; UNKNOWNS]; UNKNOWNS], [0.0; UNKNOWNS]);
    for point in points {
        let camera = &cameras[point.frame];
        let to_camera = camera_rotation(camera);
        let mesh = DVec3::from_array(point.mesh);
        let arm = pose.rotation * (mesh - centroid) * pose.scale;
        let q = to_camera * pose.transform(mesh) + DVec3::from_array(camera.translation);
        let [fx, fy] = camera.focal;
        let rows =
            [DVec3::new(fx / q.z, 0.0, -fx * q.x / (q.z * q.z)), DVec3::new(0.0, fy / q.z, -fy * q.y / (q.z * q.z))];
        let projected = [fx * q.x / q.z + camera.principal[0], fy * q.y / q.z + camera.principal[1]];
        for (axis, row) in rows.into_iter().enumerate() {
            // d pixel / d world; turning by w moves the point by w x arm.
            let world = to_camera.transpose() * row;
            let turn = arm.cross(world);
            let jacobian = [turn.x, turn.y, turn.z, world.x, world.y, world.z, world.dot(arm)];
            let residual = point.pixel[axis] - projected[axis];
            for i in 0..UNKNOWNS {
                gradient[i] += jacobian[i] * residual;
                for j in 0..UNKNOWNS {
                    matrix[i][j] += jacobian[i] * jacobian[j];
                }
            }
        }
    }
    (matrix, gradient)
}

/// Cholesky solution of the first `unknowns` rows; `None` if the matrix is not positive definite.
fn solve(matrix: Matrix, right: [f64; UNKNOWNS], unknowns: usize) -> Option<[f64; UNKNOWNS]> {
    let mut lower = [[0.0; UNKNOWNS]; UNKNOWNS];
    for i in 0..unknowns {
        for j in 0..=i {
            let sum = matrix[i][j] - (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
            if i != j {
                lower[i][j] = sum / lower[j][j];
            } else if sum > 0.0 {
                lower[i][i] = sum.sqrt();
            } else {
                return None;
            }
        }
    }
    let mut solution = [0.0; UNKNOWNS];
    for i in 0..unknowns {
        let sum = right[i] - (0..i).map(|k| lower[i][k] * solution[k]).sum::<f64>();
        solution[i] = sum / lower[i][i];
    }
    for i in (0..unknowns).rev() {
        let sum = solution[i] - (i + 1..unknowns).map(|k| lower[k][i] * solution[k]).sum::<f64>();
        solution[i] = sum / lower[i][i];
    }
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}
