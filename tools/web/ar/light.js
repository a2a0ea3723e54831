// Light of the place: spherical Gaussians from a second camera's fisheye picture, and the sums that shadows and exposure need.

import { Vector3 } from "three";
import { clustered, integral } from "../three/lobes.js";
import { linear } from "./tracker.js";

/** Cells along the side of the picture that light is gathered from. */
const SIDE = 48;
const LOBES = 8;

/**
 * Lobes of an upward fisheye picture (`ImageData`): equidistant, its circle as large as the picture's shorter side, its axis up, the picture's
 * top towards -z. What is below the horizon is lit as the mean.
 */
export function lobesOfFisheye(picture, fieldOfView = Math.PI) {
  const cells = [];
  const size = Math.min(picture.width, picture.height);
  for (let row = 0; row < SIDE; row++) {
    for (let column = 0; column < SIDE; column++) {
      const [u, v] = [(2 * (column + 0.5)) / SIDE - 1, (2 * (row + 0.5)) / SIDE - 1];
      const r = Math.hypot(u, v);
      const angle = (r * fieldOfView) / 2;
      if (r >= 1 || angle >= Math.PI / 2) continue;
      const [x, y] = [picture.width / 2 + (u * size) / 2, picture.height / 2 + (v * size) / 2].map(Math.floor);
      const at = 4 * (y * picture.width + x);
      // Solid angle of the cell.
      const solid = (r > 0 ? Math.sin(angle) / r : fieldOfView / 2) * (fieldOfView / 2) * (2 / SIDE) ** 2;
      const direction = [(Math.sin(angle) * u) / Math.max(r, 1e-9), Math.cos(angle), (Math.sin(angle) * v) / Math.max(r, 1e-9)];
      cells.push({ direction, flux: [0, 1, 2].map((c) => linear(picture.data[at + c] / 255) * solid) });
    }
  }
  const lobes = clustered(cells, LOBES);
  // The table below sends back some of it.
  const mean = [0, 1, 2].map((c) => cells.reduce((sum, { flux }) => sum + flux[c], 0) / (2 * Math.PI));
  return [...lobes, { axis: [0, -1, 0], sharpness: 1, amplitude: mean.map((x) => 0.3 * x) }];
}

const flux = ({ amplitude, sharpness }) => (amplitude[0] + amplitude[1] + amplitude[2]) * integral(sharpness);
const UP = new Vector3(0, 1, 0);

/** Directions of a lobe by its own distribution, on a spiral; light turned about y. */
function samplesOf({ axis, sharpness }, turn, count) {
  const middle = new Vector3(...axis).normalize().applyAxisAngle(UP, turn);
  const side = new Vector3(...(Math.abs(middle.y) < 0.9 ? [0, 1, 0] : [1, 0, 0])).cross(middle).normalize();
  const up = new Vector3().crossVectors(middle, side);
  return Array.from({ length: count }, (_, k) => {
    const c = 1 + Math.log1p(((k + 0.5) / count) * Math.expm1(-2 * sharpness)) / sharpness;
    const s = Math.sqrt(Math.max(1 - c * c, 0));
    const angle = 2.39996323 * k;
    return middle.clone().multiplyScalar(c).addScaledVector(side, s * Math.cos(angle)).addScaledVector(up, s * Math.sin(angle));
  });
}

/** Directions from above, about `count` of them, with their share of the irradiance of the ground (y is up). */
export function directionsOf(lobes, turn, count) {
  const total = lobes.reduce((sum, lobe) => sum + flux(lobe), 0);
  const found = [];
  for (const lobe of lobes) {
    const samples = samplesOf(lobe, turn, Math.max(Math.round((count * flux(lobe)) / total), flux(lobe) > 0.01 * total ? 3 : 0));
    for (const direction of samples) {
      if (direction.y > 0) found.push({ direction, weight: (flux(lobe) / samples.length) * direction.y });
    }
  }
  const whole = found.reduce((sum, { weight }) => sum + weight, 0);
  return found.map(({ direction, weight }) => ({ direction, weight: weight / whole }));
}

/** Irradiance of the ground in each colour. */
export function irradiance(lobes) {
  const sum = [0, 0, 0];
  for (const lobe of lobes) {
    const samples = samplesOf(lobe, 0, 64);
    const mean = samples.reduce((total, { y }) => total + Math.max(y, 0), 0) / samples.length;
    lobe.amplitude.forEach((a, c) => (sum[c] += a * integral(lobe.sharpness) * mean));
  }
  return sum;
}
