// Captured views on the graphics card: photograph, model, depth and confidence of those that are near.

import {
  BufferGeometry,
  Float32BufferAttribute,
  DataTexture,
  DoubleSide,
  FloatType,
  GLSL3,
  HalfFloatType,
  Mesh,
  NearestFilter,
  NoBlending,
  OrthographicCamera,
  RawShaderMaterial,
  RGBAFormat,
  Scene,
  Vector2,
  Vector3,
  Vector4,
  WebGLArrayRenderTarget,
  WebGLRenderTarget,
} from "three";
import { captureFragment, captureVertex, fullVertex, layerFragment } from "./passes.js";
import { LIGHTS, reflectance, shadow } from "./reflectance.js";
import { CANDIDATES } from "./residual.js";
import { centre, subtract, dot } from "./views.js";

/** Bytes that captured views may take on the graphics card. */
const MEMORY = 320 << 20;
/** Layers at most: what is near from the next places of the camera stays. */
const MOST_LAYERS = 16;
const HEAD = "precision highp float;\nprecision highp int;\nprecision highp sampler2D;\nprecision highp sampler2DArray;\n";

const camera = new OrthographicCamera();

/** The rows of a camera's rotation, each with its translation. */
export const rowsOf = (view) => view.rotation.map((row, i) => new Vector4(...row, view.translation[i]));

/** Nearest and farthest depth of a sphere. */
export function depthRange(place, middle, radius, forward) {
  const depth = dot(subtract(middle, place), forward);
  const far = Math.max(depth + 1.05 * radius, 1e-6);
  return [Math.max(depth - 1.05 * radius, 1e-4 * far), far];
}

/** Renders into a target and leaves the renderer as it was. */
export function into(renderer, target, layer, draw) {
  const before = [renderer.getRenderTarget(), renderer.getActiveCubeFace(), renderer.getActiveMipmapLevel()];
  const { autoClear, xr, shadowMap } = renderer;
  const [enabled, updated, alpha] = [xr.enabled, shadowMap.autoUpdate, renderer.getClearAlpha()];
  renderer.autoClear = false;
  xr.enabled = false;
  shadowMap.autoUpdate = false;
  renderer.setRenderTarget(target, layer);
  try {
    draw();
  } finally {
    renderer.setClearAlpha(alpha);
    renderer.autoClear = autoClear;
    xr.enabled = enabled;
    shadowMap.autoUpdate = updated;
    renderer.setRenderTarget(...before);
  }
}

const pixelExact = { minFilter: NearestFilter, magFilter: NearestFilter, generateMipmaps: false, format: RGBAFormat };

export class Captured {
  /**
   * `views` as the file has them, `geometry` the stream's own surface, `maps` the uniforms of its reflectance, `ggx` whether it has lobes,
   * `kinds` what the components are, `white` the white board, `lightOf` a view's light in units of the maps, `shape` the sphere about the
   * surface, `shadows` draws what a light reaches of it.
   */
  constructor({ views, geometry, maps, ggx, kinds, white, lightOf, shape, shadows }) {
    this.views = views;
    this.kinds = kinds;
    this.lightOf = lightOf;
    this.shape = shape;
    this.shadows = shadows;
    this.width = Math.max(1, ...views.map((view) => view.camera.width));
    this.height = Math.max(1, ...views.map((view) => view.camera.height));
    const layer = this.width * this.height * 8 * 2 * kinds.length;
    this.layers = Math.max(4, Math.min(MOST_LAYERS, Math.floor(MEMORY / layer), Math.max(views.length, 1)));
    /** For each layer the view in it, and when it was last near. */
    this.held = new Array(this.layers).fill(null);
    this.used = new Array(this.layers).fill(0);
    this.clock = 0;
    this.targets = null;
    this.mesh = new Mesh(
      geometry,
      new RawShaderMaterial({
        glslVersion: GLSL3,
        defines: { GGX: Number(ggx), BEHIND: Number("behind" in geometry.attributes), SHADOW: 0 },
        vertexShader: HEAD + captureVertex,
        fragmentShader: HEAD + reflectance + shadow + captureFragment,
        side: DoubleSide,
        blending: NoBlending,
        uniforms: {
          ...maps,
          rows: { value: [] },
          lens: { value: new Vector4() },
          size: { value: new Vector2() },
          range: { value: new Vector2() },
          centre: { value: new Vector3() },
          depthScale: { value: new Vector2() },
          light: { value: null },
          kinds: { value: [kinds[0], kinds[1] ?? kinds[0]] },
          shadowMaps: { value: null },
          shadowRows: { value: Array.from({ length: 3 * LIGHTS }, () => new Vector4()) },
          shadowLens: { value: Array.from({ length: LIGHTS }, () => new Vector3()) },
        },
      }),
    );
    this.mesh.frustumCulled = false;
    this.scene = new Scene().add(this.mesh);
    const triangle = new BufferGeometry();
    triangle.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    this.full = new Mesh(
      triangle,
      new RawShaderMaterial({
        glslVersion: GLSL3,
        vertexShader: HEAD + fullVertex,
        fragmentShader: HEAD + layerFragment,
        depthTest: false,
        depthWrite: false,
        blending: NoBlending,
        uniforms: {
          photograph: { value: null },
          model: { value: null },
          secondModel: { value: null },
          size: { value: [1, 1] },
          lens: { value: new Vector3() },
          part: { value: 0 },
          scale: { value: new Vector3(...white.map((w) => 1 / w)) },
        },
      }),
    );
    this.full.frustumCulled = false;
    this.fullScene = new Scene().add(this.full);
  }

