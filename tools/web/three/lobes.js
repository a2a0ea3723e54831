// Light as a few spherical Gaussians `amplitude exp(sharpness (axis . direction - 1))`.

const ROUNDS = 8;
/** Cells around the equator that an environment's picture is summed in. */
const COLUMNS = 96;
const SHARPNESS = [0.3, 300];
/** Light above this many times the mean is given lobes of its own. */
const BRIGHT = 4;
/** Directions of the test lobes, and their sharpness: about that of the cosine, cut by shadows. */
const TESTS = 160;
const TEST_SHARPNESS = 8;

/** Integral of `exp(sharpness (cos - 1))` over the sphere. */
export const integral = (sharpness) => (2 * Math.PI * -Math.expm1(-2 * sharpness)) / sharpness;

const energy = ({ flux: [r, g, b] }) => r + g + b;
const cosine = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/**
 * Clusters of light, one lobe each: k-means on the sphere, sharpness by the mean length of the directions (Banerjee 2005). `cells` have a
 * direction and a flux (radiance times solid angle, three colours).
 */
export function clustered(cells, count) {
  const centres = [];
  const far = cells.map(() => 1);
  while (centres.length < Math.min(count, cells.length)) {
    let best = 0;
    cells.forEach((cell, k) => energy(cell) * far[k] > energy(cells[best]) * far[best] && (best = k));
    centres.push(cells[best].direction);
    cells.forEach(({ direction }, k) => (far[k] = Math.min(far[k], 1 - cosine(direction, centres.at(-1)))));
  }
  let lobes = [];
  for (let round = 0; round < ROUNDS; round++) {
    const sums = centres.map(() => ({ moment: [0, 0, 0], flux: [0, 0, 0], energy: 0 }));
    for (const cell of cells) {
      let nearest = 0;
      centres.forEach((centre, k) => cosine(centre, cell.direction) > cosine(centres[nearest], cell.direction) && (nearest = k));
      const [sum, e] = [sums[nearest], energy(cell)];
      cell.direction.forEach((x, i) => (sum.moment[i] += e * x));
      cell.flux.forEach((x, c) => (sum.flux[c] += x));
      sum.energy += e;
    }
    lobes = [];
    sums.forEach(({ moment, flux, energy }, k) => {
      if (!(energy > 0)) return;
      const size = Math.hypot(...moment);
      centres[k] = moment.map((x) => x / size);
      const r = Math.min(size / energy, 0.9999);
      const sharpness = Math.min(Math.max((r * (3 - r * r)) / (1 - r * r), SHARPNESS[0]), SHARPNESS[1]);
      lobes.push({ axis: centres[k], sharpness, amplitude: flux.map((x) => x / integral(sharpness)) });
    });
  }
  return lobes;
}

/**
 * Lobes of a latitude-longitude picture: `data` has four numbers a pixel, linear, the highest row first; the middle is +Z, a quarter from the left
 * edge +X.
 */
export function lobesOfPicture({ data, width, height }, count) {
  const [columns, rows] = [Math.min(COLUMNS, width), Math.min(COLUMNS / 2, height)];
  const cells = Array.from({ length: columns * rows }, () => ({ direction: [0, 0, 0], flux: [0, 0, 0] }));
  for (let y = 0; y < height; y++) {
    const theta = (Math.PI * (y + 0.5)) / height;
    const solid = ((2 * Math.PI) / width) * (Math.cos((Math.PI * y) / height) - Math.cos((Math.PI * (y + 1)) / height));
    for (let x = 0; x < width; x++) {
      const phi = (2 * Math.PI * (x + 0.5)) / width;
      const cell = cells[Math.floor((y * rows) / height) * columns + Math.floor((x * columns) / width)];
      const flux = [0, 1, 2].map((c) => Math.max(data[4 * (y * width + x) + c], 0) * solid).map((v) => (Number.isFinite(v) ? v : 0));
      const e = flux[0] + flux[1] + flux[2];
      const towards = [Math.sin(theta) * Math.sin(phi), Math.cos(theta), -Math.sin(theta) * Math.cos(phi)];
      flux.forEach((v, c) => (cell.flux[c] += v));
      towards.forEach((v, i) => (cell.direction[i] += e * v));
    }
  }
  const lit = cells.filter((cell) => energy(cell) > 0);
  for (const cell of lit) {
    const size = Math.hypot(...cell.direction);
    cell.direction = cell.direction.map((v) => v / size);
  }
  return fitted(apart(lit, count), lit);
}

/** Lobes of what is bright, and of the rest: together, lamps would be spread over what is around them. */
function apart(cells, count) {
  const whole = cells.reduce((sum, cell) => sum + energy(cell), 0);
  // All cells together are the sphere, of nearly equal parts about the equator.
  const limit = (BRIGHT * whole) / cells.length;
  const share = (cell) => Math.max(1 - limit / energy(cell), 0);
  const part = (of) => cells.map((cell) => ({ ...cell, flux: cell.flux.map((x) => x * of(cell)) })).filter((cell) => energy(cell) > 0);
  const [bright, rest] = [part(share), part((cell) => 1 - share(cell))];
  const lamps = bright.reduce((sum, cell) => sum + energy(cell), 0) > 0.02 * whole ? Math.floor(count / 2) : 0;
  return [...(lamps ? clustered(bright, lamps) : []), ...clustered(lamps ? rest : cells, count - lamps)];
}

/** The lobes with amplitudes that show the light best through a wide lobe about many directions: least squares, none negative. */
function fitted(lobes, cells) {
  const tests = Array.from({ length: TESTS }, (_, k) => {
    const y = 1 - (2 * k + 1) / TESTS;
    const radius = Math.sqrt(1 - y * y);
    return [radius * Math.cos(2.39996323 * k), y, radius * Math.sin(2.39996323 * k)];
  });
  // Integral of the product of lobe and test lobe.
  const seen = ({ axis, sharpness }, test) => {
    const d = Math.sqrt(sharpness ** 2 + TEST_SHARPNESS ** 2 + 2 * sharpness * TEST_SHARPNESS * cosine(axis, test));
    return d > 1e-6 ? Math.exp(d - sharpness - TEST_SHARPNESS) * integral(d) : 4 * Math.PI * Math.exp(-sharpness - TEST_SHARPNESS);
  };
  const rows = tests.map((test) => lobes.map((lobe) => seen(lobe, test)));
  const rest = tests.map((test, k) => {
    const sum = [0, 0, 0];
    for (const { direction, flux } of cells) {
      const weight = Math.exp(TEST_SHARPNESS * (cosine(direction, test) - 1));
      flux.forEach((x, c) => (sum[c] += weight * x));
    }
    return sum.map((x, c) => x - rows[k].reduce((known, weight, j) => known + weight * lobes[j].amplitude[c], 0));
  });
  const squares = lobes.map((_, j) => rows.reduce((sum, row) => sum + row[j] ** 2, 0));
  for (let round = 0; round < 4 * ROUNDS; round++) {
    lobes.forEach(({ amplitude }, j) => {
      for (let c = 0; c < 3; c++) {
        const step = rows.reduce((sum, row, k) => sum + row[j] * rest[k][c], 0) / Math.max(squares[j], 1e-30);
        const next = Math.max(amplitude[c] + step, 0);
        rows.forEach((row, k) => (rest[k][c] -= row[j] * (next - amplitude[c])));
        amplitude[c] = next;
      }
    });
  }
  return lobes;
}
