/** tsuya's measured appearances in three.js (WebGLRenderer, WebGL 2). */

import type { BufferGeometry, Camera, EventDispatcher, Matrix3, Matrix4, Mesh, Quaternion, ShaderMaterial, WebGLRenderer } from "three";
import type { GLTF, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import type { OpenOptions, Surface, TsuyaFile, TsuyaSource } from "tsuya";

/** Name of the glTF extension. */
export const EXTENSION: "TSUYA_materials_appearance";

/**
 * `loader.register((parser) => new TsuyaAppearance(parser, options))`: meshes show the document's own material until their measured
 * appearance is there, and keep it where there is none that can be used. The loader's result has `userData.tsuya.ready`, a promise of the
 * appearances (null for those that can't be used).
 */
export class TsuyaAppearance implements GLTFLoaderPlugin {
  constructor(parser: GLTFParser, options?: LoaderOptions);
  readonly name: string;
  afterRoot(gltf: GLTF): Promise<void>;
}

export interface LoaderOptions {
  /** Hears what becomes of each appearance. */
  onStatus?: (status: Status) => void;
  /** How streams are opened. */
  decoder?: OpenOptions;
}

export interface Status {
  state: "loading" | "ready" | "fallback";
  /** The appearance that is shown now, with `ready`. */
  appearance: Appearance | null;
  /** Its number in the document; null where the whole document is meant. */
  index: number | null;
  /** Why the document's own material stays, with `fallback`. */
  error: AppearanceError | null;
}

export class AppearanceError extends Error {
  name: "AppearanceError";
  /**
   * `version`: extension or stream are of a later version; `missing`: there is no stream; `damaged`: it is not whole; `unsupported`: it has no
   * atlas; `other-mesh`: it is that of another mesh; `document`: the link to it is wrong.
   */
  reason: "version" | "missing" | "damaged" | "unsupported" | "other-mesh" | "document";
}

export interface Layers {
  diffuse: boolean;
  specular: boolean;
  /** The fitted reflectance. */
  model: boolean;
  /** What the photographs have beyond it. */
  residual: boolean;
}

export const ALL_LAYERS: Readonly<Layers>;

/** Light, in the world and the units of the stream. */
export type Lighting =
  /** The capture's own; of several the one with this number, 0 the most used. */
  | { capture: number }
  /** At most four lights; irradiance at distance `r` is `intensity / r^2`. */
  | { points: { position: [number, number, number]; intensity: [number, number, number] }[] }
  /** From all around, turned about +Y by `turn` radians. */
  | { environment: Environment; turn?: number };

/** Spherical Gaussians `amplitude exp(sharpness (axis . direction - 1))`, +Y up, at most 12; radiance 1 all around makes white white. */
export interface Environment {
  title: string;
  lobes: { axis: [number, number, number]; sharpness: number; amplitude: [number, number, number] }[];
}

/** Made-up environments to choose from. */
export const ENVIRONMENTS: Record<"studio" | "overcast" | "evening" | "windows", Environment>;

/** An environment of the lobes that a file has (`Light.lobes`). */
export function environmentOfLobes(lobes: Float32Array, title?: string): Environment;

/**
 * An environment of a latitude-longitude picture, +Y up: `data` has four linear numbers a pixel, the highest row first; the middle is +Z, a quarter
 * from the left edge +X.
 */
export function environmentOfPicture(picture: { data: ArrayLike<number>; width: number; height: number }, title: string): Environment;

/**
 * The look of one stream. Decodes the captured views near the camera by itself; `change` says that a picture would look different now, `error`
 * (with `error` and `view`) that a view can't be decoded, and is left out. Lighting and layers may be changed any time; draw again after it.
 */
export class Appearance extends EventDispatcher<{ change: {}; error: { error: Error; view: number } }> {
  /**
   * Opens a stream; `source` may be an open file, which the appearance then owns. With `surface: false` the mesh is shown where the file has a
   * finer surface, too: for documents whose meshes are bound.
   */
  static open(source: TsuyaSource | TsuyaFile, options?: OpenOptions & { surface?: boolean }): Promise<Appearance>;

  readonly file: TsuyaFile;
  /** The stream's own mesh, or its finer surface with the mesh behind it, in its world. */
  readonly geometry: BufferGeometry;
  /** The finer surface alone; null where the file has none or it was not asked for. */
  readonly surface: Surface | null;
  readonly material: ShaderMaterial;
  /** Meshes that show it. */
  readonly bound: Mesh[];
  /** Whether the capture's lights are known; without them only `{ capture }` can be shown. */
  readonly relightable: boolean;
  /** For each captured view the number of its light. */
  readonly lightNumbers: number[];
  readonly shape: { middle: [number, number, number]; radius: number };
  /** Texels of the atlas; null without one. */
  readonly atlasSize: [number, number] | null;
  /** Turn that brings the stream's world upright, +Y up. */
  readonly upright: Quaternion;
  readonly lightDistance: number;
  /** Views decoded so far. */
  readonly decoded: number;
  /** Whether all views that matter for the last picture are in it. */
  readonly complete: boolean;

  lighting: Lighting;
  layers: Layers;
  /** Factor of the picture's brightness; at 1 the capture's white board is white. */
  exposure: number;
  /** Captured views that the residual is interpolated between: 1 to 3. */
  views: number;
  /** Whether the object shadows itself under point lights, the capture's own where no view was captured, and, after `loadVisibility`, environments. */
  shadows: boolean;
  /** Reads photographs by cubic interpolation; bilinear is faster. */
  cubic: boolean;
  /** Leaves out what the masks of the nearest captured views cut off. */
  cutByMasks: boolean;
  /** Shows the residual about a middle grey. */
  signedResidual: boolean;

  /** A mesh of the stream's own geometry, in its world. */
  mesh(): Mesh;
  /** Makes another mesh show it; the mesh's attribute `atlas` holds texture coordinates. */
  bind(mesh: Mesh, maps: { toStream?: Matrix4; atlasTransform?: Matrix3 }): void;
  /** Reads what the vertices see, for shadows under environments; false where the file says nothing of it. */
  loadVisibility(): Promise<boolean>;
  /** Called before each picture by bound meshes. */
  update(renderer: WebGLRenderer, camera: Camera, fromWorld: Matrix4): void;
  dispose(): void;
}