  /** Views looked at for a surface point. */
  get candidates() {
    return Math.min(CANDIDATES, this.layers);
  }

  has(view) {
    return this.held.includes(view);
  }

  /** Puts a decoded view into a layer; `wanted` are the views that may not be dropped for it. False where there is no room. */
  put(renderer, decoded, components, wanted) {
    if (!this.targets) this.allocate();
    const free = this.held.map((view, layer) => [view === null ? -1 : wanted.includes(view) ? Infinity : this.used[layer], layer]);
    const [age, layer] = free.reduce((a, b) => (b[0] < a[0] ? b : a));
    if (age === Infinity) return false;
    this.drawModel(renderer, decoded.index);
    const { camera: lens } = this.views[decoded.index];
    const { uniforms } = this.full.material;
    uniforms.size.value = [decoded.width, decoded.height];
    const [middle, radius] = this.depths(decoded.index);
    uniforms.lens.value.set(lens.focal[0], middle, radius);
    components.forEach((component, k) => {
      const photograph = new DataTexture(decoded.images[component], decoded.width, decoded.height, RGBAFormat, FloatType);
      photograph.needsUpdate = true;
      for (const [part, source] of [[2 * k, photograph], [2 * k + 1, this.model.textures[k]]]) {
        uniforms.photograph.value = photograph;
        uniforms.model.value = part % 2 ? source : this.model.textures[0];
        uniforms.secondModel.value = this.model.textures[1];
        uniforms.part.value = part;
        into(renderer, this.targets[part], layer, () => renderer.render(this.fullScene, camera));
      }
      photograph.dispose();
    });
    this.held[layer] = decoded.index;
    this.used[layer] = ++this.clock;
    return true;
  }

  allocate() {
    const options = { ...pixelExact, type: HalfFloatType, depthBuffer: false };
    this.targets = this.kinds.flatMap(() => [0, 1]).map(() => new WebGLArrayRenderTarget(this.width, this.height, this.layers, options));
    this.model = new WebGLRenderTarget(this.width, this.height, { ...pixelExact, type: HalfFloatType, count: 2, depthBuffer: true });
  }

  /** What depths of a view are stored relative to. */
  depths(view) {
    const lens = this.views[view].camera;
    return [dot(subtract(this.shape.middle, centre(lens)), lens.rotation[2]), Math.max(this.shape.radius, 1e-30)];
  }

  /** Draws model and depth of a captured view. */
  drawModel(renderer, view) {
    const { camera: lens } = this.views[view];
    const { uniforms } = this.mesh.material;
    const place = centre(lens);
    uniforms.rows.value = rowsOf(lens);
    uniforms.lens.value.set(...lens.focal, ...lens.principal);
    uniforms.size.value.set(this.width, this.height);
    uniforms.range.value.set(...depthRange(place, this.shape.middle, this.shape.radius, lens.rotation[2]));
    uniforms.centre.value.set(...place);
    uniforms.depthScale.value.set(...this.depths(view));
    uniforms.light.value = this.lightOf(view);
    const { light } = this.views[view];
    this.shadows.update(renderer, uniforms, light ? [light] : [], Boolean(light));
    into(renderer, this.model, 0, () => {
      renderer.setClearAlpha(-2000);
      renderer.clear(true, true, false);
      renderer.render(this.scene, camera);
    });
  }

  /** Sets the uniforms for looking at these views, which are held. */
  select(uniforms, views) {
    const shown = views.slice(0, this.candidates);
    this.clock++;
    shown.forEach((view, k) => {
      const layer = this.held.indexOf(view);
      this.used[layer] = this.clock;
      const { camera: lens } = this.views[view];
      rowsOf(lens).forEach((row, i) => uniforms.viewRows.value[3 * k + i].copy(row));
      uniforms.viewLens.value[k].set(...lens.focal, ...lens.principal);
      uniforms.viewCentre.value[k].set(...centre(lens));
      uniforms.viewSize.value[k].set(lens.width, lens.height, layer);
      uniforms.viewDepth.value[k].set(...this.depths(view));
      uniforms.viewLight.value[k] = this.lightOf(view);
    });
    uniforms.candidates.value = shown.length;
    ["firstPhotograph", "firstModel", "secondPhotograph", "secondModel"].forEach((name, k) => {
      uniforms[name].value = this.targets?.[k]?.texture ?? null;
    });
  }

  dispose() {
    this.targets?.forEach((target) => target.dispose());
    this.model?.dispose();
    this.shadows.dispose();
    this.mesh.material.dispose();
    this.full.material.dispose();
    this.full.geometry.dispose();
  }
}
