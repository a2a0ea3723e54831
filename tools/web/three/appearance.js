// A stream as a three.js material: fitted reflectance, and what the photographs have beyond it.

import {
  BufferAttribute,
  BufferGeometry,
  EventDispatcher,
  Matrix3,
  Matrix4,
  Mesh,
  Quaternion,
  ShaderMaterial,
  Vector2,
  Vector3,
  Vector4,
} from "three";
import { openTsuya } from "tsuya";
import { Atlas, transformed } from "./binding.js";
import { cameraFrame, setRays } from "./camera.js";
import { Captured } from "./captured.js";
import { LOBES, MOST_TERMS, environment, setEnvironment, visibilityTexture } from "./environment.js";
import { GGX_LOBES, LIGHTS, reflectance, shadow } from "./reflectance.js";
import { CANDIDATES, residual } from "./residual.js";
import { fragment, vertex } from "./shading.js";
import { Shadows } from "./shadows.js";
import { atlasTexture, lobeTexture } from "./textures.js";
import { SPARE_VIEWS, VIEWS, add, bounds, captureLight, centre, dot, length, nearest, normalize, numberLights, subtract } from "./views.js";

const KINDS = { diffuse: 0, specular: 1, combined: 2 };
/** Key views decoded before those that are nearest, so that every side has something. */
const KEY_VIEWS = 4;
const WHITE_ALBEDO = 0.95;

/** Everything that is shown. */
export const ALL_LAYERS = Object.freeze({ diffuse: true, specular: true, model: true, residual: true });

/** Two arrays, one after the other. */
function joined(first, second) {
  const both = new first.constructor(first.length + second.length);
  both.set(first);
  both.set(second, first.length);
  return both;
}

const list = (count, make) => Array.from({ length: count }, make);

/**
 * The look of one stream. Meshes show it once they are bound to it (`mesh`, `bind`); it decodes the captured views that are near the camera by
 * itself, each once, and dispatches `change` when a picture would look different, `error` when a view can't be decoded.
 */
export class Appearance extends EventDispatcher {
  /**
   * Opens a stream: `source` as for `openTsuya`, or a file that it gave. With `surface: false` its own geometry is the mesh where the file has
   * a finer surface, too.
   */
  static async open(source, options = {}) {
    const file = typeof source?.view === "function" ? source : await openTsuya(source, options);
    try {
      const finer = options.surface === false ? null : file.surface();
      const [mesh, maps, surface] = await Promise.all([file.mesh(), file.reflectance(), finer]);
      if (!mesh || !mesh.indices.length) throw new Error("the file holds no mesh, so there is nothing to show");
      return new Appearance(file, mesh, maps, surface);
    } catch (error) {
      file.close();
      throw error;
    }
  }

  constructor(file, mesh, maps, surface = null) {
    super();
    this.file = file;
    this.source = mesh;
    /** The finer surface, where the file has one. */
    this.surface = surface;
    this.layers = { ...ALL_LAYERS };
    /** `{capture: number}`, `{points: [{position, intensity}]}` in the stream's world and units, or `{environment, turn}`. */
    this.lighting = { capture: 0 };
    this.exposure = 1;
    /** Views that the residual is interpolated between; 1 takes the nearest alone. */
    this.views = VIEWS;
    this.shadows = true;
    /** Reads photographs by cubic interpolation: sharper, and slower. */
    this.cubic = true;
    /** Leaves out what the masks of the nearest views cut off. */
    this.cutByMasks = true;
    /** Shows the residual about a middle grey. */
    this.signedResidual = false;
    this.decoded = 0;
    this.relightable = Boolean(maps?.relightable);
    this.atlasSize = maps && [maps.width, maps.height];
    this.components = [...file.facts.components];
    this.kinds = this.components.map((component) => KINDS[component]);
    if (!this.kinds.length) this.kinds = [maps?.specular ? 2 : 0];
    this.shape = bounds(mesh.positions);
    this.lightNumbers = numberLights(file.views, this.shape.middle);
    this.prepareUnits();
    this.geometry = this.makeGeometry();
    const shape = surface ? bounds(surface.positions) : this.shape;
    this.ggx = this.relightable && maps.lobes.length === GGX_LOBES;
    const dark = new Float32Array(4);
    const scale = this.relightable ? this.unit : file.facts.white.map((w) => 1 / w);
    const scaled = (data) => data.map((x, k) => (k % 4 < 3 ? x * scale[k % 4] : x));
    this.maps = {
      diffuseMap: { value: maps ? atlasTexture(scaled(maps.diffuse), maps.width, maps.height) : atlasTexture(dark, 1, 1) },
      specularMap: { value: maps?.specular ? atlasTexture(scaled(maps.specular), maps.width, maps.height) : atlasTexture(dark, 1, 1) },
      relightable: { value: this.relightable },
      hasSpecular: { value: Boolean(maps?.specular) },
      unit: { value: new Vector3(...scale) },
    };
    if (this.ggx) {
      this.maps.lobeMap = { value: lobeTexture(maps.lobes, maps.width, maps.height, scale) };
      this.maps.lobeRoughness = { value: maps.lobes.map(({ roughness }) => roughness) };
    }
    this.captured = new Captured({
      views: file.views,
      geometry: this.geometry,
      maps: this.maps,
      ggx: this.ggx,
      kinds: this.kinds,
      white: file.facts.white,
      lightOf: (view) => this.inUnits(file.views[view].light),
      shape,
      shadows: new Shadows(this.geometry, shape, 1),
    });
    this.shadowMaps = new Shadows(this.geometry, shape);
    this.material = this.makeMaterial(0);
    this.bound = [];
    this.arrived = [];
    /** A view that is on the card: its memory is used again. */
    this.spare = null;
    this.wanted = [];
    this.failed = new Set();
    this.closed = false;
    this.decode();
  }

