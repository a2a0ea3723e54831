// How a document's mesh lies on a stream's: by texture coordinates, never by the order of vertices. See "Binding" in
// spec/gltf/TSUYA_materials_appearance.md.

import { Matrix3, Matrix4 } from "three";

/** Largest error of the best affine map, as a share of the surface's size. */
const TOLERANCE = 0.02;
/** Smallest share of vertices whose texture coordinates lie on the charts. */
const LEAST_ON_ATLAS = 0.95;
/** Cells along a side of the grid that triangles are looked up in. */
const CELLS = 128;
/** How far beside its triangle a place may lie, in barycentric weight and in texels. */
const BESIDE = 1.5;

/** The surface of a stream by its atlas coordinates. */
export class Atlas {
  /** `mesh` as the decoder gives it; `size` the atlas' width and height in texels. */
  constructor(mesh, size) {
    this.mesh = mesh;
    this.size = size;
    this.cells = new Map();
    const { indices, uvs } = mesh;
    for (let t = 0; t < indices.length; t += 3) {
      const corners = [0, 1, 2].map((k) => [uvs[2 * indices[t + k]], uvs[2 * indices[t + k] + 1]]);
      const span = (axis) => {
        const values = corners.map((corner) => corner[axis]);
        const margin = BESIDE / size[axis];
        const cell = (x) => Math.min(Math.max(Math.floor(x * CELLS), 0), CELLS - 1);
        return [cell(Math.min(...values) - margin), cell(Math.max(...values) + margin)];
      };
      const [[left, right], [top, bottom]] = [span(0), span(1)];
      for (let y = top; y <= bottom; y++) {
        for (let x = left; x <= right; x++) {
          const key = y * CELLS + x;
          if (!this.cells.has(key)) this.cells.set(key, []);
          this.cells.get(key).push(t);
        }
      }
    }
  }

  /** Triangle (index of its first corner) and weights of its corners at an atlas place; null beside the charts. */
  find(u, v) {
    const cell = (x) => Math.min(Math.max(Math.floor(x * CELLS), 0), CELLS - 1);
    const { indices, uvs } = this.mesh;
    let best = null;
    let least = BESIDE;
    for (const t of this.cells.get(cell(v) * CELLS + cell(u)) ?? []) {
      const [a, b, c] = [0, 1, 2].map((k) => 2 * indices[t + k]);
      const across = (px, py, qx, qy, rx, ry) => (qx - px) * (ry - py) - (qy - py) * (rx - px);
      const area = across(uvs[a], uvs[a + 1], uvs[b], uvs[b + 1], uvs[c], uvs[c + 1]);
      if (area === 0) continue;
      const weights = [
        across(u, v, uvs[b], uvs[b + 1], uvs[c], uvs[c + 1]) / area,
        across(uvs[a], uvs[a + 1], u, v, uvs[c], uvs[c + 1]) / area,
        across(uvs[a], uvs[a + 1], uvs[b], uvs[b + 1], u, v) / area,
      ];
      // Distance beyond the edges, in texels.
      const sides = [b, c, a].map((from, k) => {
        const to = [c, a, b][k];
        const length = Math.hypot((uvs[to] - uvs[from]) * this.size[0], (uvs[to + 1] - uvs[from + 1]) * this.size[1]);
        return (-weights[k] * Math.abs(area) * this.size[0] * this.size[1]) / Math.max(length, 1e-12);
      });
      const beyond = Math.max(...sides, 0);
      if (beyond < least) {
        least = beyond;
        best = { triangle: t, weights };
        if (beyond === 0) break;
      }
    }
    return best;
  }

  /** Any values of the vertices, `count` for each, at a place that `find` gave. */
  read(values, count, { triangle, weights }) {
    const sum = new Array(count).fill(0);
    for (let k = 0; k < 3; k++) {
      const vertex = this.mesh.indices[triangle + k];
      for (let c = 0; c < count; c++) sum[c] += weights[k] * values[vertex * count + c];
    }
    return sum;
  }
}

