// Where a camera stands, from the corners of a square marker: spec/placing.md, "Pose".
//
// Pictures have x to the right and y down, pixel centres at .5; cameras look along z. Markers have x to the right and y upwards on the print
// and z out of the paper, with the origin in their middle. A pose leads from the marker to the camera: `rotation` by rows, `translation`.

import { cross, dot, length, normalize } from "../three/views.js";

/** Reprojection error in pixels by which a second pose may be worse and still count, if it is nearer to the last one. */
const AMBIGUOUS = { times: 2, pixels: 0.15 };
const STEPS = 20;

/** Corners of a marker: upper left, upper right, lower right, lower left. */
export function markerCorners(side) {
  const half = side / 2;
  return [[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]];
}

const times = (matrix, v) => matrix.map((row) => dot(row, v));
const product = (a, b) => a.map((row) => [0, 1, 2].map((k) => row.reduce((sum, x, i) => sum + x * b[i][k], 0)));
const moved = ({ rotation, translation }, point) => times(rotation, point).map((x, i) => x + translation[i]);

/** Place of a marker's point in the picture; `lens` has `focal` and `principal` in pixels. */
export function project(pose, point, { focal, principal }) {
  const [x, y, z] = moved(pose, point);
  return [(focal[0] * x) / z + principal[0], (focal[1] * y) / z + principal[1]];
}