  /**
   * `unit`: the maps times this are of the order of 1, whatever units the capture's lights have; a BRDF times it is one per steradian but
   * for the board's albedo.
   */
  prepareUnits() {
    const { white } = this.file.facts;
    const sums = [0, 0, 0];
    let count = 0;
    for (const { light } of this.file.views) {
      const gap = light && subtract(light.position, this.shape.middle);
      if (!gap || !(dot(gap, gap) > 0)) continue;
      light.intensity.forEach((x, c) => (sums[c] += x / dot(gap, gap) / white[c]));
      count++;
    }
    this.unit = sums.map((sum) => (sum > 0 ? sum / count : 1));
  }

  /** A light with its intensity in units of maps and white board. */
  inUnits(light) {
    const { white } = this.file.facts;
    const scaled = light ? light.intensity.map((x, c) => x / white[c] / this.unit[c]) : [0, 0, 0];
    return { position: new Vector3(...(light?.position ?? [0, 0, 0])), intensity: new Vector3(...scaled) };
  }

  makeGeometry() {
    const { source: mesh, surface } = this;
    const front = (surface ?? mesh).positions.length / 3;
    // Behind a finer surface the mesh, shown where only that is met: what photographs say of silhouettes is in it.
    const array = (name) => (surface ? joined(surface[name], mesh[name]) : mesh[name]);
    const geometry = new BufferGeometry();
    const positions = array("positions");
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setAttribute("normal", new BufferAttribute(array("normals"), 3));
    const uvs = array("uvs");
    const atlas = uvs.length ? uvs : new Float32Array((positions.length / 3) * 2);
    geometry.setAttribute("uv", new BufferAttribute(atlas, 2));
    geometry.setAttribute("atlas", geometry.attributes.uv);
    const indices = array("indices");
    if (surface) for (let k = surface.indices.length; k < indices.length; k++) indices[k] += front;
    geometry.setIndex(new BufferAttribute(indices, 1));
    if (surface) geometry.setAttribute("behind", new BufferAttribute(new Float32Array(positions.length / 3).fill(1, front), 1));
    return geometry;
  }

