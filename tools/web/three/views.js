// Captured views: which of them look most alike, and where the capture's light stands. As src/relight/renderer.rs does it.

/** Captured views looked at for every surface point beyond those interpolated, where some are hidden. */
export const SPARE_VIEWS = 5;
/** Views that the residual is interpolated between. */
export const VIEWS = 3;

export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const add = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.sqrt(dot(a, a));
export const normalize = (a) => {
  const size = length(a);
  return size > 0 ? [a[0] / size, a[1] / size, a[2] / size] : [0, 0, 0];
};
/** Angle between two vectors, radians. */
export const angle = (a, b) => Math.atan2(length(cross(a, b)), dot(a, b));

/** World to camera coordinates. */
export function toCamera(camera, point) {
  return [0, 1, 2].map((i) => dot(camera.rotation[i], point) + camera.translation[i]);
}

/** Camera coordinates to the world. */
export function toWorld(camera, point) {
  const moved = subtract(point, camera.translation);
  const [x, y, z] = camera.rotation;
  return [0, 1, 2].map((i) => x[i] * moved[0] + y[i] * moved[1] + z[i] * moved[2]);
}

/** The camera's place in the world. */
export const centre = (camera) => toWorld(camera, [0, 0, 0]);

/** Middle of the bounding box, and radius of the sphere about it that holds all points; three numbers a point. */
export function bounds(positions) {
  if (positions.length < 3) return { middle: [0, 0, 0], radius: 1 };
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let k = 0; k < positions.length; k++) {
    low[k % 3] = Math.min(low[k % 3], positions[k]);
    high[k % 3] = Math.max(high[k % 3], positions[k]);
  }
  const middle = [0, 1, 2].map((i) => (low[i] + high[i]) / 2);
  let squared = 0;
  for (let k = 0; k < positions.length; k += 3) {
    const gap = [positions[k] - middle[0], positions[k + 1] - middle[1], positions[k + 2] - middle[2]];
    squared = Math.max(squared, dot(gap, gap));
  }
  return { middle, radius: Math.sqrt(squared) };
}

/** Whether two views have the same light: one that stands still, or moves with the camera; both unknown counts. */
function sameLight(a, b, middle) {
  if (!a.light || !b.light) return !a.light && !b.light;
  const distance = length(subtract(centre(a.camera), middle));
  const gap = (p, q) => length(subtract(p, q));
  return (
    gap(a.light.position, b.light.position) < 1e-3 * distance ||
    gap(toCamera(a.camera, a.light.position), toCamera(b.camera, b.light.position)) < 0.05 * distance
  );
}

/** For each view the number of its light; 0 is the light of most views. */
export function numberLights(views, middle) {
  const groups = [];
  views.forEach((view, k) => {
    const group = groups.find((group) => sameLight(views[group[0]], view, middle));
    if (group) group.push(k);
    else groups.push([k]);
  });
  groups.sort((a, b) => b.length - a.length || a[0] - b[0]);
  const numbers = new Array(views.length).fill(0);
  groups.forEach((group, number) => group.forEach((k) => (numbers[k] = number)));
  return numbers;
}

/** Views of `candidates`, the nearest to `eye` first, as `{view, angle}`, with the angle at the object's middle. */
export function nearest(views, candidates, eye, middle) {
  const wanted = subtract(eye, middle);
  return candidates
    .map((view) => ({ view, angle: angle(subtract(centre(views[view].camera), middle), wanted) }))
    .sort((a, b) => a.angle - b.angle || a.view - b.view);
}

/** Weights of views from their angles, ascending: the first `count` count, by how much nearer each is than the next one after them. */
export function weights(angles, count = VIEWS) {
  if (angles.length && angles[0] < 1e-9) return angles.map((_, k) => (k === 0 ? 1 : 0));
  const next = angles.length > count ? angles[count] : (angles.at(-1) ?? 0) * 1.5;
  const last = Math.max(next, 1e-9);
  const found = angles.map((a, k) => (k < count ? Math.max(1 - a / last, 1e-9) / a : 0));
  const sum = found.reduce((a, b) => a + b, 0);
  return found.map((weight) => weight / sum);
}

/**
 * The capture's light for any camera: moves with it unless it stood still. `near` as `nearest` gives it; `frame` has the camera's
 * `rotation` and `translation`. Null where the lights are unknown.
 */
export function captureLight(views, near, frame, count = VIEWS) {
  const shares = weights(near.map((n) => n.angle), count);
  let world = [0, 0, 0];
  let relative = [0, 0, 0];
  let intensity = [0, 0, 0];
  let spread = 0;
  let sum = 0;
  let first = null;
  near.forEach(({ view }, k) => {
    const { camera, light } = views[view];
    if (!light || !(shares[k] > 0)) return;
    first ??= light.position;
    spread = Math.max(spread, length(subtract(light.position, first)));
    world = add(world, light.position, shares[k]);
    relative = add(relative, toCamera(camera, light.position), shares[k]);
    intensity = add(intensity, light.intensity, shares[k]);
    sum += shares[k];
  });
  if (!(sum > 0)) return null;
  const mean = (v) => v.map((x) => x / sum);
  const still = spread < 1e-6 * (1 + length(mean(world)));
  return { position: still ? mean(world) : toWorld(frame, mean(relative)), intensity: mean(intensity) };
}
