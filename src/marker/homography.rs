//! The perspective map from a square to four points.

use glam::DVec3;

/// The perspective map `u across + v down + constant` from the unit square, u to the right and v down, to four corners that go clockwise
/// from the upper left, in closed form (Heckbert 1989).
pub(super) fn homography([p0, p1, p2, p3]: [[f64; 2]; 4]) -> Option<(DVec3, DVec3, DVec3)> {
    let along = |i: usize| (p1[i] - p2[i], p3[i] - p2[i], p0[i] - p1[i] + p2[i] - p3[i]);
    let ((ax, bx, sx), (ay, by, sy)) = (along(0), along(1));
    let determinant = ax * by - bx * ay;
    if determinant.abs() < 1e-12 {
        return None;
    }
    let (g, h) = ((sx * by - bx * sy) / determinant, (ax * sy - sx * ay) / determinant);
    let across = DVec3::new(p1[0] - p0[0] + g * p1[0], p1[1] - p0[1] + g * p1[1], g);
    let down = DVec3::new(p3[0] - p0[0] + h * p3[0], p3[1] - p0[1] + h * p3[1], h);
    Some((across, down, DVec3::new(p0[0], p0[1], 1.0)))
}