  makeMaterial(terms) {
    const names = list(terms, (_, k) => `occlusion${k}`);
    const vertexShader = vertex
      .replace("OCCLUSION_ATTRIBUTES", names.map((name) => `attribute vec4 ${name};`).join("\n"))
      .replace("OCCLUSION_ASSIGNMENTS", names.map((name, k) => `vOcclusion[${k}] = ${name};`).join("\n"));
    const material = new ShaderMaterial({
      name: "TsuyaAppearance",
      // Shaders without the environment compile faster.
      defines: { COMPONENTS: this.kinds.length, VISIBILITY: terms, ENVIRONMENT: 0, GGX: Number(this.ggx), BEHIND: Number(this.surface !== null) },
      vertexShader,
      fragmentShader: `uniform vec3 eye;\n${reflectance}${shadow}${residual}\n#if ENVIRONMENT\n${environment}\n#endif\n${fragment}`,
      toneMapped: false,
      uniforms: {
        ...this.maps,
        toStream: { value: new Matrix4() },
        normalToStream: { value: new Matrix3() },
        atlasTransform: { value: new Matrix3() },
        eye: { value: new Vector3() },
        rays: { value: new Matrix3() },
        perspective: { value: true },
        lighting: { value: 0 },
        captureLight: { value: this.inUnits(null) },
        lights: { value: list(LIGHTS, () => this.inUnits(null)) },
        lightCount: { value: 0 },
        kinds: { value: [this.kinds[0], this.kinds[1] ?? this.kinds[0]] },
        showDiffuse: { value: true },
        showSpecular: { value: true },
        showModel: { value: true },
        showResidual: { value: true },
        signedResidual: { value: false },
        cutByMasks: { value: true },
        exposure: { value: 1 },
        cubic: { value: true },
        blended: { value: VIEWS },
        candidates: { value: 0 },
        viewRows: { value: list(3 * CANDIDATES, () => new Vector4()) },
        viewLens: { value: list(CANDIDATES, () => new Vector4()) },
        viewCentre: { value: list(CANDIDATES, () => new Vector3()) },
        viewSize: { value: list(CANDIDATES, () => new Vector3()) },
        viewDepth: { value: list(CANDIDATES, () => new Vector2()) },
        viewLight: { value: list(CANDIDATES, () => this.inUnits(null)) },
        farthest: { value: [1, 1] },
        firstPhotograph: { value: null },
        firstModel: { value: null },
        secondPhotograph: { value: null },
        secondModel: { value: null },
        shadowMaps: { value: null },
        shadowRows: { value: list(3 * LIGHTS, () => new Vector4()) },
        shadowLens: { value: list(LIGHTS, () => new Vector3()) },
        lobeAxis: { value: list(LOBES, () => new Vector4()) },
        lobeAmplitude: { value: list(LOBES, () => new Vector3()) },
        lobeCount: { value: 0 },
        selfShadows: { value: true },
        visibilityBases: { value: null },
        visibilitySize: { value: 1 },
      },
    });
    // Of meshes of other documents.
    material.defaultAttributeValues.behind = [0];
    return material;
  }

  /** A mesh of the stream's own geometry, in the stream's world: the finer surface, where the file has one. */
  mesh() {
    const mesh = new Mesh(this.geometry, this.material);
    this.bind(mesh, {});
    return mesh;
  }

  /**
   * Makes a mesh show this look. `toStream` leads from its positions to the stream's world, `atlasTransform` from its attribute `atlas` to the
   * atlas.
   */
  bind(mesh, { toStream = new Matrix4(), atlasTransform = new Matrix3() }) {
    mesh.material = this.material;
    if (!this.bound.includes(mesh)) this.bound.push(mesh);
    mesh.userData.tsuya = { appearance: this, toStream, atlasTransform };
    const normalToStream = new Matrix3().getNormalMatrix(toStream);
    mesh.onBeforeRender = (renderer, scene, camera) => {
      const { uniforms } = this.material;
      uniforms.toStream.value.copy(toStream);
      uniforms.normalToStream.value.copy(normalToStream);
      uniforms.atlasTransform.value.copy(atlasTransform);
      this.update(renderer, camera, new Matrix4().copy(mesh.matrixWorld).invert().premultiply(toStream));
      this.material.uniformsNeedUpdate = true;
    };
  }

  /** Prepares a picture; `fromWorld` leads from the scene's world to the stream's. */
  update(renderer, camera, fromWorld) {
    const { uniforms } = this.material;
    const toWorld = camera.matrixWorld;
    // Of a camera without perspective a far place on its axis.
    const place = camera.isPerspectiveCamera ? [0, 0, 0] : [0, 0, 1e3 * this.shape.radius];
    const eye = new Vector3(...place).applyMatrix4(toWorld).applyMatrix4(fromWorld);
    const frame = cameraFrame(new Matrix4().multiplyMatrices(fromWorld, toWorld), eye);
    uniforms.eye.value.copy(eye);
    uniforms.perspective.value = Boolean(camera.isPerspectiveCamera);
    setRays(uniforms.rays.value, renderer, camera, fromWorld);
    this.setLayers(uniforms);
    this.setLight(renderer, uniforms, eye.toArray(), frame, fromWorld);
    this.upload(renderer);
    const number = this.lighting.capture ?? 0;
    const held = this.order(eye.toArray(), number).filter(({ view }) => this.captured.has(view));
    this.captured.select(uniforms, held.map(({ view }) => view));
  }

  setLayers(uniforms) {
    const { diffuse, specular, model, residual: rest } = this.layers;
    Object.assign(uniforms.showDiffuse, { value: diffuse });
    Object.assign(uniforms.showSpecular, { value: specular });
    Object.assign(uniforms.showModel, { value: model });
    Object.assign(uniforms.showResidual, { value: rest });
    uniforms.signedResidual.value = this.signedResidual;
    uniforms.cutByMasks.value = this.cutByMasks;
    uniforms.exposure.value = this.exposure;
    uniforms.cubic.value = this.cubic;
    uniforms.blended.value = this.views;
  }

