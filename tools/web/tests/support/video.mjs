// A video of a marker that a camera looks at from all sides, for the browser's fake camera.

import { createRequire } from "node:module";
import { closeSync, openSync, writeSync } from "node:fs";

const { AR } = createRequire(import.meta.url)("js-aruco2");

export const [WIDTH, HEIGHT, FOCAL] = [640, 480, 560];
/** Blocks in the upper left corner that say a frame's number in binary, and their side. */
export const [DIGITS, BLOCK] = [7, 16];
const SAMPLES = 3;

const turned = (axis, angle) => {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  return { x: [[1, 0, 0], [0, c, -s], [0, s, c]], z: [[c, -s, 0], [s, c, 0], [0, 0, 1]] }[axis];
};
const product = (a, b) => a.map((row) => [0, 1, 2].map((k) => row.reduce((sum, x, i) => sum + x * b[i][k], 0)));

/** A camera above a marker of side 1 on a table, `tilt` from straight above: marker to camera. */
export function poseAt(turn, tilt, distance, shift = [0, 0]) {
  // From above the marker's y is up in the picture, its z towards the camera.
  const upright = [[1, 0, 0], [0, -1, 0], [0, 0, -1]];
  const rotation = product(turned("x", -tilt), product(upright, turned("z", turn)));
  return { rotation, translation: [shift[0], shift[1], distance] };
}

/** Writes frames as y4m; `poses` has a pose for each, null without a marker. */
export function writeVideo(path, poses, { family = "ARUCO_MIP_36h12", number = 7, rate = 10 } = {}) {
  const file = openSync(path, "w");
  writeSync(file, `YUV4MPEG2 W${WIDTH} H${HEIGHT} F${rate}:1 Ip A1:1 C420jpeg\n`);
  const { codeList, markSize } = new AR.Dictionary(family);
  const code = codeList[number];
  const cells = markSize;
  /** Reflectance of the print at a place in units of the marker's side; null beside the paper. */
  const print = (x, y) => {
    const [column, row] = [Math.floor((x + 0.5) * cells), Math.floor((0.5 - y) * cells)];
    if (Math.min(column, row) < -2 || Math.max(column, row) >= cells + 2) return null;
    const inside = Math.min(column, row) >= 0 && Math.max(column, row) < cells;
    const inner = Math.min(column, row) >= 1 && Math.max(column, row) < cells - 1;
    if (!inside) return 205;
    return inner && code[(row - 1) * (cells - 2) + column - 1] === "1" ? 205 : 28;
  };
  const chroma = Buffer.alloc((WIDTH * HEIGHT) / 2, 128);
  poses.forEach((pose, frame) => {
    const picture = Buffer.alloc(WIDTH * HEIGHT);
    for (let y = 0; y < HEIGHT; y++) {
      for (let x = 0; x < WIDTH; x++) {
        const table = 120 + 20 * Math.sin(0.05 * x + 0.02 * y);
        picture[y * WIDTH + x] = pose ? shaded(pose, x, y, table, print) : table;
      }
    }
    for (let k = 0; k < DIGITS; k++) {
      for (let y = 0; y < BLOCK; y++) picture.fill((frame >> k) & 1 ? 235 : 16, y * WIDTH + k * BLOCK, y * WIDTH + (k + 1) * BLOCK);
    }
    writeSync(file, "FRAME\n");
    writeSync(file, picture);
    writeSync(file, chroma);
  });
  closeSync(file);
}

function shaded({ rotation: r, translation: t }, x, y, table, print) {
  let sum = 0;
  for (let k = 0; k < SAMPLES * SAMPLES; k++) {
    const u = (x + ((k % SAMPLES) + 0.5) / SAMPLES - WIDTH / 2) / FOCAL;
    const v = (y + (Math.floor(k / SAMPLES) + 0.5) / SAMPLES - HEIGHT / 2) / FOCAL;
    // Ray and plane z = 0 of the marker.
    const normal = [r[0][2], r[1][2], r[2][2]];
    const depth = (normal[0] * t[0] + normal[1] * t[1] + normal[2] * t[2]) / (normal[0] * u + normal[1] * v + normal[2]);
    const p = [u * depth - t[0], v * depth - t[1], depth - t[2]];
    const at = [0, 1].map((i) => r[0][i] * p[0] + r[1][i] * p[1] + r[2][i] * p[2]);
    sum += (depth > 0 ? print(...at) : null) ?? table;
  }
  return sum / (SAMPLES * SAMPLES);
}
