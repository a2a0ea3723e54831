// Depth maps from point lights.

import {
  DoubleSide,
  FloatType,
  GLSL3,
  HalfFloatType,
  Mesh,
  NearestFilter,
  NoBlending,
  OrthographicCamera,
  RawShaderMaterial,
  RedFormat,
  Scene,
  Vector2,
  Vector4,
  WebGLRenderTarget,
} from "three";
import { depthRange, into, rowsOf } from "./captured.js";
import { captureVertex, shadowFragment } from "./passes.js";
import { LIGHTS } from "./reflectance.js";
import { cross, dot, normalize, subtract } from "./views.js";

const SIDE = 1024;
const camera = new OrthographicCamera();

/** A camera at `eye` that looks at `target`: rotation and translation. */
function lookAt(eye, target, up) {
  const forward = normalize(subtract(target, eye));
  const right = normalize(cross(forward, up));
  const rotation = [right, cross(forward, right), forward];
  return { rotation, translation: rotation.map((row) => -dot(row, eye)) };
}

/** What lights reach of a mesh: `shape` is the sphere about it, `count` how many lights there may be. */
export class Shadows {
  constructor(geometry, shape, count = LIGHTS) {
    this.shape = shape;
    this.count = count;
    this.drawn = "";
    this.mesh = new Mesh(
      geometry,
      new RawShaderMaterial({
        glslVersion: GLSL3,
        defines: { BEHIND: Number("behind" in geometry.attributes), SHADOW: 1 },
        vertexShader: "precision highp float;\n" + captureVertex,
        fragmentShader: "precision highp float;\n" + shadowFragment,
        side: DoubleSide,
        blending: NoBlending,
        uniforms: {
          rows: { value: [] },
          lens: { value: new Vector4() },
          size: { value: new Vector2(SIDE, SIDE) },
          range: { value: new Vector2() },
          depthScale: { value: new Vector2() },
        },
      }),
    );
    this.mesh.frustumCulled = false;
    this.scene = new Scene().add(this.mesh);
  }

  /** Draws the maps of `lights` where they moved, and sets the uniforms that read them; without `shown` nothing is shadowed. */
  update(renderer, uniforms, lights, shown) {
    const { middle, radius } = this.shape;
    uniforms.shadowLens.value.forEach((lens) => lens.set(0, 0, 1));
    if (!shown) return;
    this.target ??= new WebGLRenderTarget(SIDE * this.count, SIDE, {
      minFilter: NearestFilter,
      magFilter: NearestFilter,
      format: RedFormat,
      type: renderer.extensions.has("EXT_color_buffer_float") ? FloatType : HalfFloatType,
      generateMipmaps: false,
    });
    uniforms.shadowMaps.value = this.target.texture;
    const key = JSON.stringify(lights.map((light) => light.position));
    const draws = [];
    lights.forEach(({ position }, k) => {
      const gap = subtract(position, middle);
      const clear = dot(gap, gap) - 1.05 * radius * radius;
      // Within the sphere about the mesh nothing is shadowed.
      if (!(clear > 0 && radius > 0)) return;
      const least = gap.map(Math.abs).reduce((best, x, i, all) => (x < all[best] ? i : best), 0);
      const frame = lookAt(position, middle, [0, 1, 2].map((i) => (i === least ? 1 : 0)));
      const focal = ((SIDE / 2) * Math.sqrt(clear)) / radius;
      const rows = rowsOf(frame);
      // Stored depths are above 0, which is nothing.
      const from = Math.sqrt(dot(gap, gap)) - 2 * radius;
      rows.forEach((row, i) => uniforms.shadowRows.value[3 * k + i].copy(row));
      uniforms.shadowLens.value[k].set(focal, from, radius);
      draws.push([k, rows, focal, depthRange(position, middle, radius, frame.rotation[2]), from, radius]);
    });
    if (key === this.drawn) return;
    this.drawn = key;
    into(renderer, this.target, 0, () => {
      renderer.setClearAlpha(0);
      const { uniforms: own } = this.mesh.material;
      this.target.scissorTest = true;
      for (const [k, rows, focal, range, from, scale] of draws) {
        own.rows.value = rows;
        own.lens.value.set(focal, focal, SIDE / 2, SIDE / 2);
        own.range.value.set(...range);
        own.depthScale.value.set(from, scale);
        this.target.viewport.set(k * SIDE, 0, SIDE, SIDE);
        this.target.scissor.set(k * SIDE, 0, SIDE, SIDE);
        renderer.setRenderTarget(this.target);
        renderer.clear(true, true, false);
        renderer.render(this.scene, camera);
      }
    });
  }

  dispose() {
    this.target?.dispose();
    this.mesh.material.dispose();
  }
}