  setLight(renderer, uniforms, eye, frame, fromWorld) {
    const near = this.order(eye, this.lighting.capture ?? 0);
    const used = this.views === 1 ? 1 : VIEWS + SPARE_VIEWS;
    this.wanted = near.slice(0, Math.min(used, this.captured.candidates)).map(({ view }) => view);
    const light = captureLight(this.file.views, near.slice(0, used), frame, this.views);
    uniforms.captureLight.value = this.inUnits(light);
    const { points, environment: around, turn } = this.relightable ? this.lighting : {};
    // Where no view was captured its shadows were not, either.
    const free = this.relightable && this.surface && light && !this.isCapturedFrom(near[0].view, eye);
    uniforms.lighting.value = around ? 2 : points ? 1 : free ? 3 : 0;
    if (free) this.kinds.forEach((kind, k) => (uniforms.farthest.value[k] = this.farthest(kind, light, eye, near)));
    const lights = (points ?? (around || !free ? [] : [light])).slice(0, LIGHTS);
    lights.forEach((l, k) => (uniforms.lights.value[k] = this.inUnits(l)));
    uniforms.lightCount.value = lights.length;
    this.shadowMaps.update(renderer, uniforms, lights, this.shadows && lights.length > 0);
    uniforms.selfShadows.value = this.shadows;
    if (Boolean(around) !== Boolean(this.material.defines.ENVIRONMENT)) {
      this.material.defines.ENVIRONMENT = Number(Boolean(around));
      this.material.needsUpdate = true;
    }
    if (around) {
      const rotation = new Matrix4().makeRotationY(turn ?? 0).premultiply(fromWorld);
      // A white board in a radiance of 1 all around is white.
      const scale = new Vector3().setScalar(WHITE_ALBEDO / Math.PI);
      setEnvironment(uniforms, around, (axis) => axis.transformDirection(rotation), scale);
    }
  }

  /** Whether a view was captured from a place, as exactly as documents in single precision lie on the stream. */
  isCapturedFrom(view, eye) {
    const place = centre(this.file.views[view].camera);
    return length(subtract(place, eye)) <= 1e-4 * length(subtract(place, this.shape.middle));
  }

  /**
   * How unlike in light and camera, told at the object's middle, the nearest photograph is that does not take part: a photograph takes part
   * less the nearer it comes to that.
   */
  farthest(kind, light, eye, near) {
    const { middle } = this.shape;
    const directions = (position, place) => {
      const [l, v] = [position, place].map((target) => normalize(subtract(target, middle)));
      return { l, v, h: normalize(add(l, v)) };
    };
    const asked = directions(light.position, eye);
    const gap = (own, name) => dot(subtract(asked[name], own[name]), subtract(asked[name], own[name]));
    const apart = near.slice(this.wanted.length).flatMap(({ view }) => {
      const { camera, light } = this.file.views[view];
      if (!light) return [];
      const own = directions(light.position, centre(camera));
      const [l, v, h] = ["l", "v", "h"].map((name) => gap(own, name));
      return Math.sqrt(kind === KINDS.diffuse ? l + v : h + 0.01 * (l + v));
    });
    return Math.max(Math.min(...apart, kind === KINDS.diffuse ? 2 : 1), 1e-5);
  }

  /** All views under one of the capture's lights, the nearest first. */
  order(eye, number) {
    const under = this.lightNumbers.flatMap((n, view) => (n === number ? [view] : []));
    return nearest(this.file.views, under, eye, this.shape.middle);
  }

  /** Decodes what is wanted, one view at a time, until the look is disposed of. */
  async decode() {
    const { file } = this;
    const keys = file.order.slice(0, KEY_VIEWS).map(({ view }) => view);
    const done = new Set();
    while (!this.closed) {
      const missing = (views) => views.find((view) => !done.has(view) && !this.failed.has(view) && !this.captured.has(view));
      const next = missing(keys) ?? this.wanted.find((view) => !this.failed.has(view) && !this.captured.has(view));
      if (next === undefined || this.arrived.length > 1 || this.arrived.some(({ index }) => index === next)) {
        // Until the camera moves, or what has come is on the card.
        await new Promise((resolve) => (this.wake = resolve));
        continue;
      }
      try {
        const { spare: reuse } = this;
        this.spare = null;
        const view = await file.view(next, { reuse });
        done.add(next);
        if (this.closed) return;
        this.decoded++;
        this.arrived.push(view);
        this.dispatchEvent({ type: "change" });
      } catch (error) {
        if (this.closed || error.name === "AbortError") return;
        this.failed.add(next);
        this.dispatchEvent({ type: "error", error, view: next });
      }
    }
  }

