// Square markers in pictures: found by js-aruco2, corners refined.

/** Families of markers: what they are called, and in the library. */
export const FAMILIES = {
  "aruco-mip-36h12": { title: "ArUco MIP 36h12", dictionary: "ARUCO_MIP_36h12" },
  aruco: { title: "ArUco", dictionary: "ARUCO" },
  tag36h11: { title: "AprilTag 36h11", dictionary: "APRILTAG_36h11" },
};

/** Half the side of the square around a corner that is looked at, as a share of the marker's shortest side, and in pixels. */
const WINDOW = { share: 0.12, least: 2, most: 6 };
const STEPS = 12;

/** Finds the markers of one family. */
export class Tracker {
  constructor(family) {
    const { AR } = globalThis;
    if (!FAMILIES[family]) throw new Error(`there is no family of markers "${family}": ${Object.keys(FAMILIES).join(", ")}`);
    this.detector = new AR.Detector({ dictionaryName: FAMILIES[family].dictionary });
  }

  /** Markers in a picture (`ImageData`): `{id, corners}`, upper left corner first, clockwise; pixel centres at .5. */
  find(picture) {
    const grey = greyOf(picture);
    return this.detector.detect(picture).map(({ id, corners }) => {
      const rough = corners.map(({ x, y }) => [x + 0.5, y + 0.5]);
      const sides = rough.map(([x, y], k) => Math.hypot(x - rough[(k + 1) % 4][0], y - rough[(k + 1) % 4][1]));
      const half = Math.round(Math.min(Math.max(WINDOW.share * Math.min(...sides), WINDOW.least), WINDOW.most));
      return { id, corners: rough.map((corner) => refined(grey, picture.width, picture.height, corner, half)) };
    });
  }
}

function greyOf({ data, width, height }) {
  const grey = new Float32Array(width * height);
  for (let k = 0; k < grey.length; k++) grey[k] = 0.299 * data[4 * k] + 0.587 * data[4 * k + 1] + 0.114 * data[4 * k + 2];
  return grey;
}

/** The point whose gaps to the pixels around are at right angles to the gradients there (Förstner and Gülch 1987). */
function refined(grey, width, height, [startX, startY], half) {
  let [x, y] = [startX, startY];
  for (let step = 0; step < STEPS; step++) {
    const [left, top] = [Math.floor(x) - half, Math.floor(y) - half];
    if (left < 1 || top < 1 || left + 2 * half + 2 > width || top + 2 * half + 2 > height) return [startX, startY];
    let [a, b, c, p, q] = [0, 0, 0, 0, 0];
    for (let row = top; row <= top + 2 * half; row++) {
      for (let column = left; column <= left + 2 * half; column++) {
        const at = row * width + column;
        const [gx, gy] = [grey[at + 1] - grey[at - 1], grey[at + width] - grey[at - width]];
        const [u, v] = [column + 0.5, row + 0.5];
        const away = ((u - x) ** 2 + (v - y) ** 2) / (half * half);
        const weight = Math.exp(-away);
        const [xx, xy, yy] = [weight * gx * gx, weight * gx * gy, weight * gy * gy];
        a += xx;
        b += xy;
        c += yy;
        p += xx * u + xy * v;
        q += xy * u + yy * v;
      }
    }
    const determinant = a * c - b * b;
    if (!(determinant > 1e-3 * (a + c) ** 2 * 1e-2)) return [startX, startY];
    const [nextX, nextY] = [(c * p - b * q) / determinant, (a * q - b * p) / determinant];
    // Away from where the marker was found is something else.
    if (Math.hypot(nextX - startX, nextY - startY) > half + 1) return [startX, startY];
    const change = Math.hypot(nextX - x, nextY - y);
    [x, y] = [nextX, nextY];
    if (change < 0.01) break;
  }
  return [x, y];
}

/** Colour of the paper around a marker, linear 0 to 1: the median of the brighter half of places in its margin; null outside the picture. */
export function paperColour({ data, width, height }, corners) {
  const middle = [0, 1].map((i) => corners.reduce((sum, corner) => sum + corner[i], 0) / 4);
  const found = [];
  corners.forEach((corner, k) => {
    const next = corners[(k + 1) % 4];
    for (const share of [0, 0.25, 0.5, 0.75]) {
      const [x, y] = [0, 1].map((i) => Math.floor(middle[i] + 1.1 * (corner[i] + share * (next[i] - corner[i]) - middle[i])));
      if (x < 0 || y < 0 || x >= width || y >= height) continue;
      const at = 4 * (y * width + x);
      found.push([0, 1, 2].map((c) => linear(data[at + c] / 255)));
    }
  });
  if (found.length < 4) return null;
  const brightness = ([r, g, b]) => r + g + b;
  found.sort((a, b) => brightness(a) - brightness(b));
  return found[Math.floor(0.75 * found.length)];
}

/** An sRGB signal as linear, 0 to 1. */
export const linear = (signal) => (signal <= 0.04045 ? signal / 12.92 : ((signal + 0.055) / 1.055) ** 2.4);