/** Rotation about a vector by its length in radians. */
function turn(vector) {
  const angle = length(vector);
  const [x, y, z] = normalize(vector);
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  const d = 1 - c;
  return [
    [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
    [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
    [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
  ];
}

/** Solves `matrix x = right` by elimination; null where there is no solution. */
function solve(matrix, right) {
  const rows = matrix.map((row, k) => [...row, right[k]]);
  const n = rows.length;
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(rows[i][k]) > Math.abs(rows[pivot][k])) pivot = i;
    if (!(Math.abs(rows[pivot][k]) > 1e-14)) return null;
    [rows[k], rows[pivot]] = [rows[pivot], rows[k]];
    for (let i = k + 1; i < n; i++) {
      const factor = rows[i][k] / rows[k][k];
      for (let j = k; j <= n; j++) rows[i][j] -= factor * rows[k][j];
    }
  }
  const x = new Array(n);
  for (let k = n - 1; k >= 0; k--) {
    x[k] = rows[k].slice(k + 1, n).reduce((sum, value, i) => sum - value * x[k + 1 + i], rows[k][n]) / rows[k][k];
  }
  return x;
}

/** A pose from the homography of a square; null where its corners are no square's. */
function fromHomography(corners, points, { focal, principal }) {
  const rows = [];
  const right = [];
  corners.forEach(([u, v], k) => {
    const [x, y] = [(u - principal[0]) / focal[0], (v - principal[1]) / focal[1]];
    const [a, b] = points[k];
    rows.push([a, b, 1, 0, 0, 0, -x * a, -x * b], [0, 0, 0, a, b, 1, -y * a, -y * b]);
    right.push(x, y);
  });
  const h = solve(rows, right);
  if (!h) return null;
  const column = (k) => [h[k], h[3 + k], k < 2 ? h[6 + k] : 1];
  const [first, second, third] = [0, 1, 2].map(column);
  const scale = 2 / (length(first) + length(second));
  if (!Number.isFinite(scale)) return null;
  // The nearest two unit vectors at right angles lie on either side of the bisector.
  const [sum, gap] = [[0, 1, 2].map((i) => normalize(first)[i] + normalize(second)[i]), [0, 1, 2].map((i) => normalize(first)[i] - normalize(second)[i])];
  const [along, across] = [normalize(sum), normalize(gap)];
  const x = along.map((value, i) => (value + across[i]) * Math.SQRT1_2);
  const y = along.map((value, i) => (value - across[i]) * Math.SQRT1_2);
  const z = cross(x, y);
  return { rotation: [0, 1, 2].map((i) => [x[i], y[i], z[i]]), translation: third.map((value) => value * scale) };
}

/** Root mean square distance in pixels between corners and where the pose has them. */
export function reprojection(pose, corners, points, lens) {
  const squares = corners.map(([u, v], k) => {
    const [x, y] = project(pose, points[k], lens);
    return (x - u) ** 2 + (y - v) ** 2;
  });
  return Math.sqrt(squares.reduce((a, b) => a + b, 0) / corners.length);
}

/** Levenberg-Marquardt on the reprojection error. */
function refine(pose, corners, points, lens) {
  let damping = 1e-3;
  let error = reprojection(pose, corners, points, lens);
  for (let step = 0; step < STEPS; step++) {
    const normal = Array.from({ length: 6 }, () => new Array(6).fill(0));
    const right = new Array(6).fill(0);
    points.forEach((point, k) => {
      const turned = times(pose.rotation, point);
      const [x, y, z] = turned.map((value, i) => value + pose.translation[i]);
      const by = [[lens.focal[0] / z, 0, (-lens.focal[0] * x) / (z * z)], [0, lens.focal[1] / z, (-lens.focal[1] * y) / (z * z)]];
      const seen = project(pose, point, lens);
      by.forEach((row, axis) => {
        // By a turn about the camera's axes, then by the translation.
        const slope = [...cross(turned, row), ...row];
        const gap = corners[k][axis] - seen[axis];
        slope.forEach((a, i) => {
          right[i] += a * gap;
          slope.forEach((b, j) => (normal[i][j] += a * b));
        });
      });
    });
    const damped = normal.map((row, i) => row.map((value, j) => (i === j ? value * (1 + damping) : value)));
    const change = solve(damped, right);
    if (!change) break;
    const next = {
      rotation: product(turn(change.slice(0, 3)), pose.rotation),
      translation: pose.translation.map((value, i) => value + change[3 + i]),
    };
    const found = next.translation[2] > 0 ? reprojection(next, corners, points, lens) : Infinity;
    if (!(found < error)) {
      damping *= 10;
      if (damping > 1e6) break;
      continue;
    }
    const done = error - found < 1e-7 * error;
    [pose, error, damping] = [next, found, damping / 10];
    if (done) break;
  }
  return { ...pose, error };
}

/** Angle between the rotations of two poses, radians. */
export function angleBetween(a, b) {
  const trace = a.rotation.reduce((sum, row, i) => sum + dot(row, b.rotation[i]), 0);
  return Math.acos(Math.min(Math.max((trace - 1) / 2, -1), 1));
}

/** The pose mirrored at the line of sight, which a small square looks all but the same in. */
function mirrored({ rotation, translation }) {
  const sight = normalize(translation);
  const normal = rotation.map((row) => row[2]);
  const along = dot(normal, sight);
  const other = normal.map((x, i) => 2 * along * sight[i] - x);
  const axis = cross(normal, other);
  const angle = Math.atan2(length(axis), dot(normal, other));
  return { rotation: product(turn(normalize(axis).map((x) => x * angle)), rotation), translation };
}

/**
 * The pose of a marker of side `side` from its corners in the picture: `{rotation, translation, error}`, the error root mean square in pixels;
 * null where there is none. `last` is the pose in the picture before, which decides between two that fit alike.
 */
export function poseOf(corners, side, lens, last = null) {
  const points = markerCorners(side);
  const start = fromHomography(corners, points, lens);
  if (!start) return null;
  const first = refine(start, corners, points, lens);
  const both = [first, refine(mirrored(first), corners, points, lens)].filter(({ error, translation }) => Number.isFinite(error) && translation[2] > 0);
  both.sort((a, b) => a.error - b.error);
  const [best, other] = both;
  if (!best) return null;
  const alike = other && other.error < AMBIGUOUS.times * best.error + AMBIGUOUS.pixels;
  return alike && last && angleBetween(other, last) < angleBetween(best, last) ? other : best;
}
