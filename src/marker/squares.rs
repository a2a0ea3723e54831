//! Dark squares in an image: quadrilaterals among its contours, their corners as the intersections of straight lines along the edges.

use super::homography::homography;
use crate::image::Grid;
use aruco_rs::ImageBuffer;
use aruco_rs::cv::ComputerVision;
use aruco_rs::cv::contours::find_contours;
use aruco_rs::cv::geometry::{approx_poly_dp, is_contour_convex};
use aruco_rs::cv::scalar::ScalarCV;

/// An edge is looked for this many pixels to each side, at most.
const EDGE_REACH: f64 = 4.0;
/// Shortest edge of a square, pixels.
const MIN_EDGE: f64 = 12.0;

/// Corners of the squares that are darker than their surroundings, clockwise; the same square may be there several times.
pub(super) fn find_squares(grey: &Grid<u8>) -> Vec<[[f64; 2]; 4]> {
    let (width, height) = (grey.width as u32, grey.height as u32);
    let mut binary = vec![0u8; grey.data.len()];
    ScalarCV::adaptive_threshold(&ImageBuffer { data: &grey.data, width, height }, &mut binary, 2, 7);
    let mut labels = vec![0i32; (grey.width + 2) * (grey.height + 2)];
    let contours = find_contours(&ImageBuffer { data: &binary, width, height }, &mut labels);
    let mut squares = Vec::new();
    for contour in contours.iter().filter(|c| c.points.len() as f64 >= 4.0 * MIN_EDGE) {
        let square = approx_poly_dp(&contour.points, 0.05 * contour.points.len() as f64);
        if square.len() != 4 || !is_contour_convex(&square) {
            continue;
        }
        let mut corners: [[f64; 2]; 4] = std::array::from_fn(|k| [square[k].x as f64 + 0.5, square[k].y as f64 + 0.5]);
        let twice: f64 =
            (0..4).map(|k| corners[k][0] * corners[(k + 1) % 4][1] - corners[k][1] * corners[(k + 1) % 4][0]).sum();
        if twice < 0.0 {
            corners.swap(1, 3);
        }
        let long = |k: usize| (corners[k][0] - corners[(k + 1) % 4][0]).hypot(corners[k][1] - corners[(k + 1) % 4][1]);
        if (0..4).all(|k| long(k) >= MIN_EDGE) {
            squares.extend(refine(grey, corners));
        }
    }
    squares
}

/// The cell of a square's raster, by rows, that cell `k` of a marker lies on whose upper left corner is the square's corner number `turn`.
pub(super) fn turned(turn: usize, side: usize, k: usize) -> usize {
    let (row, column) = (k / side, k % side);
    let (row, column) = match turn {
        0 => (row, column),
        1 => (column, side - 1 - row),
        2 => (side - 1 - row, side - 1 - column),
        _ => (side - 1 - column, row),
    };
    row * side + column
}

/// The perspective map from the unit square, x to the right and y down, to four corners that go clockwise from the upper left (Heckbert
/// 1989).
pub(super) fn unit_square_to(corners: [[f64; 2]; 4]) -> Option<impl Fn(f64, f64) -> [f64; 2]> {
    let (across, down, constant) = homography(corners)?;
    Some(move |x: f64, y: f64| {
        let p = across * x + down * y + constant;
        [p.x / p.z, p.y / p.z]
    })
}

/// Corners as the intersections of straight lines through the points of steepest change along each edge; `None` where an edge has none.
fn refine(grey: &Grid<u8>, corners: [[f64; 2]; 4]) -> Option<[[f64; 2]; 4]> {
    let lines: Vec<[f64; 3]> = (0..4).map(|k| edge(grey, corners[k], corners[(k + 1) % 4])).collect::<Option<_>>()?;
    let mut refined = [[0.0; 2]; 4];
    for (k, corner) in refined.iter_mut().enumerate() {
        let ([a, b, c], [d, e, f]) = (lines[(k + 3) % 4], lines[k]);
        let determinant = a * e - b * d;
        *corner = [(c * e - b * f) / determinant, (a * f - c * d) / determinant];
        let moved = (corner[0] - corners[k][0]).hypot(corner[1] - corners[k][1]);
        if moved.is_nan() || moved > 2.0 * EDGE_REACH {
            return None;
        }
    }
    Some(refined)
}

/// The line `a x + b y = c` of an edge that is dark on one side.
fn edge(grey: &Grid<u8>, from: [f64; 2], to: [f64; 2]) -> Option<[f64; 3]> {
    let along = [to[0] - from[0], to[1] - from[1]];
    let length = along[0].hypot(along[1]);
    let normal = [-along[1] / length, along[0] / length];
    let reach = EDGE_REACH.min(0.08 * length).max(1.0);
    let steps = (4.0 * reach).ceil() as i32;
    let count = (length.ceil() as usize).clamp(8, 256);
    let mut points = Vec::with_capacity(count);
    for k in 0..count {
        // The ends belong to the corners.
        let t = 0.06 + 0.88 * (k as f64 + 0.5) / count as f64;
        let middle = [from[0] + t * along[0], from[1] + t * along[1]];
        let value = |s: f64| bilinear(grey, [middle[0] + s * normal[0], middle[1] + s * normal[1]]);
        let (mut sum, mut moment) = (0.0, 0.0);
        for step in -steps..steps {
            let (s, next) = (step as f64 * reach / steps as f64, (step + 1) as f64 * reach / steps as f64);
            // The inside is dark: on the side that the normal points to.
            let drop = (value(s)? - value(next)?).max(0.0).powi(2);
            sum += drop;
            moment += drop * 0.5 * (s + next);
        }
        if sum > 16.0 {
            let s = moment / sum;
            points.push([middle[0] + s * normal[0], middle[1] + s * normal[1]]);
        }
    }
    let mut line = None;
    for _ in 0..2 {
        if points.len() < 6 {
            return None;
        }
        let n = points.len() as f64;
        let mean: [f64; 2] = std::array::from_fn(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
        let moment = |i: usize, j: usize| points.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>();
        let angle = 0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1));
        let (a, b) = (-angle.sin(), angle.cos());
        let c = a * mean[0] + b * mean[1];
        line = Some([a, b, c]);
        // Once more without those that lie beside it.
        let far = |p: &[f64; 2]| (a * p[0] + b * p[1] - c).abs();
        let mut distances: Vec<f64> = points.iter().map(far).collect();
        distances.sort_by(f64::total_cmp);
        let limit = (2.5 * distances[distances.len() / 2]).max(0.05);
        points.retain(|p| far(p) <= limit);
    }
    line
}

/// Between pixels (centres at +0.5); `None` outside.
pub(super) fn bilinear(grey: &Grid<u8>, [x, y]: [f64; 2]) -> Option<f64> {
    let (x, y) = (x - 0.5, y - 0.5);
    if !(x >= 0.0 && y >= 0.0 && x < (grey.width - 1) as f64 && y < (grey.height - 1) as f64) {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f64, y - row as f64);
    let at = |dx: usize, dy: usize| *grey.value_at(column + dx, row + dy) as f64;
    Some((at(0, 0) * (1.0 - s) + at(1, 0) * s) * (1.0 - t) + (at(0, 1) * (1.0 - s) + at(1, 1) * s) * t)
}