  /** Brings decoded views onto the card, and asks for more. */
  upload(renderer) {
    for (const view of this.arrived.splice(0)) {
      if (!this.captured.has(view.index)) this.captured.put(renderer, view, this.components, this.wanted);
      this.spare = view;
    }
    const wake = this.wake;
    this.wake = null;
    wake?.();
  }

  /** True where the views that are nearest to the last picture's camera are all shown. */
  get complete() {
    return this.wanted.every((view) => this.captured.has(view) || this.failed.has(view));
  }

  /** Reads what the vertices see, for shadows under environments; false where the file says nothing of it. */
  async loadVisibility() {
    const visibility = await this.file.visibility();
    if (!visibility || this.closed) return false;
    const vectors = Math.ceil(Math.min(visibility.terms, MOST_TERMS) / 4);
    const { terms } = visibility;
    const { sourceVertices } = this.source;
    // Four terms of the mesh's vertices; those of a finer surface lie between three of them.
    const ofMesh = list(vectors, (_, k) => {
      const weights = new Float32Array(sourceVertices.length * 4);
      sourceVertices.forEach((vertex, at) => {
        for (let c = 0; c < 4 && 4 * k + c < terms; c++) weights[4 * at + c] = visibility.weights[vertex * terms + 4 * k + c];
      });
      return weights;
    });
    const ofSurface = ({ vertices, weights: shares }, k) => {
      const weights = new Float32Array((vertices.length / 3) * 4);
      vertices.forEach((vertex, corner) => {
        const at = 4 * Math.floor(corner / 3);
        for (let c = 0; c < 4 && 4 * k + c < terms; c++) weights[at + c] += shares[corner] * visibility.weights[vertex * terms + 4 * k + c];
      });
      return weights;
    };
    ofMesh.forEach((weights, k) => {
      const own = this.surface ? joined(ofSurface(this.surface.between, k), weights) : weights;
      this.geometry.setAttribute(`occlusion${k}`, new BufferAttribute(own, 4));
    });
    this.bound.forEach((mesh) => this.carryVisibility(mesh, ofMesh));
    const material = this.makeMaterial(vectors);
    this.material.defines.VISIBILITY = vectors;
    this.material.vertexShader = material.vertexShader;
    material.dispose();
    this.material.uniforms.visibilityBases.value = visibilityTexture(visibility, vectors);
    this.material.uniforms.visibilitySize.value = visibility.size;
    this.material.needsUpdate = true;
    this.dispatchEvent({ type: "change" });
    return true;
  }

  /** Gives the vertices of a document's mesh the visibility that the stream's mesh has at their texture coordinates. */
  carryVisibility({ geometry, userData }, ofMesh) {
    if (geometry === this.geometry) return;
    const atlas = this.atlas();
    const at = geometry.attributes.atlas;
    const places = list(at.count, (_, k) => atlas.find(...transformed(userData.tsuya.atlasTransform, at.getX(k), at.getY(k))));
    ofMesh.forEach((own, k) => {
      const values = places.flatMap((place) => (place ? atlas.read(own, 4, place) : [0, 0, 0, 0]));
      geometry.setAttribute(`occlusion${k}`, new BufferAttribute(new Float32Array(values), 4));
    });
  }

  /** The mesh by its atlas coordinates; null without an atlas. */
  atlas() {
    if (!this.source.uvs.length || !this.atlasSize) return null;
    this.lookUp ??= new Atlas(this.source, this.atlasSize);
    return this.lookUp;
  }

  /** Turn that brings the stream's world upright, as a quaternion. */
  get upright() {
    return new Quaternion(...(this.file.facts.upright ?? [0, 0, 0, 1]));
  }

  /** Distance of the capture's light, or of its cameras, from the object's middle. */
  get lightDistance() {
    const view = this.file.views[0];
    if (!view) return 4 * this.shape.radius;
    return length(subtract(view.light?.position ?? centre(view.camera), this.shape.middle));
  }

  dispose() {
    this.closed = true;
    this.wake?.();
    this.file.close();
    this.captured.dispose();
    this.shadowMaps.dispose();
    this.geometry.dispose();
    this.material.dispose();
    this.material.uniforms.visibilityBases.value?.dispose();
    this.maps.diffuseMap.value.dispose();
    this.maps.specularMap.value.dispose();
    this.maps.lobeMap?.value.dispose();
  }
}