/** The transform of KHR_texture_transform as a matrix; the identity without one. */
export function textureTransform({ offset = [0, 0], rotation = 0, scale = [1, 1] } = {}) {
  const [sin, cos] = [Math.sin(rotation), Math.cos(rotation)];
  return new Matrix3().set(cos * scale[0], sin * scale[1], offset[0], -sin * scale[0], cos * scale[1], offset[1], 0, 0, 1);
}

/**
 * Compares geometries with a stream's surface. Gives for each the affine map from its positions to the stream's world, or null where they are of
 * another mesh. `coordinates` names the attribute with texture coordinates.
 */
export function fitMesh(geometries, coordinates, transform, atlas) {
  const { positions } = atlas.mesh;
  const middle = meanOf(positions);
  let [seen, missed, error, spread] = [0, 0, 0, 0];
  const maps = geometries.map((geometry) => {
    const { position, [coordinates]: uv } = geometry.attributes;
    if (!position || !uv) return null;
    const [from, to] = [[], []];
    const step = Math.max(1, Math.ceil(position.count / 4096));
    for (let k = 0; k < position.count; k += step) {
      const [u, v] = transformed(transform, uv.getX(k), uv.getY(k));
      const place = atlas.find(u, v);
      if (!place) {
        missed++;
        continue;
      }
      from.push([position.getX(k), position.getY(k), position.getZ(k)]);
      to.push(atlas.read(positions, 3, place));
    }
    seen += from.length;
    spread += to.reduce((sum, p) => sum + p.reduce((s, x, i) => s + (x - middle[i]) ** 2, 0), 0);
    if (from.length < 4) return null;
    const fit = affine(from, to);
    error += fit.errors.reduce((sum, e) => sum + e, 0);
    // Vertices of slivers lie anywhere, by their texture coordinates: those that are far off do not take part in the map.
    const limit = 16 * [...fit.errors].sort((a, b) => a - b)[fit.errors.length >> 1];
    const close = (values) => values.filter((_, k) => fit.errors[k] <= limit);
    return close(from).length >= 4 ? affine(close(from), close(to)).map : fit.map;
  });
  const share = spread > 0 ? Math.sqrt(error / spread) : 1;
  const same = seen > 0 && seen >= LEAST_ON_ATLAS * (seen + missed) && share <= TOLERANCE && maps.every(Boolean);
  return same ? maps : null;
}

/** An atlas place after the transform. */
export function transformed({ elements: m }, u, v) {
  return [m[0] * u + m[3] * v + m[6], m[1] * u + m[4] * v + m[7]];
}

function meanOf(values) {
  const sum = [0, 0, 0];
  values.forEach((x, k) => (sum[k % 3] += x));
  return sum.map((x) => (3 * x) / Math.max(values.length, 1));
}

/** The affine map of least squares, and the squared error that it leaves at each place. */
function affine(from, to) {
  const [a, b] = [meanOf(from.flat()), meanOf(to.flat())];
  const square = new Array(9).fill(0);
  const product = new Array(9).fill(0);
  from.forEach((p, k) => {
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j < 3; j++) {
        square[3 * i + j] += (p[i] - a[i]) * (p[j] - a[j]);
        product[3 * i + j] += (to[k][i] - b[i]) * (p[j] - a[j]);
      }
    }
  });
  // Flat meshes leave one direction free.
  const trace = square[0] + square[4] + square[8];
  for (const i of [0, 4, 8]) square[i] += 1e-9 * trace + 1e-300;
  const inverse = new Matrix3().set(...square).invert();
  const linear = new Matrix3().set(...product).multiply(inverse);
  const m = linear.elements;
  const offset = b.map((x, i) => x - m[i] * a[0] - m[3 + i] * a[1] - m[6 + i] * a[2]);
  const map = new Matrix4().set(m[0], m[3], m[6], offset[0], m[1], m[4], m[7], offset[1], m[2], m[5], m[8], offset[2], 0, 0, 0, 1);
  const errors = from.map((p, k) => {
    const gap = [0, 1, 2].map((i) => m[i] * p[0] + m[3 + i] * p[1] + m[6 + i] * p[2] + offset[i] - to[k][i]);
    return gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2;
  });
  return { map, errors };
}
